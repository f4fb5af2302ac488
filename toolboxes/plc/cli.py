"""The command ``export st``."""

from __future__ import annotations

from typing import Annotated, Literal

from dualwinch.toolbox import options, output


def export_st(
    *,
    out: options.Out,
    block: Annotated[options.Block | None, options.default_of("export_st", "block")] = None,
    precision: Annotated[Literal["double", "float"] | None, options.default_of("export_st", "precision")] = None,
    flavour: Annotated[
        Literal["iec", "codesys", "twincat", "siemens-scl"] | None, options.default_of("export_st", "flavour")
    ] = None,
    max_operations: Annotated[options.Whole, options.default_of("export_st", "max_operations")] = None,
    given: options.ExperimentOptions = options.ExperimentOptions(),
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
    from dualwinch.toolbox import ConfigurationError
    from dualwinch.toolboxes.plc.export import export_st as run

    if max_operations is not None and max_operations < 1:
        raise ConfigurationError(f"--max-operations {max_operations}: must be >= 1")
    experiment = given.exported(block)
    choices = options.stated(block=block, precision=precision, flavour=flavour, max_operations=max_operations)
    output.wrote_to(out, run(experiment, out, **choices))
