"""The command ``race``: every law tuned on one budget, as table, JSON, figures, report and configurations.

The benchmark itself is the function ``dualwinch.race``.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dualwinch.toolbox import ProgressLine, notes, options, output

if TYPE_CHECKING:
    from dualwinch.toolboxes.race.result import RaceResult
    from dualwinch.toolboxes.race.scores import EntryResult

OR_ALL = ", or all; may be repeated. Default: the ensemble's, as in `dualwinch tune`"
"""End of a help text."""


def race(
    *,
    ensemble: Annotated[str | None, options.default_of("race", "ensemble")] = None,
    law: Annotated[
        list[str] | None, Parameter(help=options.choice("position law", "; may be repeated. Default: all"))
    ] = None,
    estimator: Annotated[list[str] | None, Parameter(help=options.choice("estimator", OR_ALL))] = None,
    coordination: Annotated[list[str] | None, Parameter(help=options.choice("coordination", OR_ALL))] = None,
    ablations: bool = False,
    plugin: options.Plugins = None,
    config: Path | None = None,
    rollouts: Annotated[options.Whole, options.default_of("race", "rollouts")] = None,
    searches: Annotated[options.Whole, options.default_of("race", "searches")] = None,
    scenarios: Annotated[options.Whole, options.default_of(options.tuning_options, "draws")] = None,
    test_scenarios: Annotated[options.Whole, options.default_of("race", "test_scenarios")] = None,
    set_: options.Assignments = None,
    constraint: list[str] | None = None,
    method: str | None = None,
    seed: Annotated[options.Whole, options.default_of("race", "seed")] = None,
    stress: bool = False,
    out: Path = Path("race"),
    where: options.WorkerOptions = options.WorkerOptions(),
) -> None:
    """Tune every law with the same number of rollouts, and score all of them in the same test set.

    All entries have the same seeds, constraints and scenarios; errors are compared scenario by scenario with those of
    the paper's gains, and a fixed rule decides which laws differ. Ctrl-C keeps finished entries: the same call
    continues with the rest, and a call with other laws adds them to those of race.json. The folder receives race.json,
    report.html, figures, and the gains of each entry as a configuration.

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
    from dualwinch.toolbox import ensemble_file, experiment_file, folders
    from dualwinch.toolboxes.race.race import race

    options.use_parts(plugin)
    name = options.own_default("race", "ensemble") if ensemble is None else ensemble
    scenes = ensemble_file.load_ensemble(name, experiment_file.load(config) if config else None)
    assigned = options.ExperimentOptions(set_=set_).values
    output.note(*notes.of_machine(name, scenes, config, assigned=assigned))
    with (
        folders.made_folder(out),
        ProgressLine("reading the problem", command="race") as progress,
        where.workers(progress) as workers,
        output.if_interrupted(GO_ON),
    ):
        result = race(
            ensemble=scenes,
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
            **options.stated(
                rollouts=rollouts, searches=searches, test_scenarios=test_scenarios, scenarios=scenarios, seed=seed
            ),
        )
        progress(1.0, "writing the report")
        written = write_race(out, result)
    output.terminal(soft_wrap=True).print(repr(result), highlight=False)
    progress.say(f"wrote {', '.join(written)} in {out}")
    if result.remaining:
        raise KeyboardInterrupt(GO_ON)


GO_ON = "the same call goes on with the entries that are not finished"
"""What the message of an interrupt says."""

GAINS = "gains"
"""Folder of the configurations."""


def write_race(out: Path, result: RaceResult) -> list[str]:
    """Write ``race.json``, ``race.svg``, ``fronts.svg``, ``report.html``, and the gains of each entry.

    Returns:
        Names of the files that were written.
    """
    from dualwinch.toolbox import drawing, folders, whole_files
    from dualwinch.toolboxes.race.report import write_race_report

    whole_files.write_whole(out / "race.json", output.json_text(to_record(result)))
    drawing.save(result.plot(), out / "race.svg")
    drawing.save(result.plot_fronts(), out / "fronts.svg")
    write_race_report(out / "report.html", result, output.versions())
    folders.make_folder(out / GAINS)
    for scored in result.entries:
        whole_files.write_whole(out / GAINS / f"{scored.entry.stem}.toml", configuration(result, scored))
    return ["race.json", "race.svg", "fronts.svg", "report.html", f"{GAINS}/"]


def to_record(result: RaceResult) -> dict[str, Any]:
    """The result as plain data, with what its machine leaves out and the versions."""
    from dualwinch.toolbox import ensemble_file, idealisations

    experiment = ensemble_file.loads_ensemble(result.terms.configuration).experiment
    simplifications = list(map(asdict, idealisations.idealisations(experiment)))
    return {**result.to_record(), "idealisations": simplifications, **output.version_notes()}


def configuration(result: RaceResult, scored: EntryResult) -> str:
    """The best gains of an entry as TOML."""
    from dualwinch.toolbox import ensemble_file, experiment_file, settings, texts

    nominal = ensemble_file.loads_ensemble(result.terms.configuration, name="the race's ensemble").experiment
    best = settings.override(nominal, {**scored.entry.values, **scored.gains})
    terms = result.terms
    words = f"{scored.entry.key}: the best of {terms.rollouts} rollouts in '{terms.ensemble}', seed {terms.seed}"
    scenes = f"{ensemble_file.TUNED_IN}: {texts.one_line(terms.ensemble)}"
    return f"# {words}, by `dualwinch race`.\n# {scenes}\n\n{experiment_file.to_toml(best)}"
