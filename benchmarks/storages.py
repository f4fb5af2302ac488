"""What a batch of 16 trials costs in each storage of a study, and as waiting trials that were enqueued before.

``python -m benchmarks.storages`` prints the table; ``--write FILE`` puts it between the file's two marks. PostgreSQL is
a server of its own on this machine, on a socket; SQLite, which `dualwinch tune` does not take, shows what a transaction
costs without a server. Nothing is simulated: candidates and evaluations are made up.

*Waiting trials* are the other way to an exact number of trials: as many as there shall be are enqueued when the study
is made, `Study.ask` pops them, and a sampler hands out the points.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import optuna
from sqlalchemy import Engine, event

from benchmarks.document import duration, markdown, put
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.storage import database
from dualwinch.tuning.storage.database import DatabaseStudy
from dualwinch.tuning.storage.journal import JournalStudy, SharedJournalStudy
from dualwinch.tuning.storage.record import ORIGIN, distributions, finish, finished_trial
from dualwinch.tuning.storage.store import SearchBudget, StudyStorage
from dualwinch.tuning.tuning_problem import definition_of, tuning_problem
from tests import postgres

BATCH, BATCHES = 16, 3
"""Trials of a batch, and batches of which the median counts."""

THERE = (0, 1000)
"""Finished trials of the study before."""

BUDGET = SearchBudget(trials=4000)

Claim = Callable[[], object]


@dataclass
class Counter:
    """Transactions that were committed."""

    commits: int = 0

    def on(self, engine: Engine) -> "Counter":
        """Count those of an engine."""

        def committed(_: object) -> None:
            self.commits += 1

        event.listen(engine, "commit", committed)
        return self


def evaluation(problem: TuningProblem, candidate: Candidate) -> Evaluation:
    """A made-up result of the usual size."""
    return Evaluation(
        candidate=candidate,
        objectives=(1e-6,),
        violations={constraint.label: -0.1 for constraint in problem.constraints},
        statistics={"mean.mse": 1e-6, "mean.chatter": 5.0, "worst.peak_tension": 5e3, "worst.min_tension": 1e2},
        outcomes={"completed": 12},
        scenarios=12,
        units={"mean.mse": "m^2", "mean.chatter": "N", "worst.peak_tension": "N", "worst.min_tension": "N"},
    )


class Points(optuna.samplers.BaseSampler):
    """A sampler that hands out a point that was proposed elsewhere."""

    def __init__(self) -> None:
        self.point = {}

    def infer_relative_search_space(self, study, trial):  # noqa: ARG002
        """Nothing: every parameter is handed out by itself."""
        return {}

    def sample_relative(self, study, trial, search_space):  # noqa: ARG002
        """Nothing."""
        return {}

    def sample_independent(self, study, trial, param_name, param_distribution):  # noqa: ARG002
        """The point's value."""
        return self.point[param_name]


class Batches:
    """Batches of a study, by its storage or by waiting trials."""

    def __init__(self, problem: TuningProblem) -> None:
        """Candidates are drawn in the space of the problem."""
        self._problem, self._random = problem, np.random.default_rng(0)

    def candidates(self, count: int) -> list[Candidate]:
        """Candidates at random."""
        space = self._problem.space
        points = self._random.random((count, len(space.dimensions)))
        return [Candidate(space.decoded(point), "cmaes") for point in points]

    def of_store(self, store: StudyStorage) -> Iterator[None]:
        """Claim a batch, then finish it, as `tuning.study.search` does."""
        while True:
            claims = store.claim(BATCH, BUDGET, lambda count, _: self.candidates(count))
            yield
            store.finish(claims, [evaluation(self._problem, claim.candidate) for claim in claims])
            yield

    def of_waiting(self, study: optuna.Study, sampler: Points) -> Iterator[None]:
        """The same with trials that wait."""
        space = distributions(self._problem.space)
        while True:
            claimed = []
            for candidate in self.candidates(BATCH):
                sampler.point = dict(candidate.point)
                trial = study.ask(space)
                trial.set_user_attr(ORIGIN, candidate.origin)
                claimed.append((trial, candidate))
            yield
            for trial, candidate in claimed:
                finish(study, trial, evaluation(self._problem, candidate))
            yield

    def finished(self, count: int) -> list[optuna.trial.FrozenTrial]:
        """Trials that are there before."""
        return [finished_trial(evaluation(self._problem, each), self._problem.space) for each in self.candidates(count)]


