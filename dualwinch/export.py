"""Export of controller, plant and closed loop as files for other tools."""

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path

import casadi as ca

from dualwinch import __version__
from dualwinch.codegen.block import Block
from dualwinch.codegen.export.casadi import casadi_files, functions_of_blocks, generated_c, variables_of
from dualwinch.codegen.export.mex import mex_files
from dualwinch.codegen.export.package import Provenance, c_package, frozen
from dualwinch.codegen.export.structured_text import MAX_OPERATIONS, st_package
from dualwinch.codegen.files import atomic
from dualwinch.codegen.fmu import (
    PLATFORMS,
    About,
    Kind,
    Platform,
    Version,
    archive,
    build_fmu,
    find_platform,
    fmu_model,
)
from dualwinch.codegen.fmu import host_platform as host
from dualwinch.config.experiment_file import to_toml
from dualwinch.config.folders import check_place, make_folder
from dualwinch.model.arguments import instance, path_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import unknown
from dualwinch.simulation.blocks import BLOCKS, BlockName
from dualwinch.simulation.blocks import block as block_of
from dualwinch.simulation.exogenous.signals import asked_motion
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.progress import PhaseProgress, no_progress
from dualwinch.simulation.server.registers import udp_client


def provenance(experiment: Experiment) -> Provenance:
    """Version, configuration digest and date of an export; the date is ``SOURCE_DATE_EPOCH``'s if that is set."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdecimal() else datetime.now(UTC)
    digest = hashlib.sha256(to_toml(experiment).encode()).hexdigest()[:16]
    return Provenance(f"dualwinch {__version__}", f"sha256:{digest}", f"{now:%Y-%m-%d}")


def symbol(made: Block) -> str:
    """Prefix of every C symbol of a block."""
    return f"dualwinch_{made.name}"


def write(files: Mapping[str, str | bytes], folder: str | PathLike[str]) -> list[Path]:
    """Write files to a folder, made if missing, and return their paths.

    Raises:
        ConfigurationError: the folder cannot be made or written to, or has a folder with the name of a file; nothing
            is written.
    """
    folder = path_of("folder", folder)
    make_folder(folder)
    for name in files:
        check_place(folder / name)
    for name, content in files.items():
        with atomic(folder / name) as unfinished:
            unfinished.write_bytes(content.encode() if isinstance(content, str) else content)
    return [folder / name for name in files]


def export_c(
    experiment: Experiment,
    out: str | PathLike[str],
    *,
    block: str = "controller",
    precision: str = "double",
    freeze: bool = False,
    udp: bool = False,
) -> list[Path]:
    """Write a block as a C99 package: source, header, CMake file, README and an example.

    Args:
        experiment: structure and values.
        out: folder, made if missing.
        block: ``controller``, ``plant`` or ``closed-loop``.
        precision: ``double`` or ``float``, of every number.
        freeze: write the parameters as constants instead of an argument.
        udp: for a controller, also write a program that connects it to ``dualwinch serve``: ``udp.c``.

    Returns:
        The files.

    Raises:
        ConfigurationError: an unknown block, `udp` without a controller, or a folder that cannot be written to.
        CodegenError: a controller with inputs that a served plant does not send.
    """
    made, origin = block_of(block, experiment), provenance(experiment)
    files = c_package(made, symbol(made), origin, precision, freeze=freeze)
    if udp:
        if block != "controller":
            raise ConfigurationError(f"udp: must be off for the {block}; only a controller can be connected")
        files["udp.c"] = udp_client(frozen(made) if freeze else made, symbol(made), origin)
    return write(files, out)


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
    """
    made, about = block_of(block, experiment), provenance(experiment)
    files = st_package(made, symbol(made), about, precision, flavour=flavour, max_operations=max_operations)
    return write(files, out)


