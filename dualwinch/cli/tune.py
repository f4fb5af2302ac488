"""The command ``tune``: a study from options, its result as files and a few printed lines."""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.text import Text

from dualwinch import __version__
from dualwinch.cli.notes import of_machine
from dualwinch.cli.options import (
    WHOLE,
    ExperimentOptions,
    Whole,
    WorkerOptions,
    default_of,
    own_default,
    seconds_from,
    share_from,
    tuning_options,
    use_parts,
)
from dualwinch.cli.output import (
    NOTES,
    if_interrupted,
    note,
    print_figures,
    print_idealisations,
    print_remarks,
    styled,
    terminal,
    versions,
)
from dualwinch.cli.progress import ProgressLine
from dualwinch.extensions import COMMANDS, FUNCTIONS, extension
from dualwinch.model.quantities.figures import FigureColumn, FigureTable

if TYPE_CHECKING:
    from dualwinch.tuning.problem import TuningProblem
    from dualwinch.tuning.result import TuningResult

METHODS = "cmaes, tpe, gp, nsga2, nsga3, qmc, random"
"""Names of `tuning.optimisers.METHODS`, repeated so that help does not import them."""


def default_trials() -> int:
    """The default number of trials, imported for the help alone."""
    from dualwinch.tuning.options import TRIALS

    return TRIALS


def usual_methods(_: object) -> str:
    """The default methods for one and for several objectives, for help."""
    from dualwinch.tuning.options import default_method

    return f"{default_method(1)}; of several objectives {default_method(2)}"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """Options of a study: method, budget and storage.

    Attributes:
        trials: Trials of the search.
        time: Time of the search, e.g. 60s, 5min; the command ends within 1.3 times that + 10 s.
        rollouts: Rollouts of the search: the same budget for slow laws and fast ones.
        storage: Journal file; or URL of a database, such as postgresql+psycopg://USER@HOST/DATABASE, in which the same
            call joins the study from any number of processes and machines, each with its own budget.
        study: Name of the study.
        resume: Continue a study: the trials that it has count in the budget.
        out: Folder for best.toml and study.json.
        stress: Afterwards find which imperfection breaks the best gains first (`dualwinch stress`).
    """

    method: Annotated[str | None, Parameter(help=f"Optimiser: {METHODS}.", show_default=usual_methods)] = None
    trials: Annotated[
        Whole,
        default_of(default_trials, words="{}, or as many as the gains need, without --time and --rollouts"),
    ] = None
    time: str | None = None
    rollouts: Whole = None
    storage: Annotated[str | None, Parameter(env_var="DUALWINCH_STORAGE")] = None
    study: str = "tuning"
    resume: bool = False
    out: Path = Path("tuning-results")
    where: WorkerOptions = WorkerOptions()
    stress: Annotated[bool, Parameter(negative="--no-stress")] = False

    @property
    def seconds(self) -> float | None:
        """Wall time of the search in s; None: no limit."""
        return seconds_from(self.time)

    @property
    def kept_in(self) -> str:
        """File or URL of the study."""
        return str(self.storage or self.out / "study.journal")


