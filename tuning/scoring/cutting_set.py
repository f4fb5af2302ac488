"""The cutting set: draws and machines that a leader of the search failed in, and the back-off of the bounds.

A cutting-set method with a pessimising oracle by sampling (Mutapcic and Boyd, Optimization Methods and Software 24,
2009): candidates are optimised over few scenarios; the leader is run in fresh ones; those in which it violates a bound
join the training set, and constraints with much slack are dropped again.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.margin_survey import WorstMargin, comparable_value
from dualwinch.analysis.resonance import MARGIN_AMPLITUDES
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.training_set import TRAINING_MACHINES, TrainingSet, survey

CUTS_AT_ONCE = 3
"""Largest number of cuts by one check: the draws with the largest violations."""

Place = tuple[int, int]
"""Numbers of an operating point and an amplitude."""

Loop = tuple[int, int, int]
"""Numbers of a machine, an operating point and an amplitude."""


class CuttingSet:
    """Cuts, machines and back-off of a search.

    Attributes:
        draws: number of a random draw → the scenario, or the experiment.
        cuts: number of a cut → its scenario.
        back_off: label of a bound → distance to keep from it, as a share: by how much a candidate's mean in fresh
            draws, or the worst run of one that was not certified, exceeded that in training. Bounds on margins need
            none: machines that violate them are cuts.
        survey: of the nominal machine, the drawn ones of the training set and those of cuts; ``None``: no margin is
            bounded.
        version: number of changes of `survey`.
    """

    def __init__(self, training: TrainingSet) -> None:
        self._training = training
        self.draws = dict(enumerate(training.scenarios))
        self.cuts = dict(enumerate(training.hard, len(self.draws)))
        self._number = len(self.draws) + len(self.cuts)
        self.back_off: dict[str, float] = {}
        self.survey, self.version = training.margins, 0
        machines = [each for each in training.scenarios[:TRAINING_MACHINES] if isinstance(each, Scenario)]
        self._machines = dict(enumerate(machines, 1))
        self._slack: dict[int, float] = {}
        self._violations: Mapping[int, float] = {}
        self._loops: set[Loop] = set()

    @property
    def scenarios(self) -> dict[int, Experiment | Scenario]:
        """The draws and the cuts."""
        return self.draws | self.cuts

    def add_draws(self, draws: Sequence[Scenario], violations: Sequence[float]) -> dict[int, int]:
        """Add the draws with the largest violations; return the number of each new cut → its index in `draws`."""
        order = np.argsort(-np.asarray(violations), kind="stable")[:CUTS_AT_ONCE].tolist()
        numbers = dict(zip(range(self._number, self._number + len(order)), order, strict=True))
        self.cuts |= {number: draws[index] for number, index in numbers.items()}
        self._number += len(order)
        return numbers

    @property
    def by_slack(self) -> list[int]:
        """Numbers of the cuts, those with the least slack at the last leader first."""
        return sorted(self.cuts, key=lambda number: -self._violations.get(number, np.inf))

    def drop_draws(self, violations: Mapping[int, float]) -> None:
        """Drop the cuts with the most slack at the leader, with these violations, beyond the largest number of cuts."""
        self._violations = violations
        self.cuts = {
            number: self.cuts[number] for number in sorted(self.by_slack[: self._training.problem.options.cuts])
        }

    def learn_back_off(self, fresh: Mapping[str, float], training: Mapping[str, float]) -> None:
        """Raise the back-off of violated bounds to the candidate's slack in training plus its excess.

        Args:
            fresh: label → violation in fresh scenarios.
            training: label → violation in training, without back-off.
        """
        for label, violation in fresh.items():
            if violation > 0:
                self.back_off[label] = max(self.back_off.get(label, 0.0), violation - training[label])

    def add_machine(self, machine: Scenario) -> None:
        """Add a machine; beyond the largest number, the one with the most slack at the last leader goes."""
        numbers, largest = list(self._machines), TRAINING_MACHINES + self._training.problem.options.machines_checked
        if len(numbers) >= largest:
            dropped = max(numbers, key=lambda number: self._slack.get(number, 0.0))
            del self._machines[dropped]
            self._loops = {loop for loop in self._loops if loop[0] != dropped}
        self._machines[max(numbers, default=0) + 1] = machine
        self.survey = survey(self._training.problem, list(self._machines.values()), self._training.workers)
        self.version += 1

    @property
    def _numbers(self) -> list[int]:
        """Number of each machine of the survey; the nominal one is 0."""
        return [0, *self._machines]

    @property
    def active(self) -> NDArray[np.intp] | None:
        """Indices of the active loops in the survey: those that were the least of a leader; ``None``: all."""
        if self.survey is None or not self._loops:
            return None
        numbers = self._numbers
        return np.array(
            [
                index
                for index, (machine, *place) in enumerate(self.survey.loops.tolist())
                if (numbers[machine], *place) in self._loops
            ],
            dtype=np.intp,
        )

    @property
    def active_places(self) -> set[Place] | None:
        """Operating points and amplitudes of the active loops, whatever their machines; ``None``: all."""
        return {(point, amplitude) for _, point, amplitude in self._loops} or None

    def learn_loops(self, parameters: Sequence[float], kinds: Sequence[str]) -> dict[str, WorstMargin]:
        """The least margins of gains in all loops; the least loops become active, on new machines one of each kind."""
        surveyed = self.survey
        if surveyed is None:
            return {}
        by_rule = [kind for kind in kinds if kind in MARGIN_AMPLITUDES]
        margins = surveyed.worst([parameters], by_rule)[0] if by_rule else {}
        (of_loops,), numbers = surveyed.of_loops([parameters], kinds), self._numbers
        machines = set(range(len(numbers))) - {numbers.index(number) for number, *_ in self._loops}
        for kind in kinds:
            if kind in by_rule:
                continue
            values = np.array([margins_of[kind].value for margins_of in of_loops])
            margins |= {kind: min((margins_of[kind] for margins_of in of_loops), key=comparable_value)}
            margin_of = {
                numbers[machine]: values[surveyed.loops[:, 0] == machine].min() for machine in range(len(numbers))
            }
            self._slack |= {machine: float(value) for machine, value in margin_of.items()}
            places = {int(values.argmin())}
            for machine in machines:
                mine = np.flatnonzero(surveyed.loops[:, 0] == machine)
                places.add(int(mine[values[mine].argmin()]))
            self._loops |= self._named(places)
        return margins

    def _named(self, places: set[int]) -> set[Loop]:
        """The loops at some indices of the survey."""
        numbers, loops = self._numbers, self.survey.loops.tolist() if self.survey else []
        return {(numbers[loops[place][0]], loops[place][1], loops[place][2]) for place in places}