def generate_c(
    source: Experiment | ca.Function,
    folder: str | PathLike[str],
    *,
    blocks: Sequence[BlockName] = BLOCKS,
    header: bool = True,
    main: bool = False,
    mex: bool = False,
) -> list[Path]:
    """Generate C with CasADi's own code generator, ready for ``casadi.external``.

    For an experiment: ``dualwinch.c`` with ``controller_step``, ``plant_step``, ``closed_loop_step``, each block's
    ``initial`` and, where it has them, ``output`` and ``derivative``, and ``variables.json``, which names the elements
    of every vector. For a function ``f``: ``f.c``.

    Args:
        source: an experiment, or any CasADi function.
        folder: for the files; made if missing.
        blocks: parts of an experiment.
        header: CasADi's option: a header file, too.
        main: CasADi's option: a ``main`` that reads arguments from a file.
        mex: CasADi's option: a gateway for MATLAB and Octave.

    Returns:
        The files.

    Raises:
        CodegenError: CasADi generates no C for the function.
        ConfigurationError: an unknown block, or a folder that cannot be written to.
    """
    instance("source", source, Experiment, ca.Function)
    if isinstance(source, ca.Function):
        files = generated_c({source.name(): source}, source.name(), header=header, main=main, mex=mex)
    else:
        made = [block_of(name, source) for name in blocks]
        files = generated_c(functions_of_blocks(made), "dualwinch", header=header, main=main, mex=mex)
        files |= {"variables.json": variables_of(made)}
    return write(files, folder)


def export_casadi(experiment: Experiment, out: str | PathLike[str]) -> list[Path]:
    """Write the functions of every block as CasADi's own files, with a table of names.

    Args:
        experiment: structure and values.
        out: folder, made if missing.

    Returns:
        The files.
    """
    return write(casadi_files([block_of(name, experiment) for name in BLOCKS], provenance(experiment)), out)


def export_mex(experiment: Experiment, out: str | PathLike[str]) -> list[Path]:
    """Write plant and controller as MEX sources, with a closed loop in the MATLAB language.

    Args:
        experiment: structure and values; its reference is that of the closed loop.
        out: folder, made if missing.

    Returns:
        The files.
    """
    controller, plant = block_of("controller", experiment), block_of("plant", experiment)
    reference = asked_motion(experiment)
    return write(mex_files(plant, controller, symbol, reference, provenance(experiment)), out)


SAMPLE_TIME = "simulation.sample_time"
"""A constant in every FMU, as FMI has no way to change it."""


def platforms_of(text: str | None) -> tuple[Platform, ...]:
    """Parse a list of platforms, separated by commas; None: this machine's own.

    Raises:
        ConfigurationError: an unknown platform.
    """
    if text is None:
        return (host(),)
    if text == "all":
        return tuple(PLATFORMS.values())
    found: dict[str, Platform] = {}
    for name in filter(None, map(str.strip, text.split(","))):
        platform = find_platform(name)
        if platform is None:
            raise ConfigurationError(f"--platforms: {unknown('platform', name, PLATFORMS, ', or all')}")
        found[platform.name] = platform
    return tuple(found.values())


def export_fmu(
    experiment: Experiment,
    out: str | PathLike[str],
    *,
    block: str = "controller",
    fmi: Version = 2,
    kind: Kind | None = None,
    platforms: str | None = None,
    progress: PhaseProgress = no_progress,
) -> str:
    """Write an FMU; the request is checked before anything is compiled.

    Args:
        experiment: structure and values.
        out: the file, ``.fmu``.
        block: ``controller``, ``plant`` or ``closed-loop``.
        fmi: version, 2 or 3.
        kind: interfaces; default: all that the block can have.
        platforms: names separated by commas, or ``all``; default: this machine's.
        progress: receives the fraction of finished platforms, and the platform being compiled.

    Returns:
        A summary of the file in words.

    Raises:
        ConfigurationError: an unknown block or platform, an interface that the block cannot have, or a file that
            cannot be written.
        DualwinchError: no compiler for a platform.
    """
    out = path_of("out", out)
    if out.suffix.lower() != ".fmu":
        raise ConfigurationError(f"{out.name}: the name of an FMU must end with .fmu")
    check_place(out)
    targets = platforms_of(platforms)
    made = block_of(block, experiment)
    if kind not in {None, "co-simulation"} and made.derivative is None:
        raise ConfigurationError(f"--kind {kind}: the {block} is sampled; only the plant can be model-exchange or both")
    model = fmu_model(replace(frozen(made, {SAMPLE_TIME}), name=symbol(made)), fmi, kind)
    origin = provenance(experiment)
    about = About(origin.product, experiment.duration, f"configuration {origin.configuration}")
    files = build_fmu(
        model,
        targets,
        about,
        lambda name: progress(
            [target.name for target in targets].index(name) / len(targets),
            f"compiling for {name} (the first time for a platform takes up to a minute)",
        ),
    )
    with atomic(out) as unfinished:
        unfinished.write_bytes(archive(files))
    interfaces = "co-simulation and model exchange" if model.kind == "both" else model.kind
    binaries = ", ".join(target.name for target in targets) or "no binaries"
    return f"{out}: FMI {fmi}.0, {interfaces}, {binaries}, sources"
