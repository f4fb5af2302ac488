"""Options of ``dualwinch compare``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import WHOLE, Figure, Plugins, use_parts

app = App(
    name="compare",
    help_epilogue="""Examples:

    dualwinch compare paper best.toml
    dualwinch compare paper mine.toml --plugin my_law.py
    dualwinch compare paper best.toml calm.toml --scenarios 500 --seed 1 --out gains.json --plot gains.png
""",
)


@app.default
def compare(
    *files: Annotated[str, Parameter(help="TOML files of gains; `paper` means the paper's gains.")],
    ensemble: Annotated[str, Parameter(help="Ensemble of scenarios: `sea`, `rig`, or a TOML file.")] = "sea",
    scenarios: Annotated[int, WHOLE, Parameter(help="Scenarios, the same for every file.")] = 200,
    seed: Annotated[int, WHOLE, Parameter(help="Seed of the draws and of the intervals.")] = 0,
    config: Annotated[
        Path | None, Parameter(help="Experiment that supplies the values missing from the ensemble's file.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        Parameter(name="--set", help="key=value of the ensemble's nominal values; may be repeated.", negative=""),
    ] = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, Parameter(help="File for the statistics: .json.")] = None,
    plot: Figure = None,
) -> None:
    """Compare files of gains in the same scenarios, with confidence intervals on the ratios to the first.

    A file is an experiment as `dualwinch config` prints one, or a part of it. Its [controller] tables are compared:
    position law, gains, estimator, coordination and preload; missing keys keep their defaults. Plant, sea and sensors
    come from the ensemble alone.
    """
    from dualwinch.commands.compare import compare as run

    use_parts(plugin)
    run(
        files,
        ensemble_name=ensemble,
        config=config,
        assignments=set_ or [],
        scenarios=scenarios,
        seed=seed,
        out=out,
        plot=plot,
    )