def tune(
    *,
    given: ExperimentOptions = ExperimentOptions(),
    ensemble: str | None = None,
    scenarios: Annotated[Whole, default_of(tuning_options, "draws")] = None,
    space: list[str] | None = None,
    objective: list[str] | None = None,
    constraint: list[str] | None = None,
    violation: Annotated[str | None, default_of(tuning_options, "violation", "{:.1%}")] = None,
    confidence: Annotated[str | None, default_of(tuning_options, "confidence", "{:.0%}")] = None,
    seed: Annotated[int, WHOLE] = 0,
    options: StudyOptions = StudyOptions(),
) -> None:
    """Search for better gains, and score the best in a test set.

    The first trials are the paper's gains and the experiment's own. All candidates run in the same scenarios; Ctrl-C
    ends the search and keeps the best so far. If nothing is better than the start, the start is kept and remedies are
    listed. best.toml is a configuration: `dualwinch simulate --config best.toml`.

    Args:
        ensemble: Tune in scenarios of an ensemble: `sea`, `rig`, `site`, or a TOML file.
        scenarios: Scenarios of the ensemble in which each candidate is tried.
        space: Gain or table of gains, e.g. controller.nftsm.beta, with bounds `=0.005:5:log` to replace its own;
            controller.winch.* gives both winches the same gains; controller.nftsm.p/q=5/3,7/5; or a TOML file. May be
            repeated. Default: all gains in use.
        objective: mean, geomean (geometric mean: of the logarithms, so that few large errors count little), median, p95
            or worst of a metric, e.g. mean.mse; may be repeated: Pareto front. Default: mean.mse, or geomean.mse where
            overloads are drawn.
        constraint: e.g. worst.peak_tension<=6000, mean.chatter<=25%*paper, mean.saturated_share<=1%,
            worst.delay_margin>=5ms (gain, phase, disk likewise); may be repeated. Added to the defaults: no slack, no
            peak beyond tension_max, little chatter, and in an ensemble stability margins; none leaves these out.
        violation: Largest probability that a draw of the ensemble violates a bound, e.g. 1%.
        confidence: Confidence with which fresh draws must support that, e.g. 99%.
        seed: Seed of scenarios and optimiser.

    Examples:
        dualwinch tune --ensemble sea --time 60s
        dualwinch tune --case 4 --space controller.nftsm --space controller.observer.l0=1:50:log --trials 500
        dualwinch tune --plugin my_law.py --set controller.kind=my-law --space controller.my_law.k=0.1:10:log
        dualwinch tune --ensemble sea --objective mean.mse --objective mean.chatter --trials 2000 --out front
        dualwinch tune --ensemble sea --constraint "worst.peak_tension<=5500" --constraint "mean.chatter<=0.25*paper"
        dualwinch tune --ensemble sea --time 60s --stress --out tuned
        dualwinch tune --ensemble sea --constraint "worst.delay_margin>=5ms" --constraint "worst.gain_margin>=6dB"
        dualwinch tune --ensemble sea --time 10min --storage postgresql+psycopg://me@host/studies --study sea
        dualwinch tune --ensemble rig --trials 5000 --cluster tcp://scheduler:8786
    """
    began = perf_counter()
    with ProgressLine("reading the problem", command="tune") as line:
        check_options(options)
        from dualwinch.tuning.tuning_problem import check_words, tuning_problem

        for text in space or []:
            check_words(text)
        use_parts(given.plugin)
        machine = replace(given, plugin=[*(given.plugin or []), *recall_parts(options)])
        problem = tuning_problem(
            case=machine.case,
            config=machine.config,
            settings=machine.assignments,
            ensemble=ensemble,
            space=space or [],
            objectives=objective or [],
            constraints=constraint,
            scenarios=scenarios,
            seed=seed,
            violation=share_from(violation, "--violation", own_default(tuning_options, "violation")),
            confidence=share_from(confidence, "--confidence", own_default(tuning_options, "confidence")),
        )
        if problem.ensemble and ensemble:
            note(*of_machine(ensemble, problem.ensemble, machine.config, machine.case, machine.values))
        following = next_line(options.out / "best.toml", ensemble, machine)
        run_study(problem, options, line, machine.plugin, following, machine.config, began)
        if options.stress:
            stress_best(options.out, ensemble, seed, machine.plugin)
        line.say(f"next: {following}")


def stress_best(out: Path, ensemble: str | None, seed: int, plugins: list[str] | None) -> None:
    """Run the command ``stress`` on the best gains, with the ensemble that they were tuned in as the base."""
    stress = extension(COMMANDS, "stress", "--stress")
    base = "none" if ensemble is None else ensemble if ensemble != own_default("stress", "ensemble") else None
    stress(out / "best.toml", base=base, seed=seed, out=out, given=ExperimentOptions(plugin=plugins))


