"""What exact gradients save: the best of 1 000 trials by TPE, and how many rollouts the gradient method needs for it.

``python -m benchmarks.gradient`` prints the table; ``--write FILE`` puts it between the file's two marks. The problem
is Case 4 with perfect sensors, six gains, no more chatter than the paper's gains. A gradient counts as so many rollouts
as it takes time for, measured in the same run.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.convergence import rollout_time
from benchmarks.document import markdown, put
from dualwinch import tuning_problem
from dualwinch.simulation.batch.sensitivities import sensitivities
from dualwinch.simulation.loop.structure import parameters_of
from dualwinch.simulation.paper import case
from dualwinch.tuning.optimisers import Optimiser, optimiser
from dualwinch.tuning.optimisers.gradient import GradientSearch
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import NO_PROGRESS, SearchStatus, TuningProgress
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare
from dualwinch.tuning.storage.connection import quiet
from dualwinch.tuning.storage.store import MemoryStorage, SearchBudget
from dualwinch.tuning.study import search

GAINS = (
    *(f"controller.nftsm.{name}" for name in ("beta", "eta", "k", "phi")),
    *(f"controller.observer.{name}" for name in ("l0", "kf")),
)
"""The gains that are tuned."""

SEEDS, TRIALS, ALLOWED = range(1, 9), 1000, 50.0
"""Seeds of the searches, trials of TPE, and rollouts that the gradient method is given."""

ROUNDS = 9
"""Measurements of a gradient and of a rollout, the shortest of which counts."""


@dataclass(frozen=True)
class Race:
    """One seed's result: errors in m², and when the gradient method was as good, or ``None``."""

    seed: int
    tpe: float
    gradient: float
    needed: float | None


@dataclass
class Improvements(TuningProgress):
    """The best feasible objective over what it had cost, in rollouts.

    Attributes:
        method: counts its gradients.
        gradient_cost: of one, in rollouts.
        found: (rollouts, objective in m²) after each batch.
    """

    method: GradientSearch
    gradient_cost: float
    found: list[tuple[float, float]] = field(default_factory=list)

    def progress(self, progress: SearchStatus, until: float | None, trials: int | None) -> None:  # noqa: ARG002
        """Remember where the search stands."""
        if progress.best and progress.best.feasible:
            spent = progress.trials + self.gradient_cost * self.method.gradients
            self.found.append((spent, progress.best.objectives[0]))


def cost_of_a_gradient() -> float:
    """Time of the gradient by all gains over that of a rollout, each as one call on one thread."""
    experiment = case(4)
    values = [parameters_of(experiment)[name] for name in GAINS]
    gradient = _shortest(lambda: sensitivities(GAINS, [values], [experiment], stride=10, workers=1))
    return gradient / (1e-3 * rollout_time(experiment, ROUNDS))


def race(seed: int, gradient_cost: float) -> Race:
    """Both methods on the same problem."""
    prepared = prepare(tuning_problem(case=4, space=GAINS, seed=seed))
    best = _search(prepared, "tpe", optimiser("tpe", prepared, seed), TRIALS)
    method = GradientSearch(prepared, seed)
    watch = Improvements(method, gradient_cost)
    _search(prepared, "gradient", method, int(ALLOWED), watch)
    needed = next((spent for spent, value in watch.found if value <= best and spent <= ALLOWED), None)
    return Race(seed, best, min(value for spent, value in watch.found if spent <= ALLOWED), needed)


def table(races: Sequence[Race]) -> str:
    """The races as a Markdown table."""
    rows = [
        [
            str(race.seed),
            f"{1e12 * race.tpe:.3g}",
            f"{1e12 * race.gradient:.3g}",
            f"{race.gradient / race.tpe:.2g}",
            f"{race.needed:.0f}" if race.needed else f"more than {ALLOWED:.0f}",
        ]
        for race in races
    ]
    headings = [
        "seed",
        f"TPE, best MSE of {TRIALS} (µm²)",
        f"gradient, best MSE within {ALLOWED:.0f} (µm²)",
        "ratio",
        "rollouts to TPE's best",
    ]
    return markdown(headings, rows)


def _search(
    prepared: TrainingSet, name: str, proposer: Optimiser, trials: int, watch: TuningProgress = NO_PROGRESS
) -> float:
    progress = search(name, proposer, MemoryStorage(SearchBudget(trials)), Evaluator(prepared), watch)
    if progress.best is None or not progress.best.feasible:
        raise RuntimeError(f"{name}: found no candidate that satisfies the constraints")
    return progress.best.objectives[0]


def _shortest(call: Callable[[], object]) -> float:
    times: list[float] = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> None:
    """Race, and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    arguments = parser.parse_args()
    quiet()
    cost = cost_of_a_gradient()
    races: list[Race] = []
    for seed in SEEDS:
        races.append(race(seed, cost))
        sys.stderr.write(f"{len(races)} of {len(SEEDS)} seeds\n")
    reached = sum(race.needed is not None for race in races)
    text = (
        f"{table(races)}\n\n*A gradient by {len(GAINS)} gains takes as long as {cost:.1f} rollouts; "
        f"TPE's best is reached within {ALLOWED:.0f} in {reached} of {len(races)} races.*"
    )
    print(text)
    if arguments.write:
        put(arguments.write, "gradient", text)


if __name__ == "__main__":
    main()
