"""Hand-written C loops of the same algorithms, ``hand_loop.c`` and ``hand_adaptive.c``: the limits."""

import ctypes
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.by_hand.control import NOTHING, Sums
from benchmarks.by_hand.parameters import parameters_from
from benchmarks.case import Case
from benchmarks.peers import gcc
from benchmarks.peers.peer import Answer, Run
from dualwinch.simulation.metrics.metrics import finish

FOLDER = Path(__file__).parent.parent


def prepare_with(name: str) -> Callable[[Case], Run]:
    """The loop of a C file that is named after it; each run is one call."""

    def prepare(case: Case) -> Run:
        loop = getattr(ctypes.CDLL(str(gcc.build(FOLDER / f"{name}.c"))), name)
        loop.restype = None
        pointer, count = ctypes.c_void_p, ctypes.c_long
        loop.argtypes = [pointer, pointer, count, count, pointer, pointer, pointer]
        parameters = np.array(parameters_from(case.named_parameters))
        reference, start, substeps = case.reference, case.start[:6], case.substeps

        def run(*, keep: bool = False) -> Answer:
            positions = np.empty(len(reference)) if keep else None
            motion, sums = start.copy(), np.empty(len(NOTHING))
            loop(
                parameters.ctypes.data,
                reference.ctypes.data,
                len(reference),
                substeps,
                motion.ctypes.data,
                sums.ctypes.data,
                None if positions is None else positions.ctypes.data,
            )
            return Answer(float(motion[0]), finish(Sums(*sums.tolist())._asdict(), len(reference)), positions)

        return run

    return prepare
