"""Parameters of a lab module: a closed loop that contains every option, and the vector of its numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca

from dualwinch.toolbox import (
    Experiment,
    Leaf,
    Mark,
    description,
    leaves,
    loops,
    nominal_model,
    physics,
    sampled,
    scalar,
    structures,
    tree,
)

DELAY = "simulation.delay_samples"
"""A parameter at run time here; elsewhere it shapes the code."""

LAGS = "actuator.motor.time_constant", "sensors.load_cell_time_constant"
"""May be 0 here: motors and load cells without lag."""

SHORTEST_LAG = 1e-15
"""Time constant in s instead of 0, with an effect below the round-off of a torque or tension."""

OFF_AT_ZERO = frozenset({*LAGS, "sensors.drum_speed_resolution"})
"""Keys that have no effect at 0 here; elsewhere their code is left out there."""

DRAWN = frozenset({"plant.vehicle.height"})
"""Keys that the page needs for drawing alone."""

QUEUE = ("queue.0.tau_1", "queue.0.tau_2")
"""States with the torques that arrive next."""


def wide(experiment: Experiment) -> Experiment:
    """The experiment with lags, rounded drum speeds, torque delay, jitter and outages of the position sensor.

    Each has no effect at 0.
    """
    return replace(
        experiment,
        actuator=physics.Motor(),
        sensors=replace(
            experiment.sensors,
            outage="held",
            outage_length=1.0,
            load_cell_time_constant=1.0,
            drum_speed_resolution=1.0,
        ),
        simulation=replace(experiment.simulation, delay_samples=1, jitter=experiment.simulation.sample_time / 4),
    )


@dataclass(frozen=True)
class WideLoop(sampled.Sampled):
    """The closed loop of a wide experiment, whose last parameter is the torques' delay in samples.

    At 0 a torque arrives at once, at 1 it waits a sample in the queue; the driver adds longer delays (``delay.h``).

    Attributes:
        closed: the closed loop without that parameter.
    """

    closed: loops.ClosedLoop

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return (*self.closed.parameters, DELAY)

    @property
    def queue(self) -> int:
        """Index in the state of the first torque that arrives next; the second one follows."""
        return self.closed.states.index(QUEUE[0])


def wide_loop(experiment: Experiment) -> WideLoop:
    """The closed loop of an experiment made by `wide`."""
    loop = loops.closed_loop(structures.structure_of(experiment), frozenset({loops.FORCE}))
    sizes, states = loop.sizes, loop.states
    state, exogenous = ca.SX.sym("state", sizes["STATES"]), ca.SX.sym("exogenous", sizes["EXOGENOUS"])
    parameters = ca.SX.sym("parameters", sizes["PARAMETERS"] + 1)
    values, delay = parameters[:-1], parameters[-1]
    sent, _ = loop.sample(state, exogenous, values)
    arriving = {
        name: scalar.where(delay > 0, state[states.index(name)], sent[states.index(name) - sizes["MOTION"]])
        for name in QUEUE
    }
    now = ca.vertcat(*(arriving.get(name, state[index]) for index, name in enumerate(states)))
    inputs = {"state": state, "exogenous": exogenous, "parameters": parameters}
    discrete, hold = loop.sample(now, exogenous, values)
    return WideLoop(
        sample=loops.named_function("sample", inputs, {"discrete": discrete, "hold": hold}),
        observe=loops.named_function("observe", inputs, {"row": loop.observe(now, exogenous, values)}),
        move=_with_delay(loop.move, parameters),
        parts=loop.parts,
        one_step=_with_delay(loop.one_step, parameters) if loop.one_step else None,
        closed=loop,
    )


def _with_delay(function: ca.Function, parameters: ca.SX) -> ca.Function:
    """A function of the closed loop with the longer vector of parameters, which includes the delay."""
    inputs = {
        name: parameters if name == "parameters" else ca.SX.sym(name, function.size1_in(name))
        for name in function.name_in()
    }
    arguments = [parameters[:-1] if name == "parameters" else symbol for name, symbol in inputs.items()]
    return loops.named_function(
        function.name(), inputs, dict(zip(function.name_out(), function.call(arguments), strict=True))
    )


REFERENCE_KIND = "reference.kind"
"""A number here: index in `MOTIONS`."""

MOTIONS = ("uniform", "profile")
"""References that are given by numbers alone."""

DURATION, SAMPLE_TIME = "simulation.duration", "simulation.sample_time"

GIVEN, NOMINAL = "given ", "nominal "
"""Prefixes of further numbers: whether an optional one is given, and the controller's nominal values of the plant."""


