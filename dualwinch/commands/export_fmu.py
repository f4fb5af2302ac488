"""``dualwinch export fmu``: controller, plant or closed loop as a Functional Mock-up Unit."""

from dataclasses import replace
from pathlib import Path

from rich.console import Console

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
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.blocks import block

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
    experiment: Experiment, what: str, out: Path, fmi: Version, kind: Kind | None, platforms: str | None
) -> None:
    """Write an FMU. Everything that can be wrong with the request is found before anything is compiled.

    Args:
        experiment: structure and values.
        what: ``controller``, ``plant`` or ``closed-loop``.
        out: the file, ``.fmu``.
        fmi: version, 2 or 3.
        kind: which interfaces; default: all there can be.
        platforms: names with commas, or ``all``; default: this machine's.
    """
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
    console = Console(stderr=True)
    with console.status("generating") as status:
        files = build_fmu(
            model,
            targets,
            about,
            lambda name: status.update(f"compiling for {name} (the first time for a platform takes up to a minute)"),
        )
        with atomic(out) as unfinished:
            unfinished.write_bytes(archive(files))
    interfaces = "co-simulation and model exchange" if model.kind == "both" else model.kind
    binaries = ", ".join(target.name for target in targets) or "no binaries"
    console.print(f"wrote {out}: FMI {fmi}.0, {interfaces}, {binaries}, sources", soft_wrap=True)