def next_line(best: Path, ensemble: str | None, given: ExperimentOptions) -> str:
    """The command that evaluates the best gains on the machine they were tuned for."""
    if ensemble is None:
        return f"dualwinch simulate {ExperimentOptions(config=best, plugin=given.plugin).typed}"
    configured = best if given.config or given.case or given.assignments else None
    machine = ExperimentOptions(config=configured, plugin=given.plugin).typed
    return f"dualwinch compare paper {shlex.join([str(best), '--ensemble', ensemble])} {machine}".rstrip()


REPORT_SECONDS = 5.0
"""Time in s reserved for starting the program and writing files, report and figures."""

LEAST_SECONDS = 0.05
"""Shorter times in s are not printed among the cost of a study."""


def recall_parts(options: StudyOptions) -> list[str]:
    """With ``--resume``, register the parts that the study was begun with; return the files and modules imported.

    Raises:
        ConfigurationError: no such study, or a part that is missing or has changed.
        DualwinchError: the storage cannot be used.
    """
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.tuning.storage.connection import is_database, shown
    from dualwinch.tuning.storage.opening import stored_definition
    from dualwinch.tuning.storage.parts import StudyName, recall

    if not options.resume:
        return []
    definition = stored_definition(options.kept_in, options.study)
    in_database = is_database(options.kept_in)
    if definition is None:
        storage = shown(options.kept_in) if in_database else options.kept_in
        raise ConfigurationError(f"--resume: no study '{options.study}' in {storage}; begin it without --resume")
    name = StudyName(options.study, None if in_database else Path(options.kept_in))
    return recall(name, definition.get("parts", []))


def run_study(
    problem: TuningProblem,
    options: StudyOptions,
    line: ProgressLine,
    plugins: list[str] | None = None,
    following: str = "",
    config: Path | None = None,
    began: float | None = None,
) -> TuningResult:
    """Check the problem and files, then search, select, score, write and print.

    Printed commands about the best gains load the `plugins`; the report ends with the command `following`. Values that
    the experiment's file `config` marks as right are marked in the best gains' as well. `began` is when the command
    did, by `time.perf_counter`.

    Raises:
        KeyboardInterrupt: interrupted; the best so far is written.
    """
    from dualwinch.config.folders import made_folder
    from dualwinch.tuning.optimisers import check_method
    from dualwinch.tuning.options import default_method
    from dualwinch.tuning.scoring.budget import TIME_MORE, TIME_SHARE
    from dualwinch.tuning.scoring.progress import TuningProgress
    from dualwinch.tuning.storage.opening import open_store
    from dualwinch.tuning.tune import trials_of
    from dualwinch.tuning.tune import tune as run
    from dualwinch.tuning.tuning_problem import definition_of

    method, seconds = options.method or default_method(len(problem.objectives)), options.seconds
    trials = trials_of(problem, options.trials, seconds, options.rollouts)
    if options.stress:
        extension(FUNCTIONS, "check_stress", "--stress")(problem)
    check_method(method, len(problem.objectives))
    definition, out = definition_of(problem, method), options.out
    with made_folder(out):
        store = open_store(options.kept_in, options.study, problem, definition, resume=options.resume)
        with if_interrupted("the study is kept; the same call with --resume goes on"):
            with closing(store), options.where.workers(line) as workers:
                _announce(line, problem, method, options.kept_in, store.count())
                if seconds is not None:
                    line.say(
                        f"up to {seconds:g} s of search, after preparing and compiling; then certificate and scores: "
                        f"at most {(1 + TIME_SHARE) * seconds + TIME_MORE:.0f} s in all from the search's beginning"
                    )
                before = perf_counter()
                tuned = run(
                    problem,
                    method=method,
                    trials=trials,
                    seconds=seconds,
                    rollouts=options.rollouts,
                    workers=workers,
                    store=store,
                    reserved_seconds=REPORT_SECONDS,
                    watch=TuningProgress(line, problem.objectives),
                )
            line(1.0, "writing best.toml, study.json and report.html")
            reading = before - (before if began is None else began)
            writing = write(tuned, options, plugins or [], following, config, reading)
            line.stop()
            if tuned.interrupted:
                line.say("interrupted; this is the best so far")
            typed = ExperimentOptions(config=out / "best.toml", plugin=plugins).typed
            print_study(tuned, typed, reading, writing)
            line.say(f"wrote best.toml, study.json and report.html in {out}")
            if tuned.interrupted:
                raise KeyboardInterrupt
    return tuned


