"""What an FMU shows of a block: numbered variables with causality, and which depends on which."""

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, get_args

from dualwinch.codegen.block import Block, Variable
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.fmu.functions import Functions, functions_of

Version: TypeAlias = Literal[2, 3]
VERSIONS: tuple[Version, ...] = get_args(Version)
Kind: TypeAlias = Literal["co-simulation", "model-exchange", "both"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Signal:
    """One variable of an FMU; its value reference is its position among all.

    Attributes:
        name: in FMI's structured convention.
        role: ``input``, ``parameter``, ``output``, ``state``, ``derivative`` or ``time``.
        reference: value reference.
        variable: unit, description, start value, range.
        state: value reference of the state a derivative belongs to.
    """

    name: str
    role: str
    reference: int
    variable: Variable
    state: int | None = None


@dataclass(frozen=True)
class FmuModel:
    """A block seen through FMI.

    Attributes:
        block: what is exported.
        kind: which interfaces it offers.
        version: of FMI.
    """

    block: Block
    kind: Kind
    version: Version

    @property
    def steps(self) -> bool:
        """Whether it offers co-simulation."""
        return self.kind != "model-exchange"

    @property
    def flows(self) -> bool:
        """Whether it offers model exchange."""
        return self.kind != "co-simulation"

    @cached_property
    def functions(self) -> Functions:
        """The functions it computes with."""
        return functions_of(self.block)

    @cached_property
    def signals(self) -> tuple[Signal, ...]:
        """Every variable in the order of the value references: inputs, parameters, outputs, states, derivatives, time.

        Raises:
            CodegenError: two variables have one name.
        """
        block = self.block
        names = [_structured(f"state.{variable.name}") for variable in block.states]
        first_state = len(block.inputs) + len(block.parameters) + len(block.outputs)
        rows = [
            *((_structured(variable.name), "input", variable, None) for variable in block.inputs),
            *((_structured(variable.name), "parameter", variable, None) for variable in block.parameters),
            *((_structured(variable.name), "output", variable, None) for variable in block.outputs),
            *((name, "state", variable, None) for name, variable in zip(names, block.states, strict=True)),
            *(
                (f"der({name})", "derivative", _rate(variable), reference)
                for reference, (name, variable) in enumerate(zip(names, block.continuous, strict=False), first_state)
            ),
            ("time", "time", Variable("time", "s", "time", 0.0), None),
        ]
        twice = [name for name, count in Counter(name for name, *_ in rows).items() if count > 1]
        if twice:
            raise CodegenError(f"two variables of {block.name} are called {twice[0]}")
        return tuple(
            Signal(name, role, reference, variable, state)
            for reference, (name, role, variable, state) in enumerate(rows)
        )

    def of(self, role: str) -> tuple[Signal, ...]:
        """The variables of one role."""
        return tuple(signal for signal in self.signals if signal.role == role)

    @cached_property
    def dependencies(self) -> dict[int, list[int]]:
        """Value reference of each output and derivative → those of the inputs and continuous states it depends on."""
        unknowns = (*self.of("derivative"), *self.of("output"))
        inputs, states = self.of("input"), self.of("state") if self.flows else ()
        uses = self.functions
        return {
            unknown.reference: [known.reference for known, used in zip(inputs, uses.on_input[row], strict=True) if used]
            + [known.reference for known, used in zip(states, uses.on_state[row], strict=False) if used]
            for row, unknown in enumerate(unknowns)
        }

    @cached_property
    def initial_unknowns(self) -> dict[int, list[int]]:
        """Value reference of what follows from start values → those of the inputs and parameters it depends on.

        Outputs and, with model exchange, continuous states and their derivatives.
        """
        unknowns = (*self.of("state"), *self.of("derivative"), *self.of("output"))
        continuous = {signal.state for signal in self.of("derivative")}
        knowns = (*self.of("input"), *self.of("parameter"))
        wanted = {signal.reference for signal in self.of("output")}
        if self.flows:
            wanted |= continuous | {signal.reference for signal in self.of("derivative")}
        found = {
            unknown.reference: [known.reference for known, used in zip(knowns, row, strict=True) if used]
            for unknown, row in zip(unknowns, self.functions.at_start, strict=True)
            if unknown.reference in wanted
        }
        return dict(sorted(found.items()))


def _structured(name: str) -> str:
    """A dotted name in FMI's structured convention: a number in the path is an array index."""
    return re.sub(r"\.(\d+)(?=\.|$)", r"[\1]", name)


def _rate(state: Variable) -> Variable:
    """The derivative of a state by time."""
    unit = state.unit
    if unit == "1":
        unit = "1/s"
    elif unit.endswith("/s"):
        unit += "^2"
    else:
        unit = f"({unit})/s" if "/" in unit else f"{unit}/s"
    return Variable(f"der({state.name})", unit, f"time derivative of: {state.description}", 0.0)
