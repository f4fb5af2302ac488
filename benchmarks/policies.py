"""What policies are worth in scenarios of the sea that nobody tuned on: gains of the paper, tuned ones, chance.

``python -m benchmarks.policies`` tunes for a while and prints the table; ``--write FILE`` puts it between the file's
two marks.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.document import markdown, put
from benchmarks.scored import SEED, TEST_SEED
from dualwinch import tuning_problem
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.toolboxes.stepper.environments.environment import HOLD
from dualwinch.toolboxes.stepper.environments.task import Task
from dualwinch.tuning.tune import tune

Floats: TypeAlias = NDArray[np.float64]
Policy: TypeAlias = Callable[[dict[str, Floats]], Floats]
"""``(signal → (lanes,)) -> forces (lanes,) in N``."""

SCENARIOS, SECONDS = 64, 20.0
"""Scenarios that score, and the length of the search in s."""


@dataclass(frozen=True)
class Score:
    """Mean reward of a step in m², scenario by scenario; NaN where the run was lost."""

    name: str
    rewards: Floats

    def row(self) -> list[str]:
        """For the table."""
        kept = self.rewards[np.isfinite(self.rewards)]
        found = [f"{value:.3g}" for value in (kept.mean(), np.median(kept), kept.min())] if kept.size else ["–"] * 3
        return [self.name, *found, f"{self.rewards.size - kept.size} of {self.rewards.size}"]


def of_controller(name: str, controller: Controller, ensemble: Ensemble, seed: int, count: int) -> Score:
    """A controller, at 1 kHz, by its errors at the ends of an environment's steps."""
    experiment = replace(ensemble.experiment, controller=controller)
    scenarios = list(replace(ensemble, experiment=experiment).scenarios(count, seed))
    errors = rollout([], np.empty((1, 0)), scenarios, stride=HOLD).columns["e"][0, :, 1:]
    return Score(name, -np.mean(errors**2, axis=1))


def of_policy(name: str, policy: Policy, ensemble: Ensemble, seed: int, count: int) -> Score:
    """A policy of the environment in the same scenarios."""
    task = Task(ensemble, count, command="force", hold=HOLD, reward=None, exact=False)
    task.start(np.arange(count), [seed] * count, list(range(count)))
    total, steps, lost = np.zeros(count), 0, np.zeros(count, bool)
    while task.stepper.running.any():
        observation = dict(zip(task.bounds, task.observation.T, strict=True))
        rewards, gone, _ = task.step(policy(observation)[:, np.newaxis])
        total, lost, steps = total + rewards, lost | gone, steps + 1
    return Score(name, np.where(lost, np.nan, total / steps))


def by_chance(limit: float, seed: int = 0) -> Policy:
    """Any force within the limit, at each step anew."""
    rng = np.random.default_rng(seed)
    return lambda now: rng.uniform(-limit, limit, now["t"].shape)


def proportional_derivative(mass: float, rate: float = 3.0) -> Policy:
    """Feedforward of the reference's acceleration and two poles at −rate, in 1/s; the lesson's first policy."""
    return lambda now: mass * (now["a_ref"] - rate**2 * now["e_sensed"] - 2 * rate * (now["v_sensed"] - now["v_ref"]))


def table(scores: list[Score]) -> str:
    """All policies."""
    headings = ["policy", "mean reward of a step (m²)", "median scenario", "worst scenario", "lost"]
    return markdown(headings, [score.row() for score in scores])


def main() -> None:
    """Tune, score, and print or write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    parser.add_argument("--seconds", type=float, default=SECONDS, metavar="S", help=f"of the search ({SECONDS:g})")
    arguments = parser.parse_args()
    sea = load_ensemble("sea")
    limits, vehicle = sea.experiment.controller.limits, sea.experiment.plant.vehicle
    sys.stderr.write(f"tuning for {arguments.seconds:g} s\n")
    tuned = tune(tuning_problem(ensemble="sea", seed=SEED), seconds=arguments.seconds).best.controller
    given = sea, TEST_SEED, SCENARIOS
    scores = [
        of_controller("the paper's gains", paper_controller(), *given),
        of_controller(f"tuned for {arguments.seconds:g} s", tuned, *given),
        of_policy("the lesson's, 50 times a second", proportional_derivative(vehicle.mass), *given),
        of_policy("by chance", by_chance(limits.force), *given),
    ]
    text = f"{table(scores)}\n\n*{SCENARIOS} scenarios of `sea`, seed {TEST_SEED}; search with seed {SEED}.*"
    print(text)
    if arguments.write:
        put(arguments.write, "policies", text)


if __name__ == "__main__":
    main()
