"""Export of an experiment's blocks as Functional Mock-up Units."""

from dataclasses import replace
from os import PathLike

from dualwinch.toolbox import (
    ConfigurationError,
    Experiment,
    arguments,
    export,
    folders,
    package,
    progresses,
    quantities,
    whole_files,
)
from dualwinch.toolbox import block as block_of
from dualwinch.toolboxes.fmu.build import PLATFORMS, Platform, archive, build_fmu, find_platform, host_platform
from dualwinch.toolboxes.fmu.description import About
from dualwinch.toolboxes.fmu.model import Kind, Version, fmu_model

SAMPLE_TIME = "simulation.sample_time"
"""A constant in every FMU, as FMI has no way to change it."""


def platforms_of(text: str | None) -> tuple[Platform, ...]:
    """Parse a list of platforms, separated by commas; None: this machine's own.

    Raises:
        ConfigurationError: an unknown platform.
    """
    if text is None:
        return (host_platform(),)
    if text == "all":
        return tuple(PLATFORMS.values())
    targets: dict[str, Platform] = {}
    for name in filter(None, map(str.strip, text.split(","))):
        platform = find_platform(name)
        if platform is None:
            raise ConfigurationError(f"--platforms: {quantities.unknown('platform', name, PLATFORMS, ', or all')}")
        targets[platform.name] = platform
    return tuple(targets.values())


def export_fmu(
    experiment: Experiment,
    out: str | PathLike[str],
    *,
    block: str = "controller",
    fmi: Version = 2,
    kind: Kind | None = None,
    platforms: str | None = None,
    progress: progresses.PhaseProgress = progresses.no_progress,
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

    Example:
        >>> import dualwinch as dw
        >>> _ = dw.export_fmu(dw.case(4), "controller.fmu", fmi=3)
    """
    out = arguments.path_of("out", out)
    if out.suffix.lower() != ".fmu":
        raise ConfigurationError(f"{out.name}: the name of an FMU must end with .fmu")
    folders.check_place(out)
    targets = platforms_of(platforms)
    exported = block_of(block, experiment)
    if kind not in {None, "co-simulation"} and exported.derivative is None:
        raise ConfigurationError(f"--kind {kind}: the {block} is sampled; only the plant can be model-exchange or both")
    model = fmu_model(replace(package.frozen(exported, {SAMPLE_TIME}), name=export.symbol(exported)), fmi, kind)
    origin = export.provenance(experiment)
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
    with whole_files.atomic(out) as unfinished:
        unfinished.write_bytes(archive(files))
    interfaces = "co-simulation and model exchange" if model.kind == "both" else model.kind
    binaries = ", ".join(target.name for target in targets) or "no binaries"
    return f"{out}: FMI {fmi}.0, {interfaces}, {binaries}, sources"
