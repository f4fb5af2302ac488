"""Two ways to run the same symbolic step: compiled C, or CasADi's interpreter."""

from collections.abc import Callable
from typing import Literal, TypeAlias, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from codegen.hoist import hoisted
from codegen.rollout import COMPLETED, DIVERGED, LEFT, compile_rollout
from simulation.closed_loop import ClosedLoop

EngineName: TypeAlias = Literal["compiled", "interpreter"]
ENGINES: tuple[EngineName, ...] = get_args(EngineName)

Engine: TypeAlias = Callable[
    [NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], int], tuple[int, int, NDArray[np.float64]]
]
"""``(parameters, exogenous, state, stride) -> (outcome, samples stepped, rows)``; see `codegen.rollout.Rollout`."""


def interpreter(step: ca.Function) -> Engine:
    """Run a step in CasADi's interpreter, one call a sample, with the outcomes of the compiled rollout.

    It runs the very operations that are compiled, so that both engines give the same numbers.
    """
    derive, lean = hoisted(step)

    def run(
        parameters: NDArray[np.float64],
        exogenous: NDArray[np.float64],
        state: NDArray[np.float64],
        stride: int,
    ) -> tuple[int, int, NDArray[np.float64]]:
        derived = np.array(derive(parameters)).ravel()
        buffer, evaluate = lean.buffer()
        now, given = state.copy(), np.empty(exogenous.shape[1])
        following, row, margin = np.empty_like(state), np.empty(step.numel_out("row")), np.empty(1)
        for place, array in enumerate((now, given, parameters, derived)):
            buffer.set_arg(place, array.data)  # pyright: ignore[reportCallIssue]  # the stub names C's arguments
        for place, array in enumerate((following, row, margin)):
            buffer.set_res(place, array.data)  # pyright: ignore[reportCallIssue]
        rows: list[NDArray[np.float64]] = []
        outcome, done = COMPLETED, 0
        for outside in exogenous:
            given[:] = outside
            evaluate()
            if stride and done % stride == 0:
                rows.append(row.copy())
            now[:] = following
            done += 1
            if not np.isfinite(now).all():
                outcome = DIVERGED
            elif margin[0] < 0:
                outcome = LEFT
            if outcome != COMPLETED:
                break
        state[:] = now
        return outcome, done, np.array(rows).reshape(len(rows), row.size)

    return run


def engine(loop: ClosedLoop, name: EngineName = "compiled") -> Engine:
    """The engine of a name for a closed loop.

    Raises:
        DualwinchError: the compiled engine finds no compiler, or no usable cache folder.
    """
    return compile_rollout(loop.step, loop.shortcut) if name == "compiled" else interpreter(loop.step)
