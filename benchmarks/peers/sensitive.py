"""dualwinch: a rollout with its exact derivatives by twelve gains, in one call."""

import numpy as np

from benchmarks.case import Case
from benchmarks.peers.peer import Answer, Run, UnavailableError
from dualwinch import sensitivities
from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.simulation.metrics.metrics import Metrics

GAINS = (
    "controller.nftsm.beta",
    "controller.nftsm.eta",
    "controller.nftsm.k",
    "controller.nftsm.phi",
    "controller.observer.l0",
    "controller.observer.kf",
    "controller.observer.filter_time",
    "controller.auxiliary.k_a",
    "controller.winch_1.kp",
    "controller.winch_1.ki",
    "controller.winch_2.kp",
    "controller.winch_2.ki",
)


def prepare(case: Case) -> Run:
    """`sensitivities` from an experiment to arrays: the derivatives of the error at each sample, and of the metrics."""
    experiment, values = case.experiment, [[case.named_parameters[name] for name in GAINS]]

    def run(*, keep: bool = False) -> Answer:
        found = sensitivities(GAINS, values, [experiment], workers=1)
        metrics = Metrics(**{name: float(table[0, 0]) for name, table in found.metrics.items()})
        if not keep:
            return Answer(np.nan, metrics)
        x = found.errors[0, 0] + case.exogenous[:, case.loop.exogenous.index("reference.x")]
        last = 2 * x[-1] - x[-2]  # an error is kept of a sample's beginning
        return Answer(float(last), metrics, np.append(x[1:], last))

    try:
        run()
    except CompilerNotFoundError as error:
        raise UnavailableError(str(error)) from error
    return run
