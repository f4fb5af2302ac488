"""The command ``export`` and its subcommands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from dualwinch import __version__
from dualwinch.cli.options import ExperimentOptions, Whole, default_of, own_default, stated
from dualwinch.cli.output import print_note, wrote

if TYPE_CHECKING:
    from dualwinch.simulation.blocks import BlockName
    from dualwinch.simulation.experiment import Experiment

export = App(
    name="export",
    help="""Write controller, plant and closed loop as code for other tools.

The code is generated from the functions that `dualwinch simulate` runs, with the values of an experiment.
""",
    help_format="plaintext",
    version=__version__,
)

Block = Literal["controller", "plant", "closed-loop"]
Out = Annotated[Path, Parameter(help="Folder for the files; made if missing.")]


def chosen_from(given: ExperimentOptions, block: str | None = None) -> Experiment:
    """The experiment; print a note where its controller, made for another machine, makes the loop unstable."""
    from dualwinch.analysis.remarks import in_full, loop_remarks
    from dualwinch.simulation.experiment import Experiment

    found = given.experiment()
    if block != "plant" and found.plant != Experiment().plant:
        for words in loop_remarks(found):
            print_note(in_full(words, given.typed), stderr=True)
    return found


def wrote_to(folder: Path, files: list[Path]) -> None:
    """Print which files were written to a folder."""
    wrote(f"{folder}: {', '.join(path.name for path in files)}")


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

    experiment = chosen_from(given, block)
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


@export.command(name="st")
def export_st(
    *,
    out: Out,
    block: Annotated[Block | None, default_of("export_st", "block")] = None,
    precision: Annotated[Literal["double", "float"] | None, default_of("export_st", "precision")] = None,
    flavour: Annotated[
        Literal["iec", "codesys", "twincat", "siemens-scl"] | None, default_of("export_st", "flavour")
    ] = None,
    max_operations: Annotated[Whole, default_of("export_st", "max_operations")] = None,
    given: ExperimentOptions = ExperimentOptions(),
) -> None:
    """Write function blocks in Structured Text (IEC 61131-3) for PLCs, PLCopen XML, a README and an example program.

    It performs the operations of the C package in their order, with the experiment's parameters.

    Args:
        block: Block to export.
        precision: Of every number; double: LREAL, float: REAL.
        flavour: Dialect; iec: the standard's, with a configuration, for Beremiz and OpenPLC; twincat: files of a
            project; siemens-scl: external sources of TIA Portal.
        max_operations: Refuse a block with more operations per call; the README states their number.

    Examples:
        dualwinch export st --config tuned/best.toml --out plc
        dualwinch export st --flavour twincat --precision float --out plc
        dualwinch export st --set controller.kind=mpc --max-operations 2000 --out plc
    """
    from dualwinch.export import export_st as run
    from dualwinch.model.errors import ConfigurationError

    if max_operations is not None and max_operations < 1:
        raise ConfigurationError(f"--max-operations {max_operations}: must be >= 1")
    experiment = chosen_from(given, block)
    options = stated(block=block, precision=precision, flavour=flavour, max_operations=max_operations)
    wrote_to(out, run(experiment, out, **options))


@export.command(name="fmu")
def export_fmu(
    *,
    out: Path,
    block: Annotated[Block | None, default_of("export_fmu", "block")] = None,
    fmi: Annotated[Literal[2, 3] | None, default_of("export_fmu", "fmi")] = None,
    kind: Literal["co-simulation", "model-exchange", "both"] | None = None,
    platforms: str | None = None,
    given: ExperimentOptions = ExperimentOptions(),
) -> None:
    """Write a Functional Mock-up Unit: model description, C sources and binaries.

    Binaries for other platforms are compiled here by zig (`pip install 'dualwinch[zig]'`).

    Args:
        out: File to write, .fmu.
        block: Block to export.
        fmi: Version of FMI.
        kind: Interfaces (default: both for the plant, else co-simulation).
        platforms: Binaries to include, separated by commas: linux64, win64, darwin64, aarch64-linux, aarch64-darwin, or
            all (default: this machine's).

    Examples:
        dualwinch export fmu --block plant --case 4 --out plant.fmu
        dualwinch export fmu --block controller --fmi 3 --out controller.fmu
        dualwinch export fmu --block plant --kind model-exchange --platforms linux64,win64,darwin64 --out plant.fmu
    """
    from dualwinch.cli.progress import ProgressLine
    from dualwinch.export import export_fmu as run

    experiment = chosen_from(given, block)
    with ProgressLine("generating", command="export", patient=True) as progress:
        words = run(experiment, out, kind=kind, platforms=platforms, progress=progress, **stated(block=block, fmi=fmi))
    wrote(words)


@export.command(name="mex")
def export_mex(*, out: Out, given: ExperimentOptions = ExperimentOptions()) -> None:
    """Write plant and controller as MEX sources for MATLAB and GNU Octave, with a closed loop in their language.

    Examples:
        dualwinch export mex --case 4 --out mex
    """
    from dualwinch.export import export_mex as run

    wrote_to(out, run(chosen_from(given), out))


@export.command(name="casadi")
def export_casadi(*, out: Out, given: ExperimentOptions = ExperimentOptions()) -> None:
    """Write the functions of controller, plant and closed loop as CasADi files, with the names of all variables.

    Examples:
        dualwinch export casadi --case 4 --out functions
    """
    from dualwinch.export import export_casadi as run

    wrote_to(out, run(chosen_from(given), out))
