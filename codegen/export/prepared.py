"""A block's functions for a processor that has little time a sample: what follows from its parameters, and the rest."""

from dataclasses import dataclass

import casadi as ca

from dualwinch.codegen.block import Block, Variable
from dualwinch.codegen.export.compensate import compensated
from dualwinch.codegen.source.hoist import hoisted_together
from dualwinch.codegen.source.instructions import elements_read
from dualwinch.codegen.source.precision import Precision


@dataclass(frozen=True)
class Prepared:
    """The functions of a block, each but the first with ``derived`` as its last input.

    Attributes:
        derive: ``derive(parameters) -> derived``, all that follows from the parameters alone.
        step, initial, output: those of the block; in single precision the step takes and gives ``lost`` too
            (`codegen.export.compensate`).
        kept: the parameters that these read beside what is derived.
    """

    derive: ca.Function
    step: ca.Function
    initial: ca.Function
    output: ca.Function | None
    kept: tuple[Variable, ...]

    @property
    def derived(self) -> int:
        """How many numbers are derived."""
        return self.derive.numel_out("derived")

    @property
    def lost(self) -> int:
        """How many states keep what rounding took from them."""
        return self.step.numel_in("lost") if "lost" in self.step.name_in() else 0

    @property
    def functions(self) -> tuple[ca.Function, ...]:
        """All of them, that which is for every sample first."""
        return (self.step, self.initial, *((self.output,) if self.output else ()), self.derive)


def prepared(block: Block, precision: Precision) -> Prepared:
    """A block taken apart.

    In double precision every number stays as it is, to the last bit. In single precision divisions by what is derived
    become products with reciprocals, as a division takes a Cortex-M4 fourteen times as long, and sums over samples keep
    what rounding takes from them.

    Args:
        block: whose functions.
        precision: that they are to be written in.
    """
    step = block.step if precision == "double" else compensated(block.step)
    functions = (step, block.initial, *((block.output,) if block.output else ()))
    derive, (step, initial, *output) = hoisted_together(functions, exact=precision == "double")
    read = set[int]().union(*(elements_read(function, "parameters") for function in (step, initial, *output)))
    kept = tuple(block.parameters[index] for index in sorted(read))
    return Prepared(derive, step, initial, output[0] if output else None, kept)
