"""dualwinch: many rollouts in one call, in vector lanes; the time is a rollout's share."""

from collections.abc import Callable

import numpy as np

from benchmarks.case import Case
from benchmarks.peers.candidates import GAIN, gains
from benchmarks.peers.peer import Answer, Run, UnavailableError
from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.metrics.metrics import Metrics


def prepare_with(threads: int) -> Callable[[Case], Run]:
    """Rollouts on some threads."""

    def prepare(case: Case) -> Run:
        candidates = gains(case)[:, None]
        try:
            rollout([GAIN], candidates[:1], [case.experiment])
        except CompilerNotFoundError as error:
            raise UnavailableError(str(error)) from error

        def run(*, keep: bool = False) -> Answer:
            result = rollout([GAIN], candidates, [case.experiment], workers=threads)
            metrics = Metrics(**{name: float(table[0, 0]) for name, table in result.metrics.items()})
            if not keep:
                return Answer(np.nan, metrics, errors=result.metrics["mse"][:, 0])
            first = rollout([GAIN], candidates[:1], [case.experiment], stride=1)
            x = first.columns["x"][0, 0]
            # a row is a sample's beginning; the last position is within a sample of the last row
            last = x[-1] + first.columns["v"][0, 0, -1] * case.experiment.simulation.sample_time
            return Answer(float(last), metrics, np.append(x[1:], last), result.metrics["mse"][:, 0])

        return run

    return prepare
