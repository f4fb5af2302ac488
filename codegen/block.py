"""A sampled block: named CasADi functions with everything a user of their compiled form needs to know of them."""

import math
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Variable:
    """One named number of a block.

    Attributes:
        name: dotted, unique within its vector, e.g. ``controller.nftsm.beta``.
        unit: SI, "1" for a pure number.
        description: what it is.
        start: value at the start; of a parameter, its value.
        lower, upper: range it is made for; infinite where there is none.
        source: where its value comes from, as far as known.
        nominal: of a state, its size beside the others, by which a solver scales its tolerance.
        exclusive: whether `lower` itself is outside the range.
    """

    name: str
    unit: str
    description: str
    start: float
    lower: float = -math.inf
    upper: float = math.inf
    source: str = ""
    nominal: float = 1.0
    exclusive: bool = False


NO_READING = 1e6
"""Magnitude beyond which an input that may be silent is no reading, in its unit."""


@dataclass(frozen=True)
class Block:
    """A sampled system. Every vector is dense, in the order of its variables.

    Attributes:
        name: a C identifier.
        description: one line.
        step: ``step(state, input, parameters) -> (next_state, output)``, one sample. Where there is an `output`
            function, the output is that of `next_state`; else it answers this sample's input.
        initial: ``initial(parameters) -> state``.
        states, inputs, outputs, parameters: what the vectors hold.
        sample_time: in s, where the parameters do not say otherwise.
        output: ``output(state, parameters) -> output``, of a block whose output does not depend on its input.
        derivative: ``derivative(state, input, parameters) -> (dx, output)``, of a block that is sampled from a
            continuous one. The states come first that are continuous; what an integrator keeps for itself follows.
        silent: names of inputs that may be no number: a sensor that is silent. What is beyond `NO_READING` is none.
    """

    name: str
    description: str
    step: ca.Function
    initial: ca.Function
    states: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    sample_time: float
    output: ca.Function | None = None
    derivative: ca.Function | None = None
    silent: frozenset[str] = frozenset()

    @property
    def continuous(self) -> tuple[Variable, ...]:
        """The states that have a derivative."""
        return self.states[: self.derivative.numel_out("dx")] if self.derivative else ()
