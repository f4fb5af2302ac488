"""The algorithm of `benchmarks.by_hand`, compiled by Numba with its loop over the samples."""

from typing import Any

import numpy as np

from benchmarks.by_hand.control import IDLE, NOTHING, Sums, control
from benchmarks.by_hand.parameters import Parameters, parameters_from
from benchmarks.by_hand.plant import Motion, constants, rk4
from benchmarks.case import Case
from benchmarks.peers.peer import Answer, Run, UnavailableError
from dualwinch.simulation.metrics.metrics import finish


def _loop(p: Parameters, reference: Any, substeps: int, motion: Motion, positions: Any) -> tuple[Motion, Sums]:
    c = constants(p)
    memory, sums = IDLE, NOTHING
    h = p.sample_time / substeps
    for k in range(len(reference)):
        t = k * p.sample_time
        tau_1, tau_2, memory, sums = control(k, motion, reference[k], memory, sums, p, c)
        for index in range(substeps):
            motion = rk4(t + index * h, motion, tau_1, tau_2, h, c)
        if len(positions):
            positions[k] = motion[0]
    return motion, sums


def prepare(case: Case) -> Run:
    """Compile the loop with a first call; the parameters stay arguments."""
    try:
        from numba import njit  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UnavailableError("numba is not installed") from error
    loop = njit(error_model="numpy")(_loop)
    parameters, reference = parameters_from(case.named_parameters), case.reference
    start, substeps = tuple(case.start[:6].tolist()), case.substeps

    def run(*, keep: bool = False) -> Answer:
        positions = np.empty(len(reference) if keep else 0)
        motion, sums = loop(parameters, reference, substeps, start, positions)
        return Answer(motion[0], finish(sums._asdict(), len(reference)), positions if keep else None)

    loop(parameters, reference[:1], substeps, start, np.empty(0))
    return run
