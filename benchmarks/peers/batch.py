"""dualwinch: many rollouts in one call, in vector lanes; the time is a rollout's share."""

from collections.abc import Callable

import numpy as np

from benchmarks.case import Case
from benchmarks.peers.peer import Answer, Run, UnavailableError
from codegen import CompilerNotFoundError
from simulation.batch import rollout
from simulation.metrics import Metrics

ROLLOUTS = 64
"""Rollouts of one timed call, with as many observer gains around the case's own, which comes first."""

GAIN = "controller.observer.l0"


def prepare_with(threads: int) -> Callable[[Case], Run]:
    """Rollouts on some threads."""

    def prepare(case: Case) -> Run:
        gains = case.named_parameters[GAIN] * np.linspace(1, 2, ROLLOUTS)[:, None]
        try:
            rollout([GAIN], gains[:1], [case.experiment])
        except CompilerNotFoundError as error:
            raise UnavailableError(str(error)) from error

        def run(*, keep: bool = False) -> Answer:
            chosen = gains[:1] if keep else gains
            result = rollout([GAIN], chosen, [case.experiment], stride=1 if keep else 0, threads=threads)
            metrics = Metrics(**{name: float(table[0, 0]) for name, table in result.metrics.items()})
            if not keep:
                return Answer(np.nan, metrics)
            x = result.columns["x"][0, 0]
            # a row is a sample's beginning; the last position is within a sample of the last row
            positions = np.append(x[1:], x[-1] + result.columns["v"][0, 0, -1] * case.experiment.simulation.sample_time)
            return Answer(float(positions[-1]), metrics, positions)

        return run

    return prepare
