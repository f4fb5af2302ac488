"""The algorithm of `benchmarks.by_hand`, compiled by Numba with a parallel loop over the candidates (`prange`)."""

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.by_hand.control import IDLE, NOTHING, Sums, control
from benchmarks.by_hand.parameters import Parameters, parameters_from
from benchmarks.by_hand.plant import constants, rk4
from benchmarks.case import Case
from benchmarks.peers.candidates import gains
from benchmarks.peers.peer import Answer, Run, UnavailableError
from dualwinch.simulation.metrics.metrics import finish

try:
    from numba import prange  # pyright: ignore[reportMissingImports]
except ImportError:
    prange = range


def _batch(candidates: Any, reference: Any, substeps: int, start: Any, sums: Any, positions: Any) -> None:
    for i in prange(len(candidates)):
        p = candidates[i]
        c = constants(p)
        motion, memory, so_far = start, IDLE, NOTHING
        h = p.sample_time / substeps
        for k in range(len(reference)):
            t = k * p.sample_time
            tau_1, tau_2, memory, so_far = control(k, motion, reference[k], memory, so_far, p, c)
            for part in range(substeps):
                motion = rk4(t + part * h, motion, tau_1, tau_2, h, c)
            if i == 0 and len(positions):
                positions[k] = motion[0]
        for index, value in enumerate(so_far):
            sums[i, index] = value


def prepare_with(threads: int) -> Callable[[Case], Run]:
    """Rollouts on some of Numba's threads; the parameters are rows of a structured array."""

    def prepare(case: Case) -> Run:
        try:
            from numba import get_num_threads, njit, set_num_threads  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise UnavailableError("numba is not installed") from error
        batch = njit(error_model="numpy", parallel=True)(_batch)
        own, values = parameters_from(case.named_parameters), gains(case)
        candidates = np.zeros(len(values), [(name, float) for name in Parameters._fields])
        candidates[:] = tuple(own)
        candidates["l0"] = values
        reference, start = case.reference, tuple(case.start[:6].tolist())

        def run(*, keep: bool = False) -> Answer:
            sums, positions = np.empty((len(values), len(NOTHING))), np.empty(len(reference) if keep else 0)
            before = get_num_threads()
            set_num_threads(min(threads, before))
            batch(candidates, reference, case.substeps, start, sums, positions)
            set_num_threads(before)
            metrics = [finish(Sums(*row)._asdict(), len(reference)) for row in sums.tolist()]
            errors = np.array([each.mse for each in metrics])
            return Answer(float(positions[-1]) if keep else np.nan, metrics[0], positions if keep else None, errors)

        batch(candidates, reference[:1], case.substeps, start, np.empty((len(values), len(NOTHING))), np.empty(0))
        return run

    return prepare
