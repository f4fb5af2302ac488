"""Archimedes (NumPy's names on CasADi's graphs): `benchmarks.by_hand.arrays` in a compiled `scan` over samples."""

import numpy as np

from benchmarks.by_hand.arrays import ByHand
from benchmarks.by_hand.control import IDLE
from benchmarks.by_hand.parameters import parameters_from
from benchmarks.by_hand.plant import constants
from benchmarks.case import Case
from benchmarks.peers.peer import Answer, Run, UnavailableError
from dualwinch.simulation.metrics.metrics import Metrics

PLANT = 6
"""Elements of the carried vector that are the plant's; the controller's and the sum of squares follow."""


def prepare(case: Case) -> Run:
    """Build the graph with a first call."""
    try:
        import archimedes  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UnavailableError("archimedes is not installed") from error
    p = parameters_from(case.named_parameters)
    by_hand, substeps = ByHand(np, p, constants(p)), case.substeps

    @archimedes.compile(kind="SX")
    def sample(carried, given):
        motion, memory = tuple(carried[i] for i in range(PLANT)), tuple(carried[PLANT + i] for i in range(len(IDLE)))
        k, reference = given[0], (given[1], given[2], given[3])
        so_far = carried[PLANT + len(IDLE)] + (motion[0] - reference[0]) ** 2
        tau_1, tau_2, memory = by_hand.control(np.where(k > 0, 0.0, 1.0), motion, reference, memory)
        for index in range(substeps):
            motion = by_hand.rk4((k + index / substeps) * p.sample_time, motion, tau_1, tau_2, p.sample_time / substeps)
        following = np.hstack([*motion, *memory, so_far])
        return following, motion[0]

    @archimedes.compile
    def whole(start, given):
        return archimedes.scan(sample, start, given)

    start = np.concatenate([case.start[:PLANT], IDLE, [0.0]])
    given = np.column_stack([np.arange(case.samples), case.reference[:, :3]])

    def run(*, keep: bool = False) -> Answer:
        final, positions = whole(start, given)
        mse = float(final[-1]) / len(given)
        metrics = Metrics(**dict.fromkeys(Metrics.__dataclass_fields__, np.nan) | {"mse": mse})
        return Answer(float(final[0]), metrics, np.array(positions).ravel() if keep else None)

    run()
    return run
