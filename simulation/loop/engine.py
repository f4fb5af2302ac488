"""Engines that run the symbolic step: C by our emitter, C by CasADi's code generator, CasADi's interpreter."""

from collections.abc import Callable
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.rollout import compile_rollout
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.hoist import hoisted
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import unknown
from dualwinch.simulation.experiment import ENGINES, EngineName
from dualwinch.simulation.loop.closed_loop import ClosedLoop

Floats: TypeAlias = NDArray[np.float64]

Engine: TypeAlias = Callable[[Floats, Floats, Floats, int], tuple[Outcome, int, Floats]]
"""``(parameters, exogenous, state, stride) -> (outcome, samples, rows)``; see `Rollout` of `codegen.drivers`."""


class _Stepper:
    """Steps sample by sample in CasADi's interpreter, reading and writing arrays in place."""

    def __init__(self, system: Sampled, parameters: Floats, state: Floats) -> None:
        self.state, self._parameters = state.copy(), parameters
        self.exogenous, self.row = np.empty(system.sample.numel_in("exogenous")), np.empty(system.sizes["COLUMNS"])
        self._following, self._margin, self._valid = np.empty_like(state), np.empty(1), np.zeros(1)
        moving = system.sizes["MOTION"]
        motion, hold = self.state[:moving], np.empty(system.sizes["HOLD"])
        motion_part, discrete = self._following[:moving], self._following[moving:]
        self.observe = self._prepared(system.observe, [self.state, self.exogenous], [self.row])
        self._sample, self._fast_sample = (
            self._prepared(function, [self.state, self.exogenous], [discrete, hold])
            for function in (system.sample, system.fast_sample or system.sample)
        )
        self._phase = self.state[system.phase : system.phase + 1]
        source, between = motion, np.empty(moving)
        self._parts: list[Callable[[], None]] = []
        for part in range(system.parts):
            target = motion_part if (system.parts - part) % 2 else between
            number = np.array([float(part)])
            self._parts.append(self._prepared(system.move, [source, hold, number], [target, self._margin]))
            source = target
        self._one_step = lambda: None
        if system.one_step:
            self._one_step = self._prepared(system.one_step, [motion, hold], [motion_part, self._margin, self._valid])

    def _prepared(self, function: ca.Function, inputs: list[Floats], outputs: list[Floats]) -> Callable[[], None]:
        derive, lean = hoisted(function)
        inputs = [*inputs, self._parameters, np.array(derive(self._parameters)).ravel()]
        buffer, evaluate = lean.buffer()
        for index, array in enumerate(inputs):
            buffer.set_arg(index, array.data)  # pyright: ignore[reportCallIssue]  # the stub names C's arguments
        for index, array in enumerate(outputs):
            buffer.set_res(index, array.data)  # pyright: ignore[reportCallIssue]

        def call(_alive: tuple = (buffer, *inputs, *outputs)) -> None:
            evaluate()

        return call

    def step(self) -> Outcome:
        """Advance by one sample and return its outcome."""
        if self._phase[0] != 0:
            self._fast_sample()
        else:
            self._sample()
        self._one_step()
        if not self._valid[0] > 0:
            for move in self._parts:
                move()
        self.state[:] = self._following
        if not np.isfinite(self.state).all():
            return Outcome.DIVERGED
        return Outcome.LEFT if self._margin[0] < 0 else Outcome.COMPLETED


def interpreter(system: Sampled) -> Engine:
    """Run a sampled system in CasADi's interpreter, with the outcomes of the compiled rollout.

    It runs the same operations as the compiled code, so that both engines give the same numbers.
    """

    def run(parameters: Floats, exogenous: Floats, state: Floats, stride: int) -> tuple[Outcome, int, Floats]:
        stepper = _Stepper(system, parameters, state)
        rows: list[Floats] = []
        outcome, count = Outcome.COMPLETED, 0
        while count < len(exogenous) and outcome == Outcome.COMPLETED:
            stepper.exogenous[:] = exogenous[count]
            if stride and count % stride == 0:
                stepper.observe()
                rows.append(stepper.row.copy())
            outcome = stepper.step()
            count += 1
        state[:] = stepper.state
        return outcome, count, np.array(rows).reshape(len(rows), stepper.row.size)

    return run


def engine_of(loop: ClosedLoop, name: EngineName = "compiled") -> Engine:
    """The named engine for a closed loop.

    Raises:
        DualwinchError: a compiling engine finds no compiler or no usable cache folder.
        ConfigurationError: an unknown name.
    """
    if name not in ENGINES:
        raise ConfigurationError(unknown("engine", name, ENGINES))
    if name == "interpreter":
        return interpreter(loop)
    return compile_rollout(loop, generator="dualwinch" if name == "compiled" else "casadi")
