"""Which hard scenarios every candidate meets: those in which the best have lately come off worst.

Gains that do not hold mostly fail in the same few scenarios, but as the search goes on these become others. Were every
candidate tried in the same ones, the search would follow those that keep to their bounds just there.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.scoring.runs import worst_of

Floats = NDArray[np.float64]

KEPT = 0.7
"""What remains of what is known of a scenario whenever some of the best have been tried in it again."""

FURTHER = 16
"""Number of the other hard scenarios, the hardest of them, in which the best are tried."""

WITHIN, BEYOND = -0.02, 0.1
"""Within and beyond its bound, as shares of it, one value is like another: neither near, or both failed."""


class Hardness:
    """The scenarios of a problem in the order in which they are worth trying.

    The typical ones and as many hard ones as there are in `Prepared.scenarios` are for every candidate. Of the others
    the hardest (`FURTHER`) are for the best, and the rest is for finding out whether it has become harder.
    """

    def __init__(self, prepared: Prepared) -> None:
        """Start with the scenarios as they were prepared."""
        self._all = [*prepared.scenarios, *prepared.stress]
        self._order = np.arange(len(self._all))
        self._common = len(prepared.scenarios)
        self._constraints = prepared.constraints
        self._hard = np.array([isinstance(scenario, Scenario) and scenario.hard for scenario in self._all])
        self._worst = np.full(len(self._all), WITHIN)

    @property
    def everyones(self) -> tuple[Experiment | Scenario, ...]:
        """What every candidate is tried in, typical and hard ones in turns."""
        return tuple(self._all[index] for index in self._order[: self._common])

    @property
    def further(self) -> tuple[Experiment | Scenario, ...]:
        """The hardest of the other hard ones (`FURTHER`)."""
        return tuple(self._all[index] for index in self._order[self._common :][:FURTHER])

    @property
    def rest(self) -> tuple[Experiment | Scenario, ...]:
        """The least hard ones."""
        return tuple(self._all[index] for index in self._order[self._common :][FURTHER:])

    def learn(self, results: Sequence[BatchResult]) -> None:
        """Learn from results, a row each, in everyone's scenarios, the further ones and maybe the rest, in order."""
        if not results:
            return
        places = self._order[: results[0].outcomes.shape[1]]
        met = [self._all[index] for index in places]
        values = np.array([worst_of(result, self._constraints, met)[0] for result in results]).clip(WITHIN, BEYOND)
        self._worst[places] = KEPT * self._worst[places] + (1 - KEPT) * values.mean(axis=0)
        hard_places = self._hard[self._order]
        hard = self._order[hard_places]
        self._order[hard_places] = hard[np.argsort(-self._worst[hard], kind="stable")]
