"""The function `dualwinch.race`: tune every law with the same budget, and score all on one test set."""

import fcntl
import json
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import casadi as ca

from dualwinch.codegen.files import atomic
from dualwinch.codegen.source.expressions import instructions
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.toml_text import parse_assignment
from dualwinch.controllers.controller import Controller, controller_function
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.arguments import whole_number
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import another
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.batch.authority import least_errors
from dualwinch.simulation.batch.scenarios import experiment_of
from dualwinch.simulation.batch.workers import Workers, spread
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.exogenous.signals import named_seed
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.progress import PhaseProgress, no_progress
from dualwinch.toolboxes.race.entries import (
    LAW,
    ROLLOUTS,
    TEST_SCENARIOS,
    BenchmarkEntry,
    BenchmarkTerms,
    EntryProblem,
    combinations,
    kinds,
    names,
)
from dualwinch.toolboxes.race.entries import ablations as ablated
from dualwinch.toolboxes.race.result import BenchmarkResult
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
from dualwinch.toolboxes.stress.stress import check_stress, stress_tuned
from dualwinch.tuning.baseline import default_coordination, default_estimator
from dualwinch.tuning.optimisers import check_method
from dualwinch.tuning.options import default_method
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.progress import (
    CERTIFYING,
    DRAWING,
    NO_PROGRESS,
    REFERENCES,
    SEARCHING,
    SearchStatus,
    TuningProgress,
)
from dualwinch.tuning.scoring.progress import SCORING as SCORING_BEST
from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.test_set import TestSet
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import COORDINATION, ESTIMATOR, configuration, definition_of, tuning_problem

RobustnessCheck = Callable[[Experiment, Workers], tuple[dict[str, Any], ...]]
"""Computes the least robustness margins of an experiment's gains, in ascending order, on given workers."""

OPTIONS = {LAW: "--law", ESTIMATOR: "--estimator", COORDINATION: "--coordination"}
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
    workers: Workers = None,
    progress: PhaseProgress = no_progress,
) -> BenchmarkResult:
    """Tune every combination of parts with the same number of rollouts, and score all on the same test set.

    An interrupt (Ctrl-C) keeps finished entries, and the same call with the same folder continues with the rest. A
    later call may add entries to a folder; the result has all entries in it.

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
        out: folder for finished entries; default: none.
        workers: number of threads of this machine, or an executor; default: one thread per core.
        progress: called repeatedly with the share of the work that is done, and the current phase.

    Returns:
        The result of the race; it has a table as text and in a notebook, `plot` and `plot_fronts`.

    Raises:
        ConfigurationError: an invalid kind, key, value or constraint, incompatible parts, or the folder of another
            race.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted before the first entry was finished.
    """
    drawn = ensemble if isinstance(ensemble, Ensemble) else load_ensemble(ensemble)
    for key in drawn.distributions:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: is drawn in '{drawn.name}'; a race needs fixed gains")
    for text in settings:
        key = parse_assignment(text)[0]
        if key in OPTIONS:
            raise ConfigurationError(f"{text}: give {OPTIONS[key]} instead, with every kind to compare")
    method = method or default_method(1)
    check_method(method, 1)
    usual = default_estimator(drawn), default_coordination(drawn) or Controller().coordination.kind
    entries = combinations(
        kinds(laws, POSITION_LAWS, list(POSITION_LAWS)),
        kinds(estimators, ESTIMATORS, [usual[0]]),
        kinds(coordinations, COORDINATIONS, [usual[1]]),
    )
    if ablations:
        entries += ablated(*usual)
    whole_number("searches", searches, 1)
    whole_number("seed", seed)
    entrants: dict[str, EntryProblem] = {}
    for entry in (replace(entry, search=search) for search in range(searches) for entry in entries):
        problem = _problem(entry, drawn, settings, constraints, scenarios, seed)
        entrants[entry.key] = EntryProblem(entry, problem)
    first = next(iter(entrants.values())).problem
    if stress:
        check_stress(first)
    terms = BenchmarkTerms(
        ensemble=drawn.name,
        configuration=configuration(replace(first, experiment=first.paper_experiment)),
        constraints=tuple(constraint.text for constraint in first.constraints),
        method=method,
        rollouts=rollouts,
        scenarios=first.scenarios,
        test_scenarios=test_scenarios,
        seed=seed,
    )
    return run_race(
        list(entrants.values()),
        terms,
        folder=None if out is None else Path(out),
        robustness=partial(least_robust, first) if stress else None,
        workers=workers,
        progress=progress,
    )


