"""Export of an experiment's blocks as Structured Text."""

from os import PathLike
from pathlib import Path

from dualwinch.toolbox import Experiment, export
from dualwinch.toolbox import block as block_of
from dualwinch.toolboxes.plc.structured_text import MAX_OPERATIONS, st_package


def export_st(
    experiment: Experiment,
    out: str | PathLike[str],
    *,
    block: str = "controller",
    precision: str = "double",
    flavour: str = "iec",
    max_operations: int = MAX_OPERATIONS,
) -> list[Path]:
    """Write a block in Structured Text (IEC 61131-3): function blocks, PLCopen XML, README and an example program.

    Args:
        experiment: structure and values.
        out: folder, made if missing.
        block: ``controller``, ``plant`` or ``closed-loop``.
        precision: ``double`` (LREAL) or ``float`` (REAL), of every number.
        flavour: ``iec``, ``codesys``, ``twincat`` or ``siemens-scl``.
        max_operations: largest number of operations of a call.

    Returns:
        The files.

    Raises:
        ConfigurationError: an unknown block, or a folder that cannot be written to.
        CodegenError: an unknown precision or flavour, too many operations, or an operation that Structured Text lacks.

    Example:
        >>> import dualwinch as dw
        >>> [path.name for path in dw.export_st(dw.case(4), "plc")]
        ['dualwinch_controller.st', 'main.st', 'dualwinch_controller.xml', 'README.md']
    """
    exported, about = block_of(block, experiment), export.provenance(experiment)
    files = st_package(
        exported, export.symbol(exported), about, precision, flavour=flavour, max_operations=max_operations
    )
    return export.write(files, out)
