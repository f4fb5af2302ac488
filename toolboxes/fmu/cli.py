"""The command ``export fmu``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from dualwinch.toolbox import ProgressLine, options, output


def export_fmu(
    *,
    out: Path,
    block: Annotated[options.Block | None, options.default_of("export_fmu", "block")] = None,
    fmi: Annotated[Literal[2, 3] | None, options.default_of("export_fmu", "fmi")] = None,
    kind: Literal["co-simulation", "model-exchange", "both"] | None = None,
    platforms: str | None = None,
    given: options.ExperimentOptions = options.ExperimentOptions(),
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
    from dualwinch.toolboxes.fmu.export import export_fmu as run

    experiment = given.exported(block)
    with ProgressLine("generating", command="export", patient=True) as progress:
        words = run(
            experiment, out, kind=kind, platforms=platforms, progress=progress, **options.stated(block=block, fmi=fmi)
        )
    output.wrote(words)
