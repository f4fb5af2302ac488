"""Runs the scenarios of many sizes at once."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from dualwinch.codegen.drivers.batch import compile_batch
from dualwinch.controllers.controller import Controller
from dualwinch.simulation.batch.grid import Pairs
from dualwinch.simulation.batch.sweep import run_grid
from dualwinch.simulation.batch.threads import map_all
from dualwinch.tuning.stress.limits import Reached
from dualwinch.tuning.stress.scaling import Scaling


class Bench:
    """Runs scenarios, and tells how much of what is expected has been done."""

    def __init__(
        self, scaling: Scaling, expected: int, threads: int | None, progress: Callable[[float], None] | None
    ) -> None:
        """Set the bench up.

        Args:
            scaling: gives the scenarios.
            expected: number of sizes that will be run, at most.
            threads: default: one a core.
            progress: called now and then with the share that is done.
        """
        self._scaling, self._expected, self._threads, self._progress = scaling, expected, threads, progress
        self._done = 0

    def compile(self, controllers: Iterable[Controller], sizes: Sequence[Mapping[str, float]]) -> None:
        """Compile what scenarios of some sizes are run by, side by side: a compiler takes longer than all their runs.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        first = [self._scaling.scenario(0, controller, each) for controller in controllers for each in sizes]
        loops = dict.fromkeys(Pairs([], np.empty((1, 0)), [scenario]).loop for scenario in first)
        map_all(compile_batch, list(loops), self._threads)

    def run(self, controller: Controller, sizes: Sequence[Mapping[str, float]]) -> list[Reached]:
        """What the scenarios of each of some sizes come to.

        Args:
            controller: with the gains.
            sizes: key → size of what is scaled; nothing: the base.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        scenarios = np.empty((len(sizes), self._scaling.count), dtype=object)
        for row, each in enumerate(sizes):
            scenarios[row] = self._scaling.scenarios(controller, each)

        def report(share: float, before: int = self._done) -> None:
            if self._progress:
                self._progress((before + share * len(sizes)) / self._expected)

        runs = run_grid(scenarios, threads=self._threads, progress=report)
        if runs.interrupted:
            raise KeyboardInterrupt
        self._done += len(sizes)
        metrics = [{name: values[row] for name, values in runs.metrics.items()} for row in range(len(sizes))]
        return [Reached(*each) for each in zip(runs.outcomes, metrics, strict=True)]