def seen_from(folder: Path, plugin: str) -> str:
    """How a command that is run in a folder names a plugin: the relative path of a file; a module as it is."""
    if not plugin.endswith(".py"):
        return plugin
    try:
        return os.path.relpath(plugin, folder)
    except ValueError:  # another drive
        return str(Path(plugin).absolute())


def write(
    tuned: TuningResult,
    options: StudyOptions,
    plugins: Sequence[str] = (),
    following: str = "",
    config: Path | None = None,
    reading: float = 0.0,
) -> float:
    """Write ``best.toml``, ``report.html`` and ``study.json``; further arguments as in `run_study`.

    `reading` the problem took this time in s. Returns the time of writing until `study.json`, which has both.
    """
    from dualwinch.codegen.text import one_line
    from dualwinch.config.ensemble_file import NO_ENSEMBLE, TUNED_IN
    from dualwinch.config.experiment_file import checked_keys, to_toml
    from dualwinch.config.folders import check_folder
    from dualwinch.reports.tuning import write_tuning_report
    from dualwinch.tuning.record import write_best, write_study
    from dualwinch.tuning.storage.connection import is_database, shown
    from dualwinch.tuning.storage.parts import in_words, part_records
    from dualwinch.tuning.tuning_problem import configuration

    began, problem, out, storage = perf_counter(), tuned.problem, options.out, options.kept_in
    facts: dict[str, Any] = {
        "code version": f"dualwinch {__version__}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seed": problem.seed,
        TUNED_IN: one_line(problem.ensemble.name) if problem.ensemble else NO_ENSEMBLE,
        "study": one_line(options.study),
        "storage": shown(storage) if is_database(storage) else one_line(storage),
        "method": tuned.method,
    }
    parts = part_records(problem)
    if parts:
        facts["parts"] = in_words(parts)
    check_folder(out)
    best = to_toml(tuned.best, checked=checked_keys(config) if config else ())
    here = ExperimentOptions(config=Path("best.toml"), plugin=[seen_from(out, plugin) for plugin in plugins]).typed
    write_best(out / "best.toml", tuned, best, facts, here)
    named = {name.replace(" ", "_"): value for name, value in facts.items()} | {"versions": versions()}
    write_tuning_report(out / "report.html", tuned, {**facts, **versions()}, best, plugins, following)
    writing = perf_counter() - began
    write_study(
        out / "study.json",
        tuned,
        named
        | {
            "compared": compared(tuned),
            "notes": NOTES.get() or [],
            "seconds": {"reading": reading, "writing": writing},
        },
        configuration(problem),
        here,
    )
    return writing


def compared(tuned: TuningResult) -> dict[str, Any]:
    """Printed comparisons of the best with the paper's gains and the start; pure numbers."""
    from dualwinch.model.quantities.figures import plain

    verdict, names = tuned.verdict, list(tuned.verdict.scored.statistics)
    references = [name for name in ("paper", "start") if name in verdict.scores]
    lower, feasible = (
        {other: {name: verdict.improvement(name, other, feasible=each) for name in names} for other in references}
        for each in (False, True)
    )
    return plain(
        {
            "times_lower": lower,
            "times_lower_in_feasible_scenarios": feasible,
            "ratio": {
                other: {name: 1 / value if value else math.nan for name, value in values.items()}
                for other, values in lower.items()
            },
            "constraints": [constraint.label for constraint in verdict.constraints],
        }
    )