@dataclass(frozen=True, eq=False)
class Settings:
    """Parameters of a structure's module.

    Attributes:
        experiment: of the structure; its numbers are the defaults.
    """

    experiment: Experiment

    @cached_property
    def wide(self) -> Experiment:
        """The experiment with every option, which shapes the code."""
        return wide(self.experiment)

    @cached_property
    def loop(self) -> WideLoop:
        """The closed loop."""
        return wide_loop(self.wide)

    @cached_property
    def described(self) -> Mapping[str, Leaf]:
        """Key → description, for the whole experiment."""
        return description.describe_parts(self.wide)

    @cached_property
    def idle(self) -> frozenset[str]:
        """Keys of the plant without any effect, such as the damping of a rigid gearbox."""
        loop = self.loop.closed
        symbols = ca.vertcat(*map(ca.SX.sym, loop.parameters))
        every = [ca.SX(0)]
        for function in (*loop.functions, loops.start_function(structures.structure_of(self.wide))):
            sizes = {name: function.sparsity_in(name) for name in function.name_in()}
            arguments = [symbols if name == "parameters" else ca.SX.sym(name, size) for name, size in sizes.items()]
            every += function.call(arguments)
        matter = {symbol.name().partition(".")[2] for symbol in ca.symvar(ca.vertcat(*every))}
        return frozenset(f"plant.{key}" for key in tree.numbers(self.wide.plant) if key not in matter) - DRAWN

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Keys with an effect, in the order of the vector."""
        keys = [key for key in self.loop.closed.parameters if not key.startswith("nominal.") and key not in self.idle]
        ahead = [
            key
            for key, leaf in self.described.items()
            if Mark.DRAWN_AHEAD in leaf.marks and leaf.kind is float and not key.startswith(UNHEEDED)
        ]
        nominal = list(leaves(nominal_model.Nominal(), "controller.nominal."))
        return (*dict.fromkeys([*keys, *ahead, *nominal, REFERENCE_KIND, DURATION, DELAY]),)

    @cached_property
    def optional(self) -> tuple[str, ...]:
        """Keys that need not be given."""
        return tuple(key for key in self.keys if self.described[key].optional)

    @cached_property
    def nominal(self) -> tuple[str, ...]:
        """Keys of the plant with a nominal value in the controller, beside the simulated one."""
        unknown = {key.removeprefix("nominal.") for key in structures.unknown_keys()}
        every = (f"plant.{key}" for key in tree.numbers(self.wide.plant) if key not in unknown)
        return tuple(key for key in every if key not in self.idle)

    @cached_property
    def vector(self) -> ca.SX:
        """The parameters as symbols: numbers of `keys`, of `nominal`, and whether each of `optional` is given."""
        return ca.SX.sym("parameters", len(self.keys) + len(self.nominal) + len(self.optional))

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """Name → element of the vector."""
        names = [*self.keys, *(NOMINAL + key for key in self.nominal), *(GIVEN + key for key in self.optional)]
        return dict(zip(names, ca.vertsplit(self.vector), strict=True))

    def given(self, key: str, otherwise: scalar.Scalar) -> scalar.Scalar:
        """The number of an optional key, or another one if it is not given."""
        return scalar.where(self.symbols[GIVEN + key] > 0, self.symbols[key], otherwise)

    def function(
        self, name: str, inputs: dict[str, ca.SX] | None = None, **outputs: list[scalar.Scalar]
    ) -> ca.Function:
        """A function of ``parameters``, the vector, as its last input; outputs are columns."""
        columns = {key: ca.densify(ca.vertcat(*map(ca.SX, values))) for key, values in outputs.items()}
        return loops.named_function(name, (inputs or {}) | {"parameters": self.vector}, columns)


UNHEEDED = (
    "reference.acceleration",
    "disturbance.force.",
    "disturbance.current.",
    "disturbance.normal_force_variation.",
)
"""Prefixes of keys that only other references and signals from files use."""
