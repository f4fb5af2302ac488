"""The function `dualwinch.race`: tune every law with the same budget, and score all on one test set."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import casadi as ca

from dualwinch.toolbox import (
    ConfigurationError,
    Controller,
    Ensemble,
    Experiment,
    TuningProblem,
    arguments,
    batches,
    controller_function,
    ensemble_file,
    executors,
    exogenous_signals,
    experiment_file,
    extensions,
    language,
    progresses,
    registries,
    searching,
    with_leaves,
)
from dualwinch.toolboxes.race.entries import (
    LAW,
    ROLLOUTS,
    TEST_SCENARIOS,
    RaceEntry,
    RaceTerms,
    combinations,
    earlier_entries,
    kinds,
    names,
)
from dualwinch.toolboxes.race.entries import ablations as ablated
from dualwinch.toolboxes.race.result import RaceResult
from dualwinch.toolboxes.race.scores import (
    COSTS,
    ERROR,
    BaselineScore,
    EntryResult,
    FrontPoint,
    SearchRecord,
    front,
    scored_runs,
)

OPTIONS = {LAW: "--law", searching.ESTIMATOR: "--estimator", searching.COORDINATION: "--coordination"}
"""Key of a part → its option."""

STRESS_SCENARIOS = 8
"""Number of scenarios per size in the computation of robustness margins."""

SHOWN_ENTRIES = 3
"""Number of imperfections reported, in ascending order of robustness margin."""


def race(
    ensemble: str | PathLike[str] | Ensemble = "rig",
    *,
    laws: Sequence[str] | str | None = None,
    estimators: Sequence[str] | str | None = None,
    coordinations: Sequence[str] | str | None = None,
    ablations: bool = False,
    rollouts: int = ROLLOUTS,
    searches: int = 1,
    test_scenarios: int = TEST_SCENARIOS,
    scenarios: int | None = None,
    seed: int = 0,
    settings: Sequence[str] = (),
    constraints: Sequence[str] | None = None,
    method: str | None = None,
    stress: bool = False,
    out: str | PathLike[str] | None = None,
    workers: executors.Workers = None,
    progress: progresses.PhaseProgress = progresses.no_progress,
) -> RaceResult:
    """Tune every combination of parts with the same number of rollouts, and score all on the same test set.

    With a folder, the same call after an interrupt (Ctrl-C) or a kill continues with the entries that are not finished,
    to the same digits. The entries of an earlier race on the same terms, by the ``race.json`` that the command wrote
    into the folder, take part, too.

    Args:
        ensemble: name or file of the ensemble that scenarios are drawn from, or an ensemble of your own.
        laws: kinds of position laws, including registered ones of your own; default: all.
        estimators: kinds of estimators, or ``all``; default: the one of `dualwinch.tuning_problem` for the ensemble.
        coordinations: kinds of coordinations, or ``all``; default: the paper's.
        ablations: whether to add the paper's law without each of its parts.
        rollouts: of each search (see `dualwinch.tune`).
        searches: number of searches of each entry, with different seeds; several show their spread.
        test_scenarios: number of test scenarios, for the scores.
        scenarios: number of training scenarios; default: from `dualwinch.tuning_problem`.
        seed: of all scenarios and searches.
        settings: such as ``plant.vehicle.mass=12000``, for all.
        constraints: as in `dualwinch.tuning_problem`, for all.
        method: name of the optimiser; default: that of `dualwinch.tune`.
        stress: whether to compute robustness margins of each entry's best gains (see `dualwinch.stress`).
        out: folder of the race, in which finished entries are kept as pickles (`CHECKPOINTS`); default: none are.
        workers: number of threads of this machine, or an executor; default: one thread per core.
        progress: called repeatedly with the share of the work that is done, and the current phase.

    Returns:
        The result of the race; it has a table as text and in a notebook, `plot` and `plot_fronts`.

    Raises:
        ConfigurationError: an invalid kind, key, value or constraint, incompatible parts, or the folder of another
            race.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted before the first entry was finished.

    Example:
        >>> import dualwinch as dw
        >>> run = dw.override(dw.case(4), {"simulation.duration": 2.0})
        >>> mass = {"plant.vehicle.mass": dw.Drawn(dw.Uniform(9e3, 1.1e4))}
        >>> loads = dw.Ensemble("loads", "vehicles of 9 to 11 t", run, mass)
        >>> race = dw.race(loads, laws=["fando-nftsm", "pid-cascade"], rollouts=100, test_scenarios=4, scenarios=2)
        >>> race.ranking[0].entry.key
        'fando-nftsm, calibrating-kalman, differential-tension'
    """
    population = ensemble if isinstance(ensemble, Ensemble) else ensemble_file.load_ensemble(ensemble)
    for key in population.distributions:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: is drawn in '{population.name}'; a race needs fixed gains")
    for text in settings:
        key = experiment_file.parse_assignment(text)[0]
        if key in OPTIONS:
            raise ConfigurationError(f"{text}: give {OPTIONS[key]} instead, with every kind to compare")
    method = method or searching.default_method(1)
    searching.check_method(method, 1)
    usual = (
        searching.default_estimator(population),
        searching.default_coordination(population) or Controller().coordination.kind,
    )
    entries = combinations(
        kinds(laws, registries.POSITION_LAWS, list(registries.POSITION_LAWS)),
        kinds(estimators, registries.ESTIMATORS, [usual[0]]),
        kinds(coordinations, registries.COORDINATIONS, [usual[1]]),
    )
    if ablations:
        entries += ablated(*usual)
    arguments.whole_number("searches", searches, 1)
    arguments.whole_number("seed", seed)
    searched = [replace(entry, search=search) for search in range(searches) for entry in entries]

    def problem_of(entry: RaceEntry) -> TuningProblem:
        return _problem(entry, population, settings, constraints, scenarios, seed)

    problem = problem_of(searched[0])
    if stress:
        extensions.extension(extensions.FUNCTIONS, "check_stress", "--stress")(problem)
    terms = RaceTerms(
        ensemble=population.name,
        configuration=searching.configuration(replace(problem, experiment=problem.paper_experiment)),
        constraints=tuple(constraint.text for constraint in problem.constraints),
        method=method,
        rollouts=rollouts,
        scenarios=problem.scenarios,
        test_scenarios=test_scenarios,
        seed=seed,
    )
    folder = None if out is None else Path(out)
    if folder:
        searched += earlier_entries(folder, terms)
    entrants = {entry.key: EntryTask(entry, problem_of(entry), terms) for entry in searched}
    return run_race(list(entrants.values()), folder=folder, stress=stress, workers=workers, progress=progress)


def _problem(
    entry: RaceEntry,
    ensemble: Ensemble,
    settings: Sequence[str],
    constraints: Sequence[str] | None,
    scenarios: int | None,
    seed: int,
) -> TuningProblem:
    common = [text for text in settings if experiment_file.parse_assignment(text)[0] not in entry.values]
    try:
        return searching.tuning_problem(
            ensemble=ensemble,
            settings=[*common, *(f"{key}={value}" for key, value in entry.values.items())],
            constraints=constraints,
            scenarios=scenarios,
            seed=exogenous_signals.named_seed(seed, f"search {entry.search}") if entry.search else seed,
            excluded=entry.excluded,
        )
    except ConfigurationError as error:
        raise ConfigurationError(f"{entry.key}: {error}") from error


def least_robust(
    problem: TuningProblem, experiment: Experiment, workers: executors.Workers
) -> tuple[dict[str, Any], ...]:
    """The least robustness margins of an experiment's gains, with a problem's ensemble as the base."""
    name = "given"
    stress_tuned = extensions.extension(extensions.FUNCTIONS, "stress_tuned", "--stress")
    margins = stress_tuned(problem, experiment, scenarios=STRESS_SCENARIOS, name=name, workers=workers)
    if name not in margins.names:  # lost without any imperfection, or the paper's own gains
        return tuple({"label": "none", "size": "", "violated": limit.words} for limit in margins.lost.get(name, ()))
    return tuple(
        {"label": row.imperfection.label, "size": margins.where(row, name), "violated": row.cause(name)}
        for row in margins.ranking[:SHOWN_ENTRIES]
    )


FREE = frozenset({ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_ASSIGN})
"""Instructions that compute nothing."""


def operations(experiment: Experiment) -> int:
    """Number of operations per sample of an experiment's controller; an exponential counts like a sum.

    Terms of gains, nominal plant and sample time alone are constants, as in exported controllers.
    """
    controller = controller_function(experiment.controller, experiment.plant)
    arguments = [ca.SX.sym(name, controller.size1_in(name)) for name in controller.name_in()[:-1]]
    results = controller.call([*arguments, ca.SX(experiment.simulation.sample_time)])
    sample = ca.Function("sample", arguments, results)
    return sum(instruction.operation not in FREE for instruction in language.instructions(sample))


TEST_PHASE = "scoring in the test set"
STRESS_PHASE = "finding robustness margins"
PAPER_PHASE = "scoring the paper's gains"
LEAST_PHASE = "finding the least possible error"
"""Phases besides those of tuning."""


class RaceTask(Protocol):
    """A part of a race that a worker computes by itself."""

    def run(self, workers: executors.Workers, progress: searching.TuningProgress) -> Any:
        """Compute the result, which can be pickled; an interrupt is raised, without a result."""
        ...


@dataclass(frozen=True)
class BaselineTask:
    """Score the paper's gains on the test set, and compute lower bounds on the error there.

    Attributes:
        problem: of any entry: ensemble, constraints and seed are common to all.
        terms: of the race.
    """

    problem: TuningProblem
    terms: RaceTerms

    def run(self, workers: executors.Workers, progress: searching.TuningProgress) -> BaselineScore:
        """Compute the score."""
        problem, terms = self.problem, self.terms
        scorer = searching.Scorer(searching.prepare(problem, workers, progress), workers=workers)
        progress.phase(PAPER_PHASE)
        paper = searching.TestSet(scorer, terms.test_scenarios, terms.test_seed).paper
        runs = scored_runs(paper.result, paper.evaluation.violations, operations(problem.paper_experiment))
        progress.phase(LEAST_PHASE)
        scenarios = problem.drawn(terms.test_scenarios, terms.test_seed, problem.paper_experiment)
        return BaselineScore(runs, batches.least_errors([batches.experiment_of(scenario) for scenario in scenarios]))


@dataclass(frozen=True)
class EntryTask:
    """Tune an entry, and score its best and its fronts on the test set.

    Attributes:
        entry: its parts.
        problem: of tuning it.
        terms: of the race.
    """

    entry: RaceEntry
    problem: TuningProblem
    terms: RaceTerms

    def run(self, workers: executors.Workers, progress: searching.TuningProgress) -> EntryResult:
        """Compute the result."""
        problem, terms, began = self.problem, self.terms, searching.clock.now()
        tuned = searching.tune(
            problem,
            method=terms.method,
            rollouts=terms.rollouts,
            test_scenarios=min(terms.test_scenarios, problem.options.test),
            workers=workers,
            keep=False,
            watch=progress,
        )
        progress.phase(TEST_PHASE)
        scorer = searching.Scorer(tuned.training, workers=workers)
        test = searching.TestSet(scorer, terms.test_scenarios, terms.test_seed)
        best = test.score(tuned.verdict.best.candidate)
        fronts = {cost: front(tuned.trials, cost) for cost in COSTS}
        candidates = [trial.candidate for trials in fronts.values() for trial in trials]
        points = iter(scorer.over(candidates, test.scenarios, constraints=test.constraints))
        return EntryResult(
            entry=self.entry,
            runs=scored_runs(best.result, best.evaluation.violations, operations(tuned.best)),
            gains=tuned.gains,
            fronts={cost: tuple(_point(problem, next(points), cost) for _ in fronts[cost]) for cost in COSTS},
            search=SearchRecord(
                trials=len(tuned.trials),
                rollouts=tuned.progress.spent,
                gains=len(problem.space.dimensions),
                seconds=searching.clock.now() - began,
                improved=tuned.verdict.improved,
                version=version("dualwinch"),
            ),
        )


def _point(problem: TuningProblem, evaluation: searching.Evaluation, cost: str) -> FrontPoint:
    means, gains = evaluation.statistics, problem.space.settings(evaluation.point)
    return FrontPoint(means[f"mean.{cost}"], means[f"mean.{ERROR}"], feasible=evaluation.feasible, gains=gains)


@dataclass(frozen=True)
class StressTask:
    """Compute the least robustness margins of an entry's best gains (`least_robust`).

    Attributes:
        entry: its parts.
        problem: common to all entries, with the base of the imperfections.
        experiment: with the gains.
    """

    entry: RaceEntry
    problem: TuningProblem
    experiment: Experiment

    def run(self, workers: executors.Workers, progress: searching.TuningProgress) -> tuple[dict[str, Any], ...]:
        """Compute the margins, in ascending order."""
        progress.phase(STRESS_PHASE)
        return least_robust(self.problem, self.experiment, workers)


def compute(
    task: RaceTask, workers: executors.Workers = 1, progress: searching.TuningProgress = searching.NO_PROGRESS
) -> Any:
    """Compute a task of a race; on a worker with one thread, and without progress."""
    return task.run(workers, progress)


BEGINS = {
    searching.DRAWING: 0.0,
    searching.REFERENCES: 0.02,
    PAPER_PHASE: 0.1,
    LEAST_PHASE: 0.1,
    searching.SEARCHING: 0.12,
    searching.CERTIFYING: 0.82,
    searching.SCORING: 0.9,
    TEST_PHASE: 0.93,
    STRESS_PHASE: 0.95,
}
"""Phase → approximate share of an entry's time that has passed at its beginning."""


