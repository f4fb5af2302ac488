"""What a module takes: numbers by the keys of an experiment, in one vector."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from dualwinch.controllers.nominal import Nominal
from dualwinch.lab.wasm.wide import DELAY, WideLoop, wide, wide_loop
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import leaves, numbers
from dualwinch.model.scalar import Scalar, where
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import unknown_keys
from dualwinch.simulation.loop.zero_order_hold import named_function

KIND = "reference.kind"
"""A number here: which of `MOTIONS` it is."""

MOTIONS = ("uniform", "profile")
"""The references that follow from numbers."""

DURATION, SAMPLE_TIME = "simulation.duration", "simulation.sample_time"

GIVEN, BELIEVED = "given ", "believed "
"""What the names begin with of further numbers: whether an optional one is given, and what the controller believes."""


@dataclass(frozen=True, eq=False)
class Settings:
    """What the module of a structure takes.

    Attributes:
        experiment: of the structure; its numbers are the defaults.
    """

    experiment: Experiment

    @cached_property
    def wide(self) -> Experiment:
        """The experiment that shapes the code."""
        return wide(self.experiment)

    @cached_property
    def loop(self) -> WideLoop:
        """The closed loop."""
        return wide_loop(self.wide)

    @cached_property
    def described(self) -> Mapping[str, Leaf]:
        """What the keys of the experiment are."""
        return describe_parts(self.wide)

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Keys of the numbers, in the order of the vector."""
        own = [key for key in self.loop.closed.parameters if not key.startswith("nominal.")]
        ahead = [
            key
            for key, leaf in self.described.items()
            if Mark.DRAWN_AHEAD in leaf.marks and leaf.kind is float and not key.startswith(UNHEEDED)
        ]
        believed = list(leaves(Nominal(), "controller.nominal."))
        return (*dict.fromkeys([*own, *ahead, *believed, KIND, DURATION, DELAY]),)

    @cached_property
    def optional(self) -> tuple[str, ...]:
        """Keys that may be left open."""
        return tuple(key for key in self.keys if self.described[key].optional)

    @cached_property
    def believed(self) -> tuple[str, ...]:
        """Keys of the plant that the controller believes in, beside the simulated one."""
        unknown = {key.removeprefix("nominal.") for key in unknown_keys()}
        return tuple(f"plant.{key}" for key in numbers(self.wide.plant) if key not in unknown)

    @cached_property
    def vector(self) -> ca.SX:
        """The numbers as a vector of symbols: of `keys`, of `believed`, and whether each of `optional` is given."""
        return ca.SX.sym("parameters", len(self.keys) + len(self.believed) + len(self.optional))

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """The vector's elements by name."""
        names = [*self.keys, *(BELIEVED + key for key in self.believed), *(GIVEN + key for key in self.optional)]
        return dict(zip(names, ca.vertsplit(self.vector), strict=True))

    def given(self, key: str, otherwise: Scalar) -> Scalar:
        """The number of an optional key, or another one where it is left open."""
        return where(self.symbols[GIVEN + key] > 0, self.symbols[key], otherwise)

    def function(self, name: str, inputs: dict[str, ca.SX] | None = None, **outputs: list[Scalar]) -> ca.Function:
        """A function of the vector, its last input, which is called ``parameters``; outputs are columns."""
        columns = {key: ca.densify(ca.vertcat(*map(ca.SX, values))) for key, values in outputs.items()}
        return named_function(name, (inputs or {}) | {"parameters": self.vector}, columns)


UNHEEDED = (
    "reference.acceleration",
    "disturbance.force.",
    "disturbance.current.",
    "disturbance.normal_force_variation.",
)
"""What the keys begin with of numbers that only other references and signals from files look at."""
