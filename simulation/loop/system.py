"""The closed loop as named CasADi functions, with the names of everything in their vectors."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.errors import DualwinchError
from dualwinch.codegen.sampled import Sampled
from dualwinch.model.quantities.quantity import Mark, Quantity


@dataclass(frozen=True, eq=False)
class ClosedLoop(Sampled):
    """The closed loop as named CasADi functions, and the names of everything in their vectors.

    At a sample the controller senses and acts, and the figures of merit are summed up; until the next one the plant
    moves. `margin` in m is the distance of the next position to the nearer end of the track.

    Attributes:
        states, exogenous, parameters: names of the elements of those vectors.
        marks: state → what else it is.
        quantities: what each element of a row is, by its name: the columns of a result.
    """

    states: tuple[str, ...]
    exogenous: tuple[str, ...]
    parameters: tuple[str, ...]
    marks: Mapping[str, frozenset[Mark]]
    quantities: Mapping[str, Quantity]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the elements of a row."""
        return tuple(self.quantities)

    def vector(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """(parameters,) numbers by name, such as `structure.parameters_of` gives, as the compiled code takes them.

        Raises:
            DualwinchError: they are not those of this closed loop.
        """
        if tuple(values) != self.parameters:
            odd = ", ".join(sorted(set(values) ^ set(self.parameters))) or "their order"
            raise DualwinchError(f"these are not the parameters of this closed loop; what differs: {odd}")
        return np.array(list(values.values()), float)

    def marked(self, *marks: Mark) -> NDArray[np.bool_]:
        """(states,) whether a state has one of some marks."""
        return np.array([not self.marks[name].isdisjoint(marks) for name in self.states])

    @cached_property
    def step(self) -> ca.Function:
        """``step(state, exogenous, parameters) -> (next_state, row, margin)``: one whole sample."""
        arguments = [ca.SX.sym(name, self.sample.size1_in(name)) for name in self.sample.name_in()]
        discrete, hold, *_ = self.sample(*arguments)
        start = arguments[0][: self.move.numel_in("motion")]
        motion, margin = start, ca.SX(0)
        for part in range(self.parts):
            motion, margin = self.move(motion, hold, part, arguments[2])
        if self.one_step:
            moved, moved_margin, valid = self.one_step(start, hold, arguments[2])
            motion = ca.if_else(valid > 0, moved, motion)
            margin = ca.if_else(valid > 0, moved_margin, margin)
        outputs = [ca.vertcat(motion, discrete), self.observe(*arguments), margin]
        return ca.Function(
            "step", arguments, outputs, self.sample.name_in(), ["next_state", "row", "margin"], {"cse": True}
        )