def measured(steps: Iterator[None], counter: Counter) -> list[str]:
    """Median times to claim and to finish a batch, and the transactions of both."""
    times, commits = [], []
    for _ in range(BATCHES + 1):
        before = counter.commits
        times.append([timed(steps) for _ in range(2)])
        commits.append(counter.commits - before)
    claiming, finishing = (median(each[part] for each in times[1:]) for part in range(2))
    return [duration(claiming), duration(finishing), str(median(commits[1:])) if counter.commits else "–"]


def timed(steps: Iterator[None]) -> float:
    """Time in s of a step."""
    begin = time.perf_counter()
    next(steps)
    return time.perf_counter() - begin


@contextmanager
def sqlite(file: Path) -> Iterator[str]:
    """A database in a file, and its URL, which storages of databases take meanwhile."""
    url = f"sqlite:///{file}"

    def opened(_: str) -> optuna.storages.RDBStorage:
        callback = optuna.storages.RetryHeartbeatStaleTrialCallback()
        return optuna.storages.RDBStorage(
            url, heartbeat_interval=60, grace_period=600, heartbeat_stale_trial_callback=callback
        )

    with patch.object(database, "connected", opened):
        yield url


def rows_of_database(name: str, url: str, problem: TuningProblem, there: int) -> Iterator[list[str]]:
    """A study in a database; without trials before, one of waiting trials in the same, too."""
    batches, study = Batches(problem), f"places {there}"
    definition = definition_of(problem, "cmaes")
    store = DatabaseStudy.begin(url, study, problem, definition, BUDGET, resume=False)
    storage = store._storage  # noqa: SLF001
    optuna.load_study(study_name=study, storage=storage).add_trials(batches.finished(there))
    counter = Counter().on(storage.engine)
    yield [name, str(there), *measured(batches.of_store(store), counter)]
    if there:
        store.close()
        return
    sampler = Points()
    waiting = optuna.create_study(study_name="waiting", storage=storage, sampler=sampler)
    empty = optuna.trial.create_trial(state=optuna.trial.TrialState.WAITING)
    waiting.add_trials([empty] * (BATCH * (BATCHES + 1)))
    yield [f"{name}, waiting trials", str(there), *measured(batches.of_waiting(waiting, sampler), counter)]
    store.close()


def rows_of_journal(folder: Path, problem: TuningProblem, there: int) -> Iterator[list[str]]:
    """A study in a journal file, of one process and shared."""
    definition = definition_of(problem, "cmaes")
    for begin, words in ((JournalStudy, "journal file"), (SharedJournalStudy.begin, "journal file, shared")):
        batches, file = Batches(problem), folder / f"{words} {there}"
        store = begin(file, "study", problem, definition, BUDGET, resume=True)
        known = [evaluation(problem, candidate) for candidate in batches.candidates(there)]
        for first in range(0, there, BATCH):
            store.finish([], known[first : first + BATCH])
        yield [words, str(there), *measured(batches.of_store(store), Counter())]
        store.close()


def table() -> str:
    """Every storage."""
    problem = tuning_problem(ensemble="sea")
    rows: list[list[str]] = []
    with TemporaryDirectory() as folder, postgres.server() as server:
        for there in THERE:
            rows += rows_of_journal(Path(folder), problem, there)
            if not there:
                with sqlite(Path(folder) / "study.db") as url:
                    rows += rows_of_database("SQLite", url, problem, there)
            rows += rows_of_database("PostgreSQL", postgres.url_of(server), problem, there)
    headings = ["16 trials in", "trials before", "to claim", "to finish", "transactions"]
    words = (
        f"Median of {BATCHES} batches; {len(problem.space.dimensions)} gains, {len(problem.constraints)} constraints."
    )
    return f"{markdown(headings, rows)}\n\n*{words}*"


def main() -> None:
    """Print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    arguments = parser.parse_args()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    text = table()
    print(text)
    if arguments.write:
        put(arguments.write, "storages", text)


if __name__ == "__main__":
    main()
