"""``dualwinch export fmu``: controller, plant or closed loop as a Functional Mock-up Unit."""

from dataclasses import replace
from os import PathLike
from pathlib import Path

from dualwinch.codegen.export.package import frozen
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
from dualwinch.commands.export import provenance, symbol
from dualwinch.commands.folders import check_folder
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.blocks import block
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.progress import Progress, no_progress

SAMPLE_TIME = "simulation.sample_time"
"""A constant of every FMU: FMI has no way to change it."""


def platforms_of(text: str | None) -> tuple[Platform, ...]:
    """The platforms of a list with commas; default: this machine's own.

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
            raise ConfigurationError(
                f"--platforms: unknown platform '{name}'; must be all or some of {', '.join(PLATFORMS)}"
            )
        found[platform.name] = platform
    return tuple(found.values())


def export_fmu(
    experiment: Experiment,
    out: str | PathLike[str],
    *,
    what: str = "controller",
    fmi: Version = 2,
    kind: Kind | None = None,
    platforms: str | None = None,
    progress: Progress = no_progress,
) -> str:
    """Write an FMU. Everything that can be wrong with the request is found before anything is compiled.

    Args:
        experiment: structure and values.
        out: the file, ``.fmu``.
        what: ``controller``, ``plant`` or ``closed-loop``.
        fmi: version, 2 or 3.
        kind: which interfaces; default: all there can be.
        platforms: names with commas, or ``all``; default: this machine's.
        progress: receives the fraction of the platforms that are done, and what is being compiled.

    Returns:
        What was written, in words.

    Raises:
        ConfigurationError: an unknown block or platform, an interface that the block cannot have, or a file that
            cannot be written.
        DualwinchError: no compiler for a platform.
    """
    out = Path(out)
    if out.suffix.lower() != ".fmu":
        raise ConfigurationError(f"{out.name}: the name of an FMU must end with .fmu")
    check_folder(out.parent)
    targets = platforms_of(platforms)
    made = block(what, experiment)
    if kind not in {None, "co-simulation"} and made.derivative is None:
        raise ConfigurationError(f"--kind {kind}: the {what} is sampled; only the plant can be model-exchange or both")
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