def check_options(options: StudyOptions) -> None:
    """Raise `ConfigurationError` for options that are wrong whatever the problem, before anything is read."""
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.tuning.storage.connection import check_storage

    for name, count in (("trials", options.trials), ("rollouts", options.rollouts)):
        if count is not None and count < 1:
            raise ConfigurationError(f"--{name} {count}: must be a whole number >= 1")
    seconds_from(options.time)
    check_storage(options.kept_in)


def _announce(line: ProgressLine, problem: TuningProblem, method: str, storage: str, known: int) -> None:
    from dualwinch.tuning.result import controller_in_words
    from dualwinch.tuning.storage.connection import is_database, shown

    controller = controller_in_words(problem.experiment.controller)
    where = f"{problem.scenarios} scenarios of '{problem.ensemble.name}'" if problem.ensemble else "one experiment"
    count = len(problem.space.dimensions)
    gains = f"{count} gain{'s' if count > 1 else ''}"
    line.say(f"tuning {gains} of {controller} by {method} in {where}, seed {problem.seed}")
    constraints = "; ".join(constraint.label for constraint in problem.constraints) or "nothing"
    line.say(f"minimise {', '.join(objective.name for objective in problem.objectives)} subject to {constraints}")
    for words in filter(None, (problem.margin_conditions, *problem.choices)):
        line.say(words)
    place = shown(storage) if is_database(storage) else storage
    line.say(f"kept in {place}" + (f", which has {known} trials" if known else ""))


def print_study(tuned: TuningResult, typed: str, reading: float, writing: float) -> None:
    """Print result, scores, advice and cost of a study; commands in remarks have the options `typed`.

    `reading` the problem and `writing` the files took these times in s.
    """
    from dualwinch.analysis.idealisations import idealisations
    from dualwinch.analysis.remarks import in_full
    from dualwinch.tuning import result
    from dualwinch.tuning.scoring.ranking import pareto_front

    console, verdict = terminal(), tuned.verdict

    def say(words: str | Text) -> None:
        console.print(words, highlight=False, soft_wrap=True)

    say(styled("bold", result.worth(tuned)))
    say(result.headline(tuned))
    print_remarks(in_full(words, typed) for words in tuned.remarks)
    names, rows = result.statistics_table(tuned)
    columns = [FigureColumn("", ""), *(FigureColumn(name, "1" if name else "") for name in names[1:])]
    print_figures([FigureTable("statistics", columns, rows)])
    for words in result.contenders(tuned):
        say(words)
    for constraint in verdict.constraints:
        satisfied = verdict.scored.violations[constraint.label] <= 0
        say(styled("" if satisfied else "red", "satisfied" if satisfied else "violated ", f"  {constraint.label}"))
    sentences = (
        result.tested(tuned),
        *result.margin_places(tuned),
        result.widen(tuned),
        result.too_short(tuned),
        result.endings(tuned),
        result.authority(tuned),
    )
    for words in filter(None, sentences):
        say(words)
    for number, sentence in enumerate(result.advice(tuned)):
        say(f"{'what would help: ' if not number else '                 '}{sentence}")
    print_idealisations(idealisations(tuned.best))
    if len(tuned.problem.objectives) > 1:
        say(f"Pareto front: {len(pareto_front(tuned.trials))} trials, in study.json")
    cost = tuned.cost
    parts = {"compiling": cost.compiling, "for stability margins": cost.margin_seconds}
    among = ", ".join(f"{seconds:.1f} s {words}" for words, seconds in parts.items() if seconds >= LEAST_SECONDS)
    rollouts = ", ".join(filter(None, (f"{cost.rollouts} rollouts", cost.mostly_judging)))
    say(
        f"{rollouts}; {reading:.1f} s reading the problem, {cost.preparing:.1f} s preparing, "
        f"{cost.searching:.1f} s searching "
        f"({100 * cost.overhead:.0f} % of it not in rollouts), {cost.judging:.1f} s choosing and scoring, "
        f"{writing:.1f} s writing files"
        f"{f'; of that, {among}' if among else ''}"
    )
