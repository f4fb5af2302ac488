"""The function `dualwinch.race`: every law tuned with one budget, and all scored in the same test scenarios."""

import fcntl
import json
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
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
from dualwinch.simulation.analysis.authority import least_errors
from dualwinch.simulation.batch.scenarios import experiment_of
from dualwinch.simulation.batch.workers import Workers, spread
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.exogenous.signals import named_seed
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.progress import PhaseProgress, Progress, no_progress
from dualwinch.tuning.baseline import default_coordination, default_estimator
from dualwinch.tuning.benchmark.entries import (
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
from dualwinch.tuning.benchmark.entries import ablations as ablated
from dualwinch.tuning.benchmark.result import BenchmarkResult
from dualwinch.tuning.benchmark.scores import (
    COSTS,
    ERROR,
    BaselineScore,
    EntryResult,
    FrontPoint,
    SearchRecord,
    front,
    scored_runs,
)
from dualwinch.tuning.optimisers import check_method
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.robustness.stress import check_stress, stress_tuned
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.evaluation import Scorer
from dualwinch.tuning.scoring.progress import (
    CHOOSING,
    DRAWING,
    NO_PROGRESS,
    REFERENCES,
    SEARCHING,
    SearchStatus,
    TuningProgress,
)
from dualwinch.tuning.scoring.progress import SCORING as SCORING_BEST
from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.scoring.test_set import TestSet
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.selection_config import default_method
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import COORDINATION, ESTIMATOR, configuration, definition_of, tuning_problem

RobustnessCheck = Callable[[Experiment, Workers], tuple[dict[str, Any], ...]]
"""Finds the least robustness margins of an experiment's gains, the least first; by some workers."""

OPTIONS = {LAW: "--law", ESTIMATOR: "--estimator", COORDINATION: "--coordination"}
"""Key of a part → option that chooses it."""

STRESS_SCENARIOS = 8
"""Scenarios of every size in the search for robustness margins."""

SHOWN_ENTRIES = 3
"""Imperfections that are named, that of the least robustness margin first."""


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
    """Tune every combination of parts with the same number of rollouts, and score all in the same test set.

    An interrupt (Ctrl-C) keeps what is finished, and the same call with the same folder goes on with the rest. A
    later call may add entries to a folder; all that are in it take part.

    Args:
        ensemble: name or file of what scenarios are drawn from, or an ensemble of your own.
        laws: kinds of position laws, registered ones of your own among them; default: all.
        estimators: kinds of estimators, or ``all``; default: what `dualwinch.tuning_problem` takes for the ensemble.
        coordinations: kinds of coordinations, or ``all``; default: the paper's.
        ablations: whether the paper's law takes part without each of its parts, too.
        rollouts: of each search (see `dualwinch.tune`).
        searches: of each entry, by seeds of their own; more than one tell how much is luck.
        test_scenarios: number of scenarios of the test set, which score.
        scenarios: of the training set; default: those of `dualwinch.tuning_problem`.
        seed: of all scenarios and searches.
        settings: such as ``plant.vehicle.mass=12000``, for all.
        constraints: as of `dualwinch.tuning_problem`, for all.
        method: name of the optimiser; default: that of `dualwinch.tune`.
        stress: whether robustness margins of the best of each are computed, too (see `dualwinch.stress`).
        out: folder that finished entries are kept in; default: nowhere.
        workers: of this machine, or an executor; default: one thread a core.
        progress: called now and then with the share that is done of what there is to do, and with what is being done.

    Returns:
        The race; it has a table as text and in a notebook, `plot` and `plot_fronts`.

    Raises:
        ConfigurationError: anything wrong with a kind, a key, a value or a constraint, parts that do not go together,
            or a folder that holds another race.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted before the first entry was finished.
    """
    drawn = ensemble if isinstance(ensemble, Ensemble) else load_ensemble(ensemble)
    for key in drawn.distributions:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: is drawn in '{drawn.name}'; a race needs the gains as they are")
    for text in settings:
        key = parse_assignment(text)[0]
        if key in OPTIONS:
            raise ConfigurationError(f"{text}: give {OPTIONS[key]}, for all kinds that are to take part")
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
        entrants[entry.key] = EntryProblem(entry, problem, definition_of(problem, method))
    first = next(iter(entrants.values())).problem
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
        robustness=_robustness_check(first) if stress else None,
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
    try:
        return tuning_problem(
            ensemble=ensemble,
            settings=[*settings, *(f"{key}={value}" for key, value in entry.values.items())],
            constraints=constraints,
            scenarios=scenarios,
            seed=named_seed(seed, f"search {entry.search}") if entry.search else seed,
            held=entry.held,
        )
    except ConfigurationError as error:
        raise ConfigurationError(f"{entry.key}: {error}") from error


def _robustness_check(problem: TuningProblem) -> RobustnessCheck:
    """Finds the least robustness margins in the base that a problem is tuned in.

    Raises:
        ConfigurationError: there is no imperfection that the gains are not tuned for.
    """
    check_stress(problem)
    return partial(least_robust, problem)


def least_robust(problem: TuningProblem, experiment: Experiment, workers: Workers) -> tuple[dict[str, Any], ...]:
    """The least robustness margins of an experiment's gains, where the base is what a problem is tuned in."""
    name = "given"
    found = stress_tuned(problem, experiment, scenarios=STRESS_SCENARIOS, name=name, workers=workers)
    if name not in found.names:  # lost without any imperfection, or the paper's own gains
        return tuple({"label": "none", "size": "", "broken": broken.words} for broken in found.lost.get(name, ()))
    return tuple(
        {
            "label": row.imperfection.label,
            "size": found.where(row, name),
            "broken": row.by_what(name),
        }
        for row in found.ranking[:SHOWN_ENTRIES]
    )


FREE = frozenset({ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_ASSIGN})
"""Instructions that compute nothing."""


def operations(experiment: Experiment) -> int:
    """Number of operations that the controller of an experiment takes a sample, an exponential counted like a sum.

    What follows from gains, nominal plant and sample time alone is worked out beforehand, as in exported controllers.
    """
    controller = controller_function(experiment.controller, experiment.plant)
    arguments = [ca.SX.sym(name, controller.size1_in(name)) for name in controller.name_in()[:-1]]
    results = controller.call([*arguments, ca.SX(experiment.simulation.sample_time)])
    found = instructions(ca.Function("sample", arguments, results))
    return sum(instruction.operation not in FREE for instruction in found)


ENTRIES = "entries"
"""Folder of the files, in that of the race."""

TOML = "configuration"
"""Name of what is TOML."""

PAPER_STEM = "paper"
"""Name of the file with the paper's gains."""


class ResultFolder:
    """What is finished of a race, in a folder or in memory alone."""

    def __init__(self, path: Path | None, terms: Mapping[str, Any]) -> None:
        """Read what is there.

        Args:
            path: folder of the race; ``None``: nothing is kept beyond this object.
            terms: what has to be the same for all, JSON-ready.

        Raises:
            ConfigurationError: what is there was run on other terms, or is nothing of a race.
        """
        self._path = None if path is None else path / ENTRIES
        self._terms = _plain(terms)
        self._records: dict[str, dict[str, Any]] = {}
        if self._path is not None and self._path.is_dir():
            for file in sorted(self._path.glob("*.json")):
                self._records[file.stem] = self._read(file)

    @property
    def stems(self) -> tuple[str, ...]:
        """Names of what is finished."""
        return tuple(self._records)

    def find(self, stem: str, definition: Mapping[str, Any] | None = None) -> dict[str, Any] | None:
        """What is finished under a name; ``None`` where it is not.

        Args:
            stem: the name.
            definition: what it has to be the result of, JSON-ready; ``None``: of anything.

        Raises:
            ConfigurationError: it is the result of something else.
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
        """Claim an entry for as long as it is computed; false where another process computes it, or has finished it.

        The claim is a lock on a file, which the system releases when a process ends, however it ends.
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
        """What is finished under a name, by another process, too; ``None`` where it is not."""
        if self._path is not None and (file := self._path / f"{stem}.json").is_file():
            self._records[stem] = self._read(file)
        return self.find(stem)

    def keep(self, stem: str, definition: Mapping[str, Any], result: Mapping[str, Any]) -> None:
        """Keep what is finished.

        Raises:
            OSError: the file cannot be written.
        """
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
            raise ConfigurationError(f"{file}: is nothing that a race has left; remove it") from error
        for name in _differences(self._terms, terms[0]):
            shown = "" if name == TOML else f", {terms[0].get(name)} and not {self._terms[name]}"
            raise ConfigurationError(
                f"{file.parent.parent}: holds a race with {another(name)}{shown}; give another folder"
            )
        return record


def _differences(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[str]:
    """Names whose values differ; of TOML the content counts, for its comments name every part that is known."""
    return [name for name, value in ours.items() if _content(name, value) != _content(name, theirs.get(name, ""))]


def _content(name: str, value: Any) -> Any:
    return tomllib.loads(value) if name == TOML else value


def _plain(content: Mapping[str, Any]) -> dict[str, Any]:
    """Content as it comes back from a file."""
    return json.loads(json.dumps(content, allow_nan=False))


TEST_PHASE = "scoring in the test set"
STRESS_PHASE = "finding robustness margins"
PAPER_PHASE = "scoring the paper's gains"
LEAST_PHASE = "finding the least possible error"
"""Phases beside those of tuning."""


def scored(
    entrant: EntryProblem,
    terms: BenchmarkTerms,
    *,
    robustness: RobustnessCheck | None = None,
    workers: Workers = None,
    watch: TuningProgress = NO_PROGRESS,
) -> EntryResult:
    """Tune an entry, and score its best and its fronts in the test set.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted; nothing of it is of use.
    """
    began, problem = clock.now(), entrant.problem
    tuned = tune(
        problem,
        method=terms.method,
        rollouts=terms.rollouts,
        test_scenarios=min(terms.test_scenarios, problem.selection.sizes.test),
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
    broken = None
    if robustness:
        watch.phase(STRESS_PHASE)
        broken = robustness(tuned.best, workers)
    return EntryResult(
        entry=entrant.entry,
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
        stress=broken,
    )


def _point(problem: TuningProblem, evaluation: Evaluation, cost: str) -> FrontPoint:
    means, gains = evaluation.statistics, problem.space.settings(evaluation.point)
    return FrontPoint(means[f"mean.{cost}"], means[f"mean.{ERROR}"], kept=evaluation.feasible, gains=gains)


def paper(
    problem: TuningProblem, terms: BenchmarkTerms, *, workers: Workers = None, watch: TuningProgress = NO_PROGRESS
) -> BaselineScore:
    """The paper's gains in the test set, and the least error there.

    Args:
        problem: any of the race; ensemble, constraints and seed are those of all.
        terms: how many scenarios.
        workers: of this machine, or an executor; default: one thread a core.
        watch: shows the progress.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
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
    CHOOSING: 0.82,
    SCORING_BEST: 0.9,
    TEST_PHASE: 0.93,
    STRESS_PHASE: 0.95,
}
"""Phase → share of an entry's time that is over by then, roughly."""


class EntryProgress(TuningProgress):
    """Watches one entry, and reports how much of what is left of the race is done, and what is being done."""

    def __init__(self, name: str, number: int, of: int, progress: PhaseProgress) -> None:
        """Watch entry `number`, from 0, of so many that have to be run."""
        super().__init__()
        self._name, self._number, self._of, self._of_race = name, number, of, progress
        self._words = ""

    def phase(self, words: str) -> None:
        """Report what is done from now on."""
        self._words = words
        self._report(BEGINS.get(words, 0.0))

    def step(self, words: str, status: str = "") -> Progress:  # noqa: ARG002
        """Report nothing: of an entry the phases are enough."""
        return no_progress

    def progress(self, progress: SearchStatus, until: float | None, trials: int | None) -> None:  # noqa: ARG002
        """Report how far the search is."""
        self._report(BEGINS[SEARCHING] + progress.share * (BEGINS[CHOOSING] - BEGINS[SEARCHING]))

    def _report(self, share: float) -> None:
        number = f"{self._number + 1} of {self._of}, " if self._of > 1 else ""
        self._of_race((self._number + share) / self._of, f"{number}{self._name}: {self._words}")


def run_race(
    entrants: Sequence[EntryProblem],
    terms: BenchmarkTerms,
    *,
    folder: Path | None = None,
    robustness: RobustnessCheck | None = None,
    workers: Workers = None,
    progress: PhaseProgress = no_progress,
) -> BenchmarkResult:
    """Tune and score every entry that the folder does not hold yet; compute robustness margins if asked.

    An interrupt (Ctrl-C) keeps what is finished; the same call goes on with the rest.

    Args:
        entrants: at least one.
        terms: what is the same for all.
        folder: where finished entries are kept; those of earlier calls take part too, if they were run on these terms.
        robustness: finds the robustness margins of the best gains.
        workers: of this machine, or an executor; default: one thread a core.
        progress: called now and then with the share that is done of what there is to do, and with what is being done.

    Returns:
        The race; `BenchmarkResult.left` says how many entries an interrupt has left out.

    Raises:
        ConfigurationError: the folder holds a race on other terms.
        DualwinchError: no compiler, no usable cache folder, or no optimum found.
        KeyboardInterrupt: interrupted before the first entry was finished.
    """
    kept = ResultFolder(folder, terms.to_record())
    for each in entrants:
        kept.find(each.entry.stem, each.definition)
    called = names([each.entry for each in entrants])
    jobs = [RaceJob(PAPER_STEM, PAPER_STEM, entrants[0].problem, terms)]
    jobs += [
        RaceJob(each.entry.stem, called[each.entry.key], each.problem, terms, each, robustness) for each in entrants
    ]
    try:
        _run_jobs(jobs, kept, workers, progress)
    except KeyboardInterrupt:
        if not set(kept.stems) - {PAPER_STEM}:
            raise
    records = {stem: kept.find(stem) for stem in kept.stems}
    left = sum(job.lacks(records.get(job.stem)) for job in jobs)
    return BenchmarkResult(
        terms=terms,
        paper=BaselineScore.from_record(records.pop(PAPER_STEM) or {}),
        entries=tuple(EntryResult.from_record(record) for record in records.values() if record),
        left=left,
    )


@dataclass(frozen=True)
class RaceJob:
    """What is done at a time in a race: score the paper's gains, or tune and score an entry.

    Attributes:
        stem: under which the result is kept.
        name: shown to people.
        problem: that is tuned, or any of the race.
        terms: of the race.
        entrant: that is tuned; None: the paper's gains.
        robustness: finds the robustness margins of the best gains.
    """

    stem: str
    name: str
    problem: TuningProblem
    terms: BenchmarkTerms
    entrant: EntryProblem | None = None
    robustness: RobustnessCheck | None = None

    @property
    def definition(self) -> Mapping[str, Any]:
        """What it has to be the result of."""
        return self.entrant.definition if self.entrant else {}

    def lacks(self, record: Mapping[str, Any] | None) -> bool:
        """Whether something is still to be found out."""
        return record is None or (self.robustness is not None and record["stress"] is None)

    def watch(self, number: int, count: int, progress: PhaseProgress) -> TuningProgress:
        """Progress of this entry among the entries that have to be run."""
        if self.entrant is None:

            def phase_alone(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
                progress(0.0, phase)

            return EntryProgress(self.name, 0, 1, phase_alone)
        return EntryProgress(self.name, number, count, progress)

    def run(
        self, record: Mapping[str, Any] | None, workers: Workers = 1, watch: TuningProgress = NO_PROGRESS
    ) -> dict[str, Any]:
        """The result, JSON-ready; `record`: what is known of it."""
        if self.entrant is None:
            return paper(self.problem, self.terms, workers=workers, watch=watch).to_record()
        if record and self.robustness:
            watch.phase(STRESS_PHASE)
            gains = with_leaves(self.problem.experiment, record["gains"])
            return {**record, "stress": list(self.robustness(gains, workers))}
        return scored(self.entrant, self.terms, robustness=self.robustness, workers=workers, watch=watch).to_record()


PAUSE = 1.0
"""Time in s between two looks at what other processes have finished."""


def _run_jobs(jobs: Sequence[RaceJob], kept: ResultFolder, workers: Workers, progress: PhaseProgress) -> None:
    """Do what a folder lacks: one after the other here, or side by side on an executor's workers.

    Jobs that another process has claimed are left to it, and done here if it ends without a result.
    """
    waiting = [job for job in jobs if job.lacks(kept.find(job.stem))]
    count = sum(job.entrant is not None for job in waiting)
    while waiting:
        with ExitStack() as claims:
            ours = list[RaceJob]()
            for job in waiting:
                if claims.enter_context(kept.claimed(job.stem)) and job.lacks(kept.find(job.stem)):
                    ours.append(job)
                    if not isinstance(workers, Executor):
                        break
            finished = count - sum(job.entrant is not None for job in waiting)
            if not ours:
                progress(0.0, f"another process has claimed what is left, {len(waiting)} searches and scores")
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
    """Do jobs side by side on an executor's workers; what is finished is kept at once."""
    if jobs:
        progress(0.0, f"{len(jobs)} searches and scores on the cluster")
    tasks = ((job, kept.find(job.stem)) for job in jobs)
    for done, (number, result) in enumerate(spread(executor, RaceJob.run, tasks), 1):
        kept.keep(jobs[number].stem, jobs[number].definition, result)
        progress(done / len(jobs), f"{done} of {len(jobs)} done on the cluster, {jobs[number].name} last")