def _problem(
    entry: BenchmarkEntry,
    ensemble: Ensemble,
    settings: Sequence[str],
    constraints: Sequence[str] | None,
    scenarios: int | None,
    seed: int,
) -> TuningProblem:
    others = [text for text in settings if parse_assignment(text)[0] not in entry.values]  # the entry's own come first
    try:
        return tuning_problem(
            ensemble=ensemble,
            settings=[*others, *(f"{key}={value}" for key, value in entry.values.items())],
            constraints=constraints,
            scenarios=scenarios,
            seed=named_seed(seed, f"search {entry.search}") if entry.search else seed,
            excluded=entry.excluded,
        )
    except ConfigurationError as error:
        raise ConfigurationError(f"{entry.key}: {error}") from error


def least_robust(problem: TuningProblem, experiment: Experiment, workers: Workers) -> tuple[dict[str, Any], ...]:
    """The least robustness margins of an experiment's gains, with a problem's ensemble as the base."""
    name = "given"
    found = stress_tuned(problem, experiment, scenarios=STRESS_SCENARIOS, name=name, workers=workers)
    if name not in found.names:  # lost without any imperfection, or the paper's own gains
        return tuple({"label": "none", "size": "", "violated": limit.words} for limit in found.lost.get(name, ()))
    return tuple(
        {"label": row.imperfection.label, "size": found.where(row, name), "violated": row.cause(name)}
        for row in found.ranking[:SHOWN_ENTRIES]
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
    found = instructions(ca.Function("sample", arguments, results))
    return sum(instruction.operation not in FREE for instruction in found)


ENTRIES = "entries"
"""Subfolder of the entries' files in the folder of the race."""

TOML = "configuration"
"""Name of the term that is TOML."""

PAPER_STEM = "paper"
"""Name of the file with the paper's gains."""


class ResultFolder:
    """Finished results of a race, in its folder, or in memory only without one.

    Raises:
        ConfigurationError: a file has other terms, or is not a race's.
    """

    def __init__(self, path: Path | None, terms: Mapping[str, Any]) -> None:
        self._path = None if path is None else path / ENTRIES
        self._terms = _plain(terms)
        self._records: dict[str, dict[str, Any]] = {}
        if self._path is not None and self._path.is_dir():
            for file in sorted(self._path.glob("*.json")):
                self._records[file.stem] = self._read(file)

    @property
    def stems(self) -> tuple[str, ...]:
        """Names of the finished results."""
        return tuple(self._records)

    def find(self, stem: str, definition: Mapping[str, Any] | None = None) -> dict[str, Any] | None:
        """The finished result of a name; ``None`` if there is none.

        Raises:
            ConfigurationError: the result has another definition than the given one.
        """
        record = self._records.get(stem)
        if record is None:
            return None
        names = _differences(_plain(definition), record["definition"]) if definition is not None else ()
        if names:
            others = " and ".join(map(another, names))
            raise ConfigurationError(
                f"{self._path}: {stem}.json was run with {others}; remove it, or give another folder"
            )
        return record["result"]

    @contextmanager
    def claimed(self, stem: str) -> Iterator[bool]:
        """Claim an entry while it is computed; false if another process has claimed it.

        The claim is a lock on a file, which the system releases when the process ends, even by a crash.
        """
        if self._path is None:
            yield True
            return
        self._path.mkdir(parents=True, exist_ok=True)
        with (self._path / f"{stem}.lock").open("ab") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                yield False
                return
            self.look(stem)
            try:
                yield True
            finally:
                Path(lock.name).unlink(missing_ok=True)

    def look(self, stem: str) -> dict[str, Any] | None:
        """The finished result of a name, possibly another process's; ``None`` if there is none."""
        if self._path is not None and (file := self._path / f"{stem}.json").is_file():
            self._records[stem] = self._read(file)
        return self.find(stem)

    def keep(self, stem: str, definition: Mapping[str, Any], result: Mapping[str, Any]) -> None:
        """Keep a finished result."""
        record = _plain({"terms": self._terms, "definition": definition, "result": result})
        self._records[stem] = record
        if self._path is not None:
            self._path.mkdir(parents=True, exist_ok=True)
            with atomic(self._path / f"{stem}.json") as unfinished:
                unfinished.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")

    def _read(self, file: Path) -> dict[str, Any]:
        try:
            record = json.loads(file.read_text(encoding="utf-8"))
            terms = record["terms"], record["definition"], record["result"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(f"{file}: is not a result of a race; remove it") from error
        for name in _differences(self._terms, terms[0]):
            shown = "" if name == TOML else f", {terms[0].get(name)} and not {self._terms[name]}"
            raise ConfigurationError(
                f"{file.parent.parent}: contains a race with {another(name)}{shown}; give another folder"
            )
        return record


def _differences(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[str]:
    """Names whose values differ; TOML is compared by content, as its comments list all registered parts."""
    return [name for name, value in ours.items() if _content(name, value) != _content(name, theirs.get(name, ""))]


def _content(name: str, value: Any) -> Any:
    return tomllib.loads(value) if name == TOML else value


def _plain(content: Mapping[str, Any]) -> dict[str, Any]:
    """Content as read back from JSON."""
    return json.loads(json.dumps(content, allow_nan=False))


TEST_PHASE = "scoring in the test set"
STRESS_PHASE = "finding robustness margins"
PAPER_PHASE = "scoring the paper's gains"
LEAST_PHASE = "finding the least possible error"
"""Phases besides those of tuning."""


def scored(
    entry: BenchmarkEntry,
    problem: TuningProblem,
    terms: BenchmarkTerms,
    robustness: RobustnessCheck | None,
    workers: Workers,
    watch: TuningProgress,
) -> EntryResult:
    """Tune an entry, and score its best and its fronts on the test set; an interrupt is raised, without a result."""
    began = clock.now()
    tuned = tune(
        problem,
        method=terms.method,
        rollouts=terms.rollouts,
        test_scenarios=min(terms.test_scenarios, problem.options.test),
        workers=workers,
        keep=False,
        watch=watch,
    )
    watch.phase(TEST_PHASE)
    scorer = Scorer(tuned.training, workers=workers)
    test = TestSet(scorer, terms.test_scenarios, terms.test_seed)
    best = test.score(tuned.verdict.best.candidate)
    fronts = {cost: front(tuned.trials, cost) for cost in COSTS}
    candidates = [trial.candidate for found in fronts.values() for trial in found]
    points = iter(scorer.over(candidates, test.scenarios, constraints=test.constraints))
    rescored = {cost: tuple(_point(problem, next(points), cost) for _ in found) for cost, found in fronts.items()}
    stress = None
    if robustness:
        watch.phase(STRESS_PHASE)
        stress = robustness(tuned.best, workers)
    return EntryResult(
        entry=entry,
        runs=scored_runs(best.result, best.evaluation.violations, operations(tuned.best)),
        gains=tuned.gains,
        fronts=rescored,
        search=SearchRecord(
            trials=len(tuned.trials),
            rollouts=tuned.progress.spent,
            gains=len(problem.space.dimensions),
            seconds=clock.now() - began,
            improved=tuned.verdict.improved,
            version=version("dualwinch"),
        ),
        stress=stress,
    )


def _point(problem: TuningProblem, evaluation: Evaluation, cost: str) -> FrontPoint:
    means, gains = evaluation.statistics, problem.space.settings(evaluation.point)
    return FrontPoint(means[f"mean.{cost}"], means[f"mean.{ERROR}"], feasible=evaluation.feasible, gains=gains)


def paper(problem: TuningProblem, terms: BenchmarkTerms, workers: Workers, watch: TuningProgress) -> BaselineScore:
    """Score the paper's gains on the test set, and compute lower bounds on the error there.

    The problem is that of any entry: ensemble, constraints and seed are common to all.
    """
    scorer = Scorer(prepare(problem, workers, watch), workers=workers)
    watch.phase(PAPER_PHASE)
    test = TestSet(scorer, terms.test_scenarios, terms.test_seed)
    found = test.paper
    runs = scored_runs(found.result, found.evaluation.violations, operations(problem.paper_experiment))
    watch.phase(LEAST_PHASE)
    with_paper = problem.drawn(terms.test_scenarios, terms.test_seed, problem.paper_experiment)
    experiments = [experiment_of(scenario) for scenario in with_paper]
    return BaselineScore(runs, least_errors(experiments))


BEGINS = {
    DRAWING: 0.0,
    REFERENCES: 0.02,
    PAPER_PHASE: 0.1,
    LEAST_PHASE: 0.1,
    SEARCHING: 0.12,
    CERTIFYING: 0.82,
    SCORING_BEST: 0.9,
    TEST_PHASE: 0.93,
    STRESS_PHASE: 0.95,
}
"""Phase → approximate share of an entry's time that has passed at its beginning."""


class EntryProgress(TuningProgress):
    """Progress of one entry, reported as the share done of the entries to run, with the current phase."""

    def __init__(self, name: str, number: int, of: int, progress: PhaseProgress) -> None:
        """Watch entry `number`, from 0, of `of` entries to run."""
        super().__init__(self._in_phase)
        self._name, self._number, self._of, self._of_race = name, number, of, progress
        self._words, self._share = "", 0.0

    def phase(self, words: str) -> None:
        """Report the beginning of a phase."""
        self._words, self._share = words, BEGINS.get(words, 0.0)
        self._report(words)

    def progress(self, progress: SearchStatus, until: float | None, trials: int | None) -> None:  # noqa: ARG002
        """Report the share of the search that is done."""
        self._share = BEGINS[SEARCHING] + progress.share * (BEGINS[CERTIFYING] - BEGINS[SEARCHING])
        self._report(self._words)

    def _in_phase(self, fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG002
        """Report a step of a phase, or a compilation; the share of the entry is that of the phase's beginning."""
        self._report(phase or self._words, status)

    def _report(self, words: str, status: str = "") -> None:
        number = f"{self._number + 1} of {self._of}, " if self._of > 1 else ""
        begin = f"{number}{self._name}: "
        self._of_race((self._number + self._share) / self._of, f"{begin}{words}", status and f"{begin}{status}")


def run_race(
    entrants: Sequence[EntryProblem],
    terms: BenchmarkTerms,
    *,
    folder: Path | None = None,
    robustness: RobustnessCheck | None = None,
    workers: Workers = None,
    progress: PhaseProgress = no_progress,
) -> BenchmarkResult:
    """Tune and score every entry that is not in the folder yet; compute robustness margins if requested.

    The result includes the entries of earlier calls on the same terms. An interrupt (Ctrl-C) keeps finished entries,
    and the same call continues with the rest. Further arguments and errors are as in `race`.
    """
    kept = ResultFolder(folder, asdict(terms))
    called = names([each.entry for each in entrants])
    jobs = [RaceJob(PAPER_STEM, entrants[0].problem, terms)]
    jobs += [RaceJob(called[each.entry.key], each.problem, terms, each.entry, robustness) for each in entrants]
    for job in jobs:
        kept.find(job.stem, job.definition)
    try:
        _run_jobs(jobs, kept, workers, progress)
    except KeyboardInterrupt:
        if not set(kept.stems) - {PAPER_STEM}:
            raise
    records = {stem: kept.find(stem) for stem in kept.stems}
    remaining = sum(job.lacks(records.get(job.stem)) for job in jobs)
    return BenchmarkResult(
        terms=terms,
        paper=BaselineScore.from_record(records.pop(PAPER_STEM) or {}),
        entries=tuple(EntryResult.from_record(record) for record in records.values() if record),
        remaining=remaining,
    )


@dataclass(frozen=True)
class RaceJob:
    """A job of a race: score the paper's gains, or tune and score an entry.

    Attributes:
        name: in messages.
        problem: of the entry; of any entry for the paper's gains.
        terms: of the race.
        entry: to tune; ``None``: the paper's gains.
        robustness: computes the robustness margins of the best gains; ``None``: none are computed.
    """

    name: str
    problem: TuningProblem
    terms: BenchmarkTerms
    entry: BenchmarkEntry | None = None
    robustness: RobustnessCheck | None = None

    @property
    def stem(self) -> str:
        """Name of the result's file."""
        return self.entry.stem if self.entry else PAPER_STEM

    @property
    def definition(self) -> Mapping[str, Any]:
        """Definition that the result must have."""
        return definition_of(self.problem, self.terms.method) if self.entry else {}

    def lacks(self, record: Mapping[str, Any] | None) -> bool:
        """Whether a record lacks something to compute."""
        return record is None or (self.robustness is not None and record["stress"] is None)

    def watch(self, number: int, count: int, progress: PhaseProgress) -> TuningProgress:
        """Progress of this entry among the entries to run."""
        if self.entry is None:

            def phase_alone(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
                progress(0.0, phase, status)

            return EntryProgress(self.name, 0, 1, phase_alone)
        return EntryProgress(self.name, number, count, progress)

    def run(
        self, record: Mapping[str, Any] | None, workers: Workers = 1, watch: TuningProgress = NO_PROGRESS
    ) -> dict[str, Any]:
        """Compute the result, for JSON; `record` is its finished part."""
        if self.entry is None:
            return paper(self.problem, self.terms, workers, watch).to_record()
        if record and self.robustness:
            watch.phase(STRESS_PHASE)
            gains = with_leaves(self.problem.experiment, record["gains"])
            return {**record, "stress": list(self.robustness(gains, workers))}
        return scored(self.entry, self.problem, self.terms, self.robustness, workers, watch).to_record()


PAUSE = 1.0
"""Polling period in s for results of other processes."""


def _run_jobs(jobs: Sequence[RaceJob], kept: ResultFolder, workers: Workers, progress: PhaseProgress) -> None:
    """Run the jobs whose results a folder lacks: one after the other here, or in parallel on an executor's workers.

    Jobs claimed by another process are left to it, and run here if it ends without a result.
    """
    waiting = [job for job in jobs if job.lacks(kept.find(job.stem))]
    count = sum(job.entry is not None for job in waiting)
    while waiting:
        with ExitStack() as claims:
            ours = list[RaceJob]()
            for job in waiting:
                if claims.enter_context(kept.claimed(job.stem)) and job.lacks(kept.find(job.stem)):
                    ours.append(job)
                    if not isinstance(workers, Executor):
                        break
            finished = count - sum(job.entry is not None for job in waiting)
            if not ours:
                progress(0.0, f"another process has claimed the remaining {len(waiting)} searches and scores")
            if isinstance(workers, Executor):
                _spread_jobs(ours, kept, workers, progress)
            else:
                for job in ours:
                    watch = job.watch(finished, count, progress)
                    kept.keep(job.stem, job.definition, job.run(kept.find(job.stem), workers, watch))
        before, waiting = len(waiting), [job for job in waiting if job.lacks(kept.look(job.stem))]
        if len(waiting) == before:
            time.sleep(PAUSE)


def _spread_jobs(jobs: Sequence[RaceJob], kept: ResultFolder, executor: Executor, progress: PhaseProgress) -> None:
    """Run jobs in parallel on an executor's workers; each result is kept at once."""
    if jobs:
        progress(0.0, f"{len(jobs)} searches and scores on the cluster")
    tasks = ((job, kept.find(job.stem)) for job in jobs)
    for done, (number, result) in enumerate(spread(executor, RaceJob.run, tasks), 1):
        kept.keep(jobs[number].stem, jobs[number].definition, result)
        progress(done / len(jobs), f"{done} of {len(jobs)} done on the cluster, {jobs[number].name} last")
