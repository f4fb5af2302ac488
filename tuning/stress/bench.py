"""Runs the scenarios of many sizes at once."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dualwinch.controllers.controller import Controller
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.tuning.stress.limits import Runs
from dualwinch.tuning.stress.scaling import Scaling


class Bench:
    """Runs scenarios, and tells how much of what is expected has been done."""

    def __init__(
        self, scaling: Scaling, expected: int, threads: int | None, progress: Callable[[float], None] | None
    ) -> None:
        """Set the bench up.

        Args:
            scaling: gives the scenarios.
            expected: number of sizes that will be run.
            threads: default: one a core.
            progress: called now and then with the share that is done.
        """
        self._scaling, self._expected, self._threads, self._progress = scaling, expected, threads, progress
        self._done = 0.0

    def run(self, controller: Controller, sizes: Sequence[Mapping[str, float]]) -> list[Runs]:
        """What the scenarios of each of some sizes come to.

        Args:
            controller: with the gains.
            sizes: key → size of what is scaled; nothing: the base.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        scaling, count = self._scaling, self._scaling.count
        scenarios = [scenario for each in sizes for scenario in scaling.scenarios(controller, each)]
        groups: dict[tuple, list[int]] = {}  # scenarios of one group are run by the same compiled code
        for number, scenario in enumerate(scenarios):
            groups.setdefault(tuple(scenario.draws.get(key) for key in scaling.shaping), []).append(number)
        outcomes, metrics = np.empty(len(scenarios), dtype="U10"), {}
        for numbers in groups.values():
            portion = [scenarios[number] for number in numbers]
            result = rollout([], np.empty((1, 0)), portion, threads=self._threads, progress=self._told(len(numbers)))
            if result.interrupted:
                raise KeyboardInterrupt
            self._done += len(numbers) / count
            outcomes[numbers] = result.outcomes[0]
            for name, values in result.metrics.items():
                metrics.setdefault(name, np.empty(len(scenarios)))[numbers] = values[0]
        parts = [slice(first, first + count) for first in range(0, len(scenarios), count)]
        return [Runs(outcomes[part], {name: values[part] for name, values in metrics.items()}) for part in parts]

    def _told(self, scenarios: int) -> Callable[[float], None]:
        """What tells of the scenarios that are under way."""

        def tell(share: float) -> None:
            if self._progress:
                self._progress(min((self._done + share * scenarios / self._scaling.count) / self._expected, 1.0))

        return tell
