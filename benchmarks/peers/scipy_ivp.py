"""SciPy's `solve_ivp` once a sample, with the controller in Python between the samples."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.by_hand.control import IDLE, NOTHING, control
from benchmarks.by_hand.parameters import parameters_from
from benchmarks.by_hand.plant import constants, derivative
from benchmarks.case import Case
from benchmarks.peers.peer import Answer, Run
from dualwinch.simulation.metrics.metrics import finish

RTOL, ATOL = 1e-8, 1e-10
"""Tolerances; both methods then keep the position within 1e-6 m over the run, at 1e-6 LSODA does not."""


def prepare_with(method: str) -> Callable[[Case], Run]:
    """`prepare` with a method of `solve_ivp`."""

    def prepare(case: Case) -> Run:
        p = parameters_from(case.named_parameters)
        c, reference, start = constants(p), case.reference.tolist(), tuple(case.start[:6].tolist())

        def run(*, keep: bool = False) -> Answer:
            positions = np.empty(len(reference)) if keep else None
            motion, memory, sums = start, IDLE, NOTHING
            for k, setpoint in enumerate(reference):
                t = k * p.sample_time
                tau_1, tau_2, memory, sums = control(k, motion, setpoint, memory, sums, p, c)
                span, given = (t, t + p.sample_time), (tau_1, tau_2, c)
                solved = solve_ivp(derivative, span, motion, method=method, rtol=RTOL, atol=ATOL, args=given)
                motion = tuple(solved.y[:, -1].tolist())
                if positions is not None:
                    positions[k] = motion[0]
            return Answer(motion[0], finish(sums._asdict(), len(reference)), positions)

        return run

    return prepare
