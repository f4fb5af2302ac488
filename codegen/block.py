"""A sampled block: named CasADi functions with the description of their vectors."""

import math
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Variable:
    """One named number of a block.

    Attributes:
        name: dotted, unique within its vector, e.g. ``controller.nftsm.beta``.
        unit: SI unit, "1" for a pure number.
        description: its meaning.
        start: initial value; for a parameter, its value.
        lower, upper: valid range; infinite without a bound.
        source: source of its value, if known.
        nominal: typical size of a state, by which a solver scales its tolerance.
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
"""Magnitude, in its unit, beyond which an input that may be silent counts as missing."""


@dataclass(frozen=True)
class Block:
    """A sampled system. Every vector is dense, in the order of its variables.

    Attributes:
        name: a C identifier.
        description: one line.
        step: ``step(state, input, parameters) -> (next_state, output)``, one sample. With an `output` function the
            output is that of `next_state`; else it depends on this sample's input.
        initial: ``initial(parameters) -> state``.
        states, inputs, outputs, parameters: the elements of the vectors.
        sample_time: default sample time in s, unless it is a parameter.
        output: ``output(state, parameters) -> output``, of a block without direct feedthrough.
        derivative: ``derivative(state, input, parameters) -> (dx, output)``, of the sampled version of a continuous
            block. The continuous states come first, followed by the states of the integrator.
        rules: ``rules(parameters) -> holds``, for each requirement on parameters beyond their ranges (a whole number, a
            relation between several) 1 where it holds, else 0.
        ruled: name of the parameter that each of the `rules` is about.
        silent: names of inputs that may be missing, as of a silent sensor: NaN, or beyond `NO_READING`.
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
    rules: ca.Function | None = None
    ruled: tuple[str, ...] = ()

    @property
    def continuous(self) -> tuple[Variable, ...]:
        """The states that have a derivative."""
        return self.states[: self.derivative.numel_out("dx")] if self.derivative else ()
