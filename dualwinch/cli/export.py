"""The command ``export`` and the kernel's subcommands; toolboxes register further ones (`dualwinch.extensions`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from dualwinch import __version__
from dualwinch.cli.options import Block, ExperimentOptions, Out, default_of, own_default, stated
from dualwinch.cli.output import wrote_to

if TYPE_CHECKING:
    from dualwinch.simulation.blocks import BlockName

export = App(
    name="export",
    help="""Write controller, plant and closed loop as code for other tools.

The code is generated from the functions that `dualwinch simulate` runs, with the values of an experiment.
""",
    help_format="plaintext",
    version=__version__,
)


@export.command(name="c")
def export_c(
    *,
    out: Out,
    block: Annotated[Block | None, default_of("export_c", "block")] = None,
    precision: Annotated[Literal["double", "float"] | None, default_of("export_c", "precision")] = None,
    freeze: bool = False,
    udp: bool = False,
    generator: Literal["dualwinch", "casadi"] = "dualwinch",
    header: Annotated[bool, Parameter(negative="--no-header")] = True,
    main: bool = False,
    mex: bool = False,
    given: ExperimentOptions = ExperimentOptions(),
) -> None:
    """Write a self-contained C99 package: source, header, CMake file, README and an example.

    No heap, no globals, no recursion; several instances may run at once.

    Args:
        block: Block to export.
        precision: Of every number; float: no double-precision operation at all.
        freeze: Write the parameters as constants instead of an argument.
        udp: Also write a program that connects the controller to `dualwinch serve`.
        generator: Code generator; casadi: CasADi's own, for `casadi.external`.
        header: CasADi's option: write a header file, too.
        main: CasADi's option: write a `main` function, too.
        mex: CasADi's option: write a gateway for MATLAB, too.

    Examples:
        dualwinch export c --out controller
        dualwinch export c --precision float --freeze --out firmware
        dualwinch export c --udp --case 4 --out controller
        dualwinch export c --block plant --case 4 --out plant
        dualwinch export c --generator casadi --block plant --mex --out plant
    """
    from dualwinch.export import export_c as run
    from dualwinch.export import generate_c
    from dualwinch.model.errors import ConfigurationError

    experiment = given.exported(block)
    if generator == "dualwinch":
        if main or mex or not header:
            raise ConfigurationError("--header, --main and --mex: need --generator casadi")
        wrote_to(out, run(experiment, out, freeze=freeze, udp=udp, **stated(block=block, precision=precision)))
        return
    if freeze or udp or precision == "float":
        raise ConfigurationError(
            "--generator casadi: writes double precision with parameters as an argument, without a program"
        )
    blocks: list[BlockName] = [block or own_default("export_c", "block")]
    wrote_to(out, generate_c(experiment, out, blocks=blocks, header=header, main=main, mex=mex))


@export.command(name="mex")
def export_mex(*, out: Out, given: ExperimentOptions = ExperimentOptions()) -> None:
    """Write plant and controller as MEX sources for MATLAB and GNU Octave, with a closed loop in their language.

    Examples:
        dualwinch export mex --case 4 --out mex
    """
    from dualwinch.export import export_mex as run

    wrote_to(out, run(given.exported(), out))


@export.command(name="casadi")
def export_casadi(*, out: Out, given: ExperimentOptions = ExperimentOptions()) -> None:
    """Write the functions of controller, plant and closed loop as CasADi files, with the names of all variables.

    Examples:
        dualwinch export casadi --case 4 --out functions
    """
    from dualwinch.export import export_casadi as run

    wrote_to(out, run(given.exported(), out))