class EntryProgress(searching.TuningProgress):
    """Progress of one entry, reported as the share done of all entries, with the current phase.

    Args:
        name: of the entry in messages.
        number: of the entry, from 0.
        count: of the entries.
        progress: to which it is reported.
    """

    def __init__(self, name: str, number: int, count: int, progress: progresses.PhaseProgress) -> None:
        super().__init__(self._in_phase)
        self._name, self._number, self._count, self._race = name, number, count, progress
        self._words, self._share = "", 0.0

    def phase(self, words: str) -> None:
        """Report the beginning of a phase."""
        self._words, self._share = words, BEGINS.get(words, 0.0)
        self._report(words)

    def progress(self, progress: searching.SearchStatus, until: float | None, trials: int | None) -> None:  # noqa: ARG002
        """Report the share of the search that is done."""
        self._share = BEGINS[searching.SEARCHING] + progress.share * (
            BEGINS[searching.CERTIFYING] - BEGINS[searching.SEARCHING]
        )
        self._report(self._words)

    def _in_phase(self, fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG002
        """Report a step of a phase, or a compilation; the share of the entry is that of the phase's beginning."""
        self._report(phase or self._words, status)

    def _report(self, words: str, status: str = "") -> None:
        number = f"{self._number + 1} of {self._count}, " if self._count > 1 else ""
        begin = f"{number}{self._name}: "
        self._race((self._number + self._share) / self._count, f"{begin}{words}", status and f"{begin}{status}")


class LocalRace(executors.SerialExecutor):
    """Computes the tasks of a race one after the other, each on all threads of this machine.

    Args:
        entries: of the race.
        threads: their number; ``None``: one per core.
        progress: told the phases of each task.
    """

    def __init__(self, entries: Sequence[RaceEntry], threads: int | None, progress: progresses.PhaseProgress) -> None:
        self._threads, self._progress = threads, progress
        self._names = names(entries)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Compute a task."""
        return super().submit(fn, *args, self._threads, self._watch(*args), **kwargs)

    def _watch(self, task: RaceTask) -> searching.TuningProgress:
        if not isinstance(task, EntryTask | StressTask):
            return EntryProgress("paper", 0, 1, self._without_share)
        key = task.entry.key
        return EntryProgress(self._names[key], list(self._names).index(key), len(self._names), self._progress)

    def _without_share(self, fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG002
        self._progress(0.0, phase, status)


CHECKPOINTS = "checkpoints"
"""Subfolder with the results of finished tasks, as pickles, in the folder of a race."""


def run_race(
    entrants: Sequence[EntryTask],
    *,
    folder: Path | None = None,
    stress: bool = False,
    workers: executors.Workers = None,
    progress: progresses.PhaseProgress = progresses.no_progress,
) -> RaceResult:
    """Tune and score entries on the same terms, and the paper's gains; compute robustness margins if requested.

    An interrupt (Ctrl-C) keeps finished entries. Further arguments and errors are as in `race`.
    """
    problem, terms = entrants[0].problem, entrants[0].terms
    local = LocalRace([task.entry for task in entrants], executors.threads_of(workers), progress)
    executor = workers if isinstance(workers, Executor) else local
    if folder and not isinstance(executor, executors.CheckpointingExecutor):
        executor = executors.CheckpointingExecutor(executor, folder / CHECKPOINTS)
    report = progress if isinstance(workers, Executor) else progresses.no_progress
    paper = list[BaselineScore]()
    results = dict[str, EntryResult]()
    try:
        for task, result in _computed([BaselineTask(problem, terms), *entrants], executor, report):
            if isinstance(task, EntryTask):
                results[task.entry.key] = result
            else:
                paper.append(result)
        stressed = [
            StressTask(task.entry, problem, with_leaves(task.problem.experiment, results[task.entry.key].gains))
            for task in (entrants if stress else ())
        ]
        for task, margins in _computed(stressed, executor, report):
            results[task.entry.key] = replace(results[task.entry.key], stress=margins)
    except KeyboardInterrupt:
        if not paper or not results:
            raise
    entries = tuple(results[task.entry.key] for task in entrants if task.entry.key in results)
    finished = [entry for entry in entries if entry.stress is not None or not stress]
    return RaceResult(terms, paper[0], entries, remaining=len(entrants) - len(finished))


def _computed(
    tasks: Sequence[Any], executor: Executor, progress: progresses.PhaseProgress
) -> Iterator[tuple[Any, Any]]:
    """Tasks and their results, in the order in which they finish."""
    for count, (number, result) in enumerate(executors.spread(executor, compute, [(task,) for task in tasks]), 1):
        progress(count / len(tasks), f"{count} of {len(tasks)} searches and scores are done")
        yield tasks[number], result
