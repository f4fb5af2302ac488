"""``dualwinch export``: controller, plant and closed loop as files for other people's tools."""

import hashlib
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path

from dualwinch import __version__
from dualwinch.codegen.block import Block
from dualwinch.codegen.export.casadi_files import casadi_files
from dualwinch.codegen.export.mex import mex_files
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.codegen.files import atomic
from dualwinch.commands.folders import make_folder
from dualwinch.config.experiment_file import to_toml
from dualwinch.simulation.blocks import BLOCKS, block
from dualwinch.simulation.exogenous.signals import asked_motion
from dualwinch.simulation.experiment import Experiment


def provenance(experiment: Experiment) -> Provenance:
    """Where an export of an experiment comes from; the date is that of ``SOURCE_DATE_EPOCH`` where it is set."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdecimal() else datetime.now(UTC)
    digest = hashlib.sha256(to_toml(experiment).encode()).hexdigest()[:16]
    return Provenance(f"dualwinch {__version__}", f"sha256:{digest}", f"{now:%Y-%m-%d}")


def symbol(made: Block) -> str:
    """What every C symbol of a block begins with."""
    return f"dualwinch_{made.name}"


def write(files: Mapping[str, str | bytes], folder: str | PathLike[str]) -> list[Path]:
    """Write files to a folder, made where there is none; their paths.

    Raises:
        ConfigurationError: the folder cannot be made or written to.
    """
    folder = Path(folder)
    make_folder(folder)
    for name, content in files.items():
        with atomic(folder / name) as unfinished:
            unfinished.write_bytes(content.encode() if isinstance(content, str) else content)
    return [folder / name for name in files]


def export_c(
    experiment: Experiment,
    out: str | PathLike[str],
    *,
    what: str = "controller",
    precision: str = "double",
    freeze: bool = False,
) -> list[Path]:
    """Write a block as a C99 package: source, header, CMake file, README and an example.

    Args:
        experiment: structure and values.
        out: folder, made where there is none.
        what: ``controller``, ``plant`` or ``closed-loop``.
        precision: ``double`` or ``float``, of every number.
        freeze: write the parameters as constants instead of an argument.

    Returns:
        The files.

    Raises:
        ConfigurationError: an unknown block, or a folder that cannot be written to.
    """
    made = block(what, experiment)
    return write(c_package(made, symbol(made), provenance(experiment), precision, freeze=freeze), out)


def export_casadi(experiment: Experiment, out: str | PathLike[str]) -> list[Path]:
    """Write the functions of every block as CasADi's own files, with a table of names.

    Args:
        experiment: structure and values.
        out: folder, made where there is none.

    Returns:
        The files.
    """
    return write(casadi_files([block(what, experiment) for what in BLOCKS], provenance(experiment)), out)


def export_mex(experiment: Experiment, out: str | PathLike[str]) -> list[Path]:
    """Write plant and controller as MEX sources, with a closed loop in the MATLAB language.

    Args:
        experiment: structure and values; its reference is that of the closed loop.
        out: folder, made where there is none.

    Returns:
        The files.
    """
    controller, plant = block("controller", experiment), block("plant", experiment)
    reference = asked_motion(experiment)
    return write(mex_files(plant, controller, symbol, reference, provenance(experiment)), out)
