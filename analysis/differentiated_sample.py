"""One sample of a closed loop with its exact derivatives, for many points, by the chain rule over its parts.

Over a sample the controller runs once, and the plant then moves through all parts of the interval. The Jacobians of the
controller's sample and of one part are expressions; their product over the parts is computed in numbers (forward
accumulation: Griewank and Walther, *Evaluating Derivatives*, 2008, Section 3.2). The code is as long as that of one
part, however many there are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen import native
from dualwinch.codegen.drivers.tangents import Vertex, accumulated_jacobian
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.expressions import built_once

Floats = NDArray[np.float64]

Vectorised = Callable[..., tuple[Floats, ...]]

QUICK_BUILD = ("-O1",)
"""Compiler flags: the functions are long straight-line code, for which more optimisation only costs compile time."""


@dataclass(frozen=True)
class Differentiated:
    """Values (s, n) at s points, and their derivatives (s, n, c) along c directions."""

    values: Floats
    slopes: Floats


class DifferentiatedSample:
    """A sample of a system with its derivatives with respect to some elements of its inputs, the columns.

    1. The results at the sample and the zero-order hold, with their Jacobian by the columns.
    2. For each part of the interval the motion, and its derivatives by motion and hold at the sample, multiplied by the
       part's Jacobian. Where ``one_step`` is valid, it takes the place of all parts.
    3. The motion's Jacobian by the columns, which act on it as its beginning or through the hold.
    """

    def __init__(self, system: Sampled, results: ca.Function, columns: Sequence[Vertex], *, compiled: bool) -> None:
        """Build the functions.

        Args:
            system: the system.
            results: ``results(state, exogenous, parameters, …) -> (values, hold)``, and perhaps further outputs
                without derivatives.
            columns: elements of its inputs, ``(name, index)``, to differentiate by.
            compiled: whether the functions are compiled; for a few points interpretation is quicker.

        Raises:
            DualwinchError: no compiler or no usable cache folder.
        """
        self._moving = system.move.numel_in("motion")
        pairs = [
            (columns.index(("state", index)), index) for index in range(self._moving) if ("state", index) in columns
        ]
        self._begun = np.array(pairs, np.intp).reshape(-1, 2).T
        self._results = vectorised(_results_with_slopes(results, tuple(columns), merged=compiled), compiled)
        self._parts = repeated(_part_with_slopes(system.move, merged=compiled), system.parts, compiled)
        self._one_step = None
        if system.one_step:
            self._one_step = vectorised(_motion_with_slopes(system.one_step, merged=compiled), compiled)

    def __call__(self, state: Floats, exogenous: Floats, parameters: Floats, *others: Floats) -> tuple[Any, ...]:
        """Evaluate at s points; arguments (s, elements), those of `results`.

        Returns:
            The motion a sample later and the values at the sample, both `Differentiated`; then the further outputs
            (s, elements).
        """
        values, hold, *facts, transposed = self._results(state, exogenous, parameters, *others)
        slopes = transposed.swapaxes(1, 2)
        count = values.shape[1]
        with np.errstate(over="ignore", invalid="ignore"):  # diverging points
            motion = self._moved(state[:, : self._moving], hold, parameters)
            motion_slopes = motion.slopes[:, :, self._moving :] @ slopes[:, count:]
            columns, motions = self._begun
            motion_slopes[:, :, columns] += motion.slopes[:, :, motions]
        return Differentiated(motion.values, motion_slopes), Differentiated(values, slopes[:, :count]), *facts

    def _moved(self, motion: Floats, hold: Floats, parameters: Floats) -> Differentiated:
        """The motion a sample later, by motion and hold at the sample: in one step where valid, else in all parts."""
        if self._one_step is None:
            return self._in_parts(motion, hold, parameters)
        values, valid, transposed = self._one_step(motion, hold, parameters)
        single_step, is_valid = Differentiated(values, transposed.swapaxes(1, 2)), valid.reshape(-1) > 0
        if is_valid.all():
            return single_step
        stepwise = self._in_parts(motion, hold, parameters)
        return Differentiated(
            np.where(is_valid[:, None], single_step.values, stepwise.values),
            np.where(is_valid[:, None, None], single_step.slopes, stepwise.slopes),
        )

    def _in_parts(self, motion: Floats, hold: Floats, parameters: Floats) -> Differentiated:
        """The motion after all parts, by motion and hold at the sample."""
        shape = self._moving, self._moving + hold.shape[1]
        identity = np.broadcast_to(np.eye(*shape).ravel(), (len(motion), shape[0] * shape[1]))
        end = self._parts(np.hstack([motion, identity]), np.hstack([hold, parameters]))
        return Differentiated(end[:, : self._moving], end[:, self._moving :].reshape(-1, *shape))


def vectorised(function: ca.Function, compiled: bool) -> Vectorised:
    """A function of vectors for many points: arguments (s, elements), results (s, rows) or (s, rows, columns)."""
    if compiled:
        return native.compile(function, flags=QUICK_BUILD)  # pyright: ignore[reportReturnType]

    def interpreted(*vectors: Floats) -> tuple[Floats, ...]:
        outputs = [output.full() for output in function.call([ca.DM(vector.T) for vector in vectors])]
        matrices = [np.array(np.split(output, len(vectors[0]), axis=1)) for output in outputs]
        return tuple(each[:, :, 0] if each.shape[2] == 1 else each for each in matrices)

    return interpreted


def repeated(function: ca.Function, rounds: int, compiled: bool) -> Callable[[Floats, Floats], Floats]:
    """A number of calls of ``function(state, constant, number) -> next`` in a row, for many points.

    Returns:
        ``(state, constant) -> result``, (s, state) and (s, constant) to (s, state).
    """
    if compiled:
        step: Any = native.compile(function, flags=QUICK_BUILD)

        def run(state: Floats, constant: Floats) -> Floats:
            for number in range(rounds):
                state = step(state, constant, float(number))
            return state

        return run

    def interpreted(state: Floats, constant: Floats) -> Floats:
        now = ca.DM(state.T)
        for number in range(rounds):
            now = function(now, constant.T, np.full((1, len(state)), float(number)))
        return now.full().T

    return interpreted


@built_once
def _results_with_slopes(results: ca.Function, columns: tuple[Vertex, ...], *, merged: bool) -> ca.Function:
    """The results, and the Jacobian of values and hold by the columns."""
    inputs = {name: ca.SX.sym(name, results.size1_in(name)) for name in results.name_in()}
    outputs = dict(zip(results.name_out(), results.call([*inputs.values()]), strict=True))
    values = {name: outputs.pop(name) for name in ("values", "hold")}
    return _with_slopes(results.name(), inputs, values, outputs, columns, merged=merged)


@built_once
def _motion_with_slopes(function: ca.Function, *, merged: bool) -> ca.Function:
    """The motion of ``move`` or ``one_step``, the latter's validity, and the motion's Jacobian by motion and hold."""
    inputs = {name: ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()}
    outputs = dict(zip(function.name_out(), function.call([*inputs.values()]), strict=True))
    columns = tuple((name, index) for name in ("motion", "hold") for index in range(inputs[name].numel()))
    values, validity = (
        {name: outputs[name] for name in names if name in outputs} for names in (["next_motion"], ["valid"])
    )
    return _with_slopes(function.name(), inputs, values, validity, columns, merged=merged)


@built_once
def _part_with_slopes(move: ca.Function, *, merged: bool) -> ca.Function:
    """``part(state, constant, number) -> next``, for `repeated`.

    The state is the motion, and row by row its derivatives by motion and hold at the sample; hold and parameters are
    constant.
    """
    rows, hold_size = move.size1_in("motion"), move.size1_in("hold")
    state = ca.SX.sym("state", rows * (1 + rows + hold_size))
    constant, number = ca.SX.sym("constant", hold_size + move.size1_in("parameters")), ca.SX.sym("number")
    before = ca.reshape(state[rows:], rows + hold_size, rows).T
    arguments = state[:rows], constant[:hold_size], number, constant[hold_size:]
    motion, transposed = _motion_with_slopes(move, merged=merged)(*arguments)
    slopes = ca.sparsify(transposed.T)
    after = slopes[:, :rows] @ before + ca.horzcat(ca.SX(rows, rows), slopes[:, rows:])
    following = ca.vertcat(motion, ca.vec(ca.densify(after).T))
    names = ["state", "constant", "number"], ["next"]
    return ca.Function("part", [state, constant, number], [following], *names, {"cse": merged})


def _with_slopes(
    name: str,
    inputs: dict[str, ca.SX],
    values: dict[str, ca.SX],
    further: dict[str, ca.SX],
    columns: Sequence[Vertex],
    *,
    merged: bool,
) -> ca.Function:
    """Function of values, further outputs, and ``slopes``, the values' Jacobian transposed: row by row in NumPy.

    `merged`: common subexpressions are merged, which pays off only for compiled code.
    """
    stacked = ca.densify(ca.vertcat(*values.values()))
    names = [*inputs], [*values, *further, "slopes"]
    lean = ca.Function("values", [*inputs.values()], [stacked], names[0], ["values"], {"cse": True})
    slopes = accumulated_jacobian(lean, inputs, columns, "values")
    outputs = [ca.densify(output) for output in (*values.values(), *further.values(), slopes.T)]
    return ca.Function(name, [*inputs.values()], outputs, *names, {"cse": merged})
