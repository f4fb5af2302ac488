"""What a module takes, by keys of an experiment, and what follows from it: parameters, reference, random signals."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca

from dualwinch.codegen.drivers.signals.kinds import NORMAL, OUTAGES, UNIFORM
from dualwinch.controllers.nominal import Nominal, nominal_plant
from dualwinch.lab.wasm.wide import DELAY, LAG, SHORTEST_LAG, WideLoop, wide, wide_loop
from dualwinch.model.motions.preview import no_departures
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import leaves, numbers, with_leaves
from dualwinch.model.reference import PAPER_DURATION, PAPER_SPEED, Reference, departures, setpoint, steady_window
from dualwinch.model.scalar import Scalar, both, exp, maximum, where
from dualwinch.simulation.exogenous.signals import courses
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.between import named_function
from dualwinch.simulation.loop.structure import unknown_keys
from dualwinch.simulation.metrics.metrics import KEYS, finish

KIND = "reference.kind"
"""A number here: which of `MOTIONS` it is."""

MOTIONS = ("uniform", "profile")
"""The references that follow from numbers."""

REFERENCE = tuple(
    f"reference.{name}" for name in ("speed", "accelerate_until", "cruise_until", "brake_until", "jerk_limit")
)

DURATION, SAMPLE_TIME = "simulation.duration", "simulation.sample_time"

GIVEN, BELIEVED = "given ", "believed "
"""What the names begin with of further numbers: whether an optional one is given, and what the controller believes."""

KINDS = ("kind", "sigma", "decay", "limit", "period", "length", "from_zero")
"""What is said of a random signal, as in ``Signal`` of sources.h."""


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

    # ---- what follows ----

    @cached_property
    def parameters(self) -> ca.Function:
        """``parameters(settings) -> values``: what the closed loop takes."""
        symbols = self.symbols | {LAG: maximum(self.symbols[LAG], SHORTEST_LAG)}
        believed = {key: symbols[BELIEVED + key] for key in self.believed}
        plant = with_leaves(self.wide.plant, believed, "plant.")
        prefix = "controller.nominal."
        own = {
            name: self.given(prefix + name, otherwise)
            for name, otherwise in {
                "mass": plant.vehicle.mass + plant.vehicle.added_mass,
                "drag_coefficient": plant.vehicle.drag_coefficient,
                "friction_coefficient": plant.vehicle.friction_coefficient,
            }.items()
        }
        preload = with_leaves(self.wide.controller.limits, symbols, "controller.coordination.").preload
        symbols |= numbers_of(nominal_plant(Nominal(**own), plant, preload), self.wide, "nominal.")
        return self._function("parameters_of", {}, {"values": [symbols[name] for name in self.loop.parameters]})

    @cached_property
    def motion(self) -> ca.Function:
        """``motion(t, parameters) -> given``: what is given of a sample, in the order of `motion_names`."""
        t = ca.SX.sym("t")
        found: dict[str, Scalar] = {}
        for number, kind in enumerate(MOTIONS):
            for jerk in (None, self.symbols["reference.jerk_limit"]):
                here = self._given_by(t, self._reference(kind, jerk), self.given(DURATION, PAPER_DURATION[kind]))
                chosen = both(
                    self.symbols[KIND] == number, self.symbols[GIVEN + "reference.jerk_limit"] == (jerk is not None)
                )
                found = {name: where(chosen, value, found.get(name, 0.0)) for name, value in here.items()}
        return self._function("motion", {"t": t}, {"given": [found[name] for name in self.motion_names]})

    @cached_property
    def duration(self) -> ca.Function:
        """``duration(settings) -> duration``: length of the run in s."""
        own: Scalar = 0.0
        for number, kind in enumerate(MOTIONS):
            own = where(self.symbols[KIND] == number, PAPER_DURATION[kind], own)
        return self._function("duration_of", {}, {"duration": [self.given(DURATION, own)]})

    @cached_property
    def motion_names(self) -> tuple[str, ...]:
        """The exogenous signals that are given."""
        return tuple(name for name in self.loop.closed.exogenous if name.startswith(("reference.", "steady", "ahead.")))

    def _reference(self, kind: Any, jerk: Scalar | None) -> Reference:
        symbols = {key: self.symbols[key] for key in REFERENCE}
        symbols |= {"reference.speed": self.given("reference.speed", PAPER_SPEED[kind])}
        symbols |= {"reference.jerk_limit": jerk}
        return replace(with_leaves(Reference(), symbols, "reference."), kind=kind)

    def _given_by(self, t: ca.SX, reference: Reference, duration: Scalar) -> dict[str, Scalar]:
        """What a reference gives of the sample at a time."""
        now, times, half = setpoint(t, reference), self.wide.controller.preview, self.symbols[SAMPLE_TIME] / 2
        start, end = steady_window(reference, duration)
        found = {"reference.x": now.x, "reference.v": now.v, "reference.a": now.a}
        found["steady"] = both(t >= start - half, t <= end + half)
        if times:
            found |= dict(
                zip(
                    leaves(no_departures(times), "ahead."),
                    (value for column in vars(departures(t, times, reference)).values() for value in column),
                    strict=True,
                )
            )
        return found

    @cached_property
    def drawn(self) -> ca.Function:
        """``drawn(settings) -> random``: `KINDS` of each exogenous signal, one after the other; periods in samples."""
        symbols, step = self.symbols, self.symbols[SAMPLE_TIME]
        sensors = with_leaves(self.wide.sensors, symbols, "sensors.")
        sea = with_leaves(self.wide.disturbance, symbols, "disturbance.")
        vehicle = with_leaves(self.wide.plant.vehicle, symbols, "plant.vehicle.")
        rows: dict[str, list[Scalar]] = {name: [0.0] * len(KINDS) for name in self.loop.closed.exogenous}
        for name, course in courses(sensors, sea, vehicle).items():
            lasting = exp(-step / maximum(course.time, 1e-300))
            decay = where(course.time > 0, lasting, 0.0) if isinstance(course.time, ca.SX) else 0.0
            rows[name] = [NORMAL * (course.sigma > 0), course.sigma, decay, course.limit, 0.0, 0.0, course.from_zero]
        rows["noise.lateness"][0] = UNIFORM * (symbols["simulation.jitter"] > 0)
        length, period = symbols["sensors.outage_length"], symbols["sensors.outage_period"]
        rows["noise.silent"] = [OUTAGES * (length > 0), 0.0, 0.0, 0.0, period / step, length / step, 0.0]
        return self._function("drawn", {}, {"random": [value for row in rows.values() for value in row]})

    @cached_property
    def figures(self) -> ca.Function:
        """``figures(state) -> metrics``: the figures of merit."""
        state = ca.SX.sym("state", len(self.loop.closed.states))
        by_name = dict(zip(self.loop.closed.states, ca.vertsplit(state), strict=True))
        metrics = finish({name: by_name[key] for name, key in KEYS.items()}, by_name["sample"])
        return named_function("figures", {"state": state}, {"metrics": ca.vertcat(*vars(metrics).values())})

    def _function(self, name: str, inputs: dict[str, ca.SX], outputs: dict[str, list[Scalar]]) -> ca.Function:
        columns = {key: ca.densify(ca.vertcat(*map(ca.SX, values))) for key, values in outputs.items()}
        return named_function(name, inputs | {"parameters": self.vector}, columns)


UNHEEDED = (
    "reference.acceleration",
    "disturbance.force.",
    "disturbance.current.",
    "disturbance.normal_force_variation.",
)
"""What the keys begin with of numbers that only other references and signals from files look at."""


def numbers_of(plant: Any, experiment: Experiment, prefix: str) -> dict[str, Scalar]:
    """The numbers of a plant whose numbers may be symbols."""
    known = numbers(experiment.plant, prefix)
    return {key: value for key, value in leaves(plant, prefix).items() if key in known}
