"""The command ``race``: every law tuned on one budget, as table, JSON, figures, report and configurations.

The benchmark itself is the function ``dualwinch.race``.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dualwinch.cli.options import (
    Assignments,
    ExperimentOptions,
    Plugins,
    Whole,
    WorkerOptions,
    choice,
    default_of,
    note_other_machine,
    note_papers_machine,
    own_default,
    stated,
    use_parts,
)
from dualwinch.cli.output import if_interrupted, json_text, terminal, version_notes, versions
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.toolboxes.race.result import BenchmarkResult
    from dualwinch.toolboxes.race.scores import EntryResult

OR_ALL = ", or all; may be repeated. Default: the ensemble's, as in `dualwinch tune`"
"""End of a help text."""


def race(
    *,
    ensemble: Annotated[str | None, default_of("race", "ensemble")] = None,
    law: Annotated[list[str] | None, Parameter(help=choice("position law", "; may be repeated. Default: all"))] = None,
    estimator: Annotated[list[str] | None, Parameter(help=choice("estimator", OR_ALL))] = None,
    coordination: Annotated[list[str] | None, Parameter(help=choice("coordination", OR_ALL))] = None,
    ablations: bool = False,
    plugin: Plugins = None,
    config: Path | None = None,
    rollouts: Annotated[Whole, default_of("race", "rollouts")] = None,
    searches: Annotated[Whole, default_of("race", "searches")] = None,
    scenarios: Annotated[Whole, default_of("tuning.selection_config:SCENARIOS")] = None,
    test_scenarios: Annotated[Whole, default_of("race", "test_scenarios")] = None,
    set_: Assignments = None,
    constraint: list[str] | None = None,
    method: str | None = None,
    seed: Annotated[Whole, default_of("race", "seed")] = None,
    stress: bool = False,
    out: Path = Path("race"),
    where: WorkerOptions = WorkerOptions(),
) -> None:
    """Tune every law with the same number of rollouts, and score all of them in the same test set.

    All entries have the same seeds, constraints and scenarios; errors are compared scenario by scenario with those of
    the paper's gains, and a fixed rule decides which laws differ. Ctrl-C keeps finished entries: the same call
    continues with the rest, and a call with other laws adds them. The folder receives race.json, report.html, figures,
    and the gains of each entry as a configuration.

    Args:
        ensemble: Ensemble of scenarios: `rig`, `sea`, `site`, or a TOML file.
        ablations: Include the paper's law without each of its parts.
        config: Machine to race on, TOML: values missing from the ensemble's file.
        rollouts: Rollouts of each search.
        searches: Searches per entry, each with its own seed; several show their spread.
        scenarios: Scenarios of the training set, in which a candidate is tried.
        test_scenarios: Scenarios of the test set, which decide the scores.
        constraint: As in `dualwinch tune`, for all entries; may be repeated; none: no constraint.
        method: Optimiser, as in `dualwinch tune`.
        seed: Seed of all scenarios and searches.
        stress: Also find which imperfection breaks the best gains of each entry first (`dualwinch stress`).
        out: Folder of the race, from which it can be continued.

    Examples:
        dualwinch race --ensemble rig --out race
        dualwinch race --ensemble sea --law fando-nftsm --law adrc --rollouts 5000
        dualwinch race --law fando-nftsm --estimator all --coordination all
        dualwinch race --ablations --searches 3 --rollouts 10000 --stress
        dualwinch race --plugin my_law.py --law my-law --law adrc
        dualwinch race --config mine.toml --ensemble rig --out race
        dualwinch race --searches 5 --cluster tcp://scheduler:8786
    """
    from dualwinch.config.ensemble_file import load_ensemble
    from dualwinch.config.experiment_file import load
    from dualwinch.config.folders import made_folder
    from dualwinch.toolboxes.race.race import race

    use_parts(plugin)
    name = own_default("race", "ensemble") if ensemble is None else ensemble
    drawn = load_ensemble(name, load(config) if config else None)
    note_other_machine(config, name, drawn)
    note_papers_machine(ExperimentOptions(config=config, set_=set_), name, drawn)
    with (
        made_folder(out),
        ProgressLine("reading the problem", command="race") as progress,
        where.workers(progress) as workers,
        if_interrupted(GO_ON),
    ):
        found = race(
            ensemble=drawn,
            laws=law,
            estimators=estimator,
            coordinations=coordination,
            ablations=ablations,
            settings=set_ or [],
            constraints=constraint,
            method=method,
            stress=stress,
            out=out,
            workers=workers,
            progress=progress,
            **stated(
                rollouts=rollouts, searches=searches, test_scenarios=test_scenarios, scenarios=scenarios, seed=seed
            ),
        )
        progress(1.0, "writing the report")
        written = write_race(out, found)
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    progress.say(f"wrote {', '.join(written)} in {out}")
    if found.remaining:
        raise KeyboardInterrupt(GO_ON)


GO_ON = "the same call goes on with the entries that are not finished"
"""What the message of an interrupt says."""

GAINS = "gains"
"""Folder of the configurations."""


def write_race(out: Path, found: BenchmarkResult) -> list[str]:
    """Write ``race.json``, ``race.svg``, ``fronts.svg``, ``report.html``, and the gains of each entry.

    Returns:
        Names of the files that were written.
    """
    from dualwinch.codegen.files import write_whole
    from dualwinch.config.folders import make_folder
    from dualwinch.reports.tuning import write_race_report
    from dualwinch.simulation.plots.page import save

    write_whole(out / "race.json", json_text(to_record(found)))
    save(found.plot(), out / "race.svg")
    save(found.plot_fronts(), out / "fronts.svg")
    write_race_report(out / "report.html", found, versions())
    make_folder(out / GAINS)
    for scored in found.entries:
        if text := configuration(found, scored):
            write_whole(out / GAINS / f"{scored.entry.stem}.toml", text)
    return ["race.json", "race.svg", "fronts.svg", "report.html", f"{GAINS}/"]


def to_record(found: BenchmarkResult) -> dict[str, Any]:
    """The result as plain data with units, including the quantities that are printed (RMS errors, ratios)."""
    from dualwinch.analysis.idealisations import idealisations
    from dualwinch.config.ensemble_file import loads_ensemble
    from dualwinch.simulation.metrics.metrics import metric_quantities

    record = found.to_dict()
    for runs in (record["paper"], *record["entries"]):
        runs["rms_error"] = math.sqrt(runs["statistics"]["mean.mse"] or math.nan)
    for entry in record["entries"]:
        for ratio in (entry["over_paper"], *entry["searches"]):
            ends = zip(("estimate", "low", "high"), ("estimate", "high", "low"), strict=True)
            ratio["times_below"] = {name: 1 / ratio[end] if ratio[end] else None for name, end in ends}
    bounds = record["lower_bounds"]
    bounds |= {f"rms_{name}": math.sqrt(bounds[name]) for name in ("without_foresight", "with_foresight")}
    metrics = {name: quantity.unit for name, quantity in metric_quantities().items()}
    units = {"statistics": metrics, "lower_bounds": "m^2", "over_paper": "1", "times_below": "1", "seconds": "s"}
    rms = dict.fromkeys(("rms_error", "rms_without_foresight", "rms_with_foresight"), "m")
    left_out = idealisations(loads_ensemble(found.terms.configuration).experiment)
    facts = {"idealisations": [asdict(one) for one in left_out], "units": units | rms}
    return {**record, **facts, **version_notes()}


def configuration(found: BenchmarkResult, scored: EntryResult) -> str:
    """The best gains of an entry as TOML; empty if its parts are not registered, as those of an earlier call may be."""
    from dualwinch.codegen.text import one_line
    from dualwinch.config.ensemble_file import TUNED_IN, loads_ensemble
    from dualwinch.config.experiment_file import to_toml
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.settings import override

    nominal = loads_ensemble(found.terms.configuration, name="the race's ensemble").experiment
    try:
        best = override(nominal, {**scored.entry.values, **scored.gains})
    except ConfigurationError:
        return ""
    terms = found.terms
    words = f"{scored.entry.key}: the best of {terms.rollouts} rollouts in '{terms.ensemble}', seed {terms.seed}"
    return f"# {words}, by `dualwinch race`.\n# {TUNED_IN}: {one_line(terms.ensemble)}\n\n{to_toml(best)}"
