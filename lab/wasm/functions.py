"""What follows from a module's numbers, as functions of their vector: parameters, random signals, figures of merit."""

import casadi as ca

from dualwinch.codegen.drivers.signals.signals import NORMAL, OUTAGES, UNIFORM
from dualwinch.controllers.nominal import Nominal, nominal_plant
from dualwinch.lab.wasm.settings import BELIEVED, SAMPLE_TIME, Settings
from dualwinch.lab.wasm.wide import LAG, SHORTEST_LAG
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.tree import leaves, numbers, with_leaves
from dualwinch.model.scalar import Scalar, exp, maximum, where
from dualwinch.simulation.exogenous.signals import courses
from dualwinch.simulation.loop.zero_order_hold import named_function
from dualwinch.simulation.metrics.metrics import KEYS, finish

KINDS = ("kind", "sigma", "decay", "limit", "period", "length", "from_zero")
"""What is said of a random signal, as in ``Signal`` of sources.h."""


def parameters_function(settings: Settings) -> ca.Function:
    """``parameters_of(parameters) -> values``: what the closed loop takes."""
    symbols = settings.symbols | {LAG: maximum(settings.symbols[LAG], SHORTEST_LAG)}
    believed = _believed_plant(settings)
    known = numbers(settings.wide.plant, "nominal.")
    symbols |= {key: value for key, value in leaves(believed, "nominal.").items() if key in known}
    return settings.function("parameters_of", values=[symbols[name] for name in settings.loop.parameters])


def _believed_plant(settings: Settings) -> Plant:
    """The plant as the controller believes it to be."""
    plant = with_leaves(
        settings.wide.plant, {key: settings.symbols[BELIEVED + key] for key in settings.believed}, "plant."
    )
    vehicle, prefix = plant.vehicle, "controller.nominal."
    nominal = Nominal(
        mass=settings.given(f"{prefix}mass", vehicle.mass + vehicle.added_mass),
        drag_coefficient=settings.given(f"{prefix}drag_coefficient", vehicle.drag_coefficient),
        friction_coefficient=settings.given(f"{prefix}friction_coefficient", vehicle.friction_coefficient),
    )
    limits = with_leaves(settings.wide.controller.limits, settings.symbols, "controller.coordination.")
    return nominal_plant(nominal, plant, limits.preload)


def drawn_function(settings: Settings) -> ca.Function:
    """``drawn(parameters) -> random``: `KINDS` of each exogenous signal, one after the other; periods in samples."""
    symbols, step = settings.symbols, settings.symbols[SAMPLE_TIME]
    sensors = with_leaves(settings.wide.sensors, symbols, "sensors.")
    sea = with_leaves(settings.wide.disturbance, symbols, "disturbance.")
    vehicle = with_leaves(settings.wide.plant.vehicle, symbols, "plant.vehicle.")
    rows: dict[str, list[Scalar]] = {name: [0.0] * len(KINDS) for name in settings.loop.closed.exogenous}
    for name, course in courses(sensors, sea, vehicle).items():
        time = ca.SX(course.time)
        decay = where(time > 0, exp(-step / maximum(time, 1e-300)), 0.0)
        rows[name] = [NORMAL * (course.sigma > 0), course.sigma, decay, course.limit, 0.0, 0.0, course.from_zero]
    rows["noise.lateness"][0] = UNIFORM * (symbols["simulation.jitter"] > 0)
    length, period = symbols["sensors.outage_length"], symbols["sensors.outage_period"]
    rows["noise.silent"] = [OUTAGES * (length > 0), 0.0, 0.0, 0.0, period / step, length / step, 0.0]
    return settings.function("drawn", random=[value for row in rows.values() for value in row])


def figures_function(settings: Settings) -> ca.Function:
    """``figures(state) -> metrics``: the figures of merit, from the final state."""
    states = settings.loop.closed.states
    state = ca.SX.sym("state", len(states))
    by_name = dict(zip(states, ca.vertsplit(state), strict=True))
    metrics = finish({name: by_name[key] for name, key in KEYS.items()}, by_name["sample"])
    return named_function("figures", {"state": state}, {"metrics": ca.vertcat(*vars(metrics).values())})
