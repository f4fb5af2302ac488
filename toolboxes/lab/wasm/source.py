"""C source of a module: the closed loop, its exogenous signals and reference, and the driver of a run."""

from dataclasses import replace
from importlib.resources import files

import casadi as ca

from dualwinch.analysis.idealisations import idealisation_checks
from dualwinch.codegen.drivers.signals.signals import FILL_PARTS, NORMAL, OUTAGES, UNIFORM
from dualwinch.codegen.drivers.unit import hoisted_all, macros_of_lists, unit
from dualwinch.codegen.source.c_source import c_source
from dualwinch.codegen.source.hoist import hoisted
from dualwinch.codegen.source.operations import Style
from dualwinch.controllers.nominal import Nominal, nominal_plant
from dualwinch.model.motions import no_departures
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.tree import leaves, numbers, with_leaves
from dualwinch.model.reference import PAPER_DURATION, PAPER_SPEED, Reference, departures, setpoint, steady_window
from dualwinch.model.scalar import Scalar, both, exp, maximum, where
from dualwinch.simulation.exogenous.signals import gauss_markov_signals, stream_number
from dualwinch.simulation.loop.closed_loop import named_function, start_function
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.metrics.metrics import KEYS, finish
from dualwinch.toolboxes.lab.wasm.settings import (
    DURATION,
    GIVEN,
    LAGS,
    MOTIONS,
    NOMINAL,
    REFERENCE_KIND,
    SAMPLE_TIME,
    SHORTEST_LAG,
    Settings,
)

TIMES = ("reference.accelerate_until", "reference.cruise_until", "reference.brake_until")

SPEED, JERK = "reference.speed", "reference.jerk_limit"


def duration_function(settings: Settings) -> ca.Function:
    """``duration_of(parameters) -> duration``: length of the run in s."""
    own: Scalar = 0.0
    for number, kind in enumerate(MOTIONS):
        own = where(settings.symbols[REFERENCE_KIND] == number, PAPER_DURATION[kind], own)
    return settings.function("duration_of", duration=[settings.given(DURATION, own)])


def motion_names(settings: Settings) -> tuple[str, ...]:
    """The exogenous signals that follow from the reference."""
    given = ("reference.", "steady", "ahead.")
    return tuple(name for name in settings.loop.closed.exogenous if name.startswith(given))


def motion_function(settings: Settings) -> ca.Function:
    """``motion(t, parameters) -> given``: the reference's signals at a sample, in the order of `motion_names`."""
    t, symbols = ca.SX.sym("t"), settings.symbols
    found: dict[str, Scalar] = {}
    for number, kind in enumerate(MOTIONS):
        for limited in (False, True):
            here = _given(t, settings, kind, symbols[JERK] if limited else None)
            chosen = both(symbols[REFERENCE_KIND] == number, symbols[GIVEN + JERK] == limited)
            found = {name: where(chosen, value, found.get(name, 0.0)) for name, value in here.items()}
    return settings.function("motion", {"t": t}, given=[found[name] for name in motion_names(settings)])


def _given(t: ca.SX, settings: Settings, kind: str, jerk_limit: Scalar | None) -> dict[str, Scalar]:
    """Signals of one kind of reference at time t, by name."""
    numbers = {key: settings.symbols[key] for key in TIMES}
    numbers |= {SPEED: settings.given(SPEED, PAPER_SPEED[kind]), JERK: jerk_limit}
    reference = with_leaves(replace(Reference(), kind=kind), numbers, "reference.")
    now, half = setpoint(t, reference), settings.symbols[SAMPLE_TIME] / 2
    start, end = steady_window(reference, settings.given(DURATION, PAPER_DURATION[kind]))
    found = {"reference.x": now.x, "reference.v": now.v, "reference.a": now.a}
    found["steady"] = both(t >= start - half, t <= end + half)
    times = settings.wide.controller.preview
    ahead = (value for column in vars(departures(t, times, reference)).values() for value in column)
    return found | dict(zip(leaves(no_departures(times), "ahead."), ahead, strict=True))


SIGNAL_FIELDS = ("kind", "sigma", "decay", "limit", "period", "length", "from_zero")
"""Fields of a random signal, as in ``Signal`` of sources.h."""


def parameters_function(settings: Settings) -> ca.Function:
    """``parameters_of(parameters) -> values``: the parameters of the closed loop."""
    lags = {key: maximum(settings.symbols[key], SHORTEST_LAG) for key in LAGS}
    symbols = parameters_of(settings.wide) | settings.symbols | lags
    nominal = _nominal_plant(settings)
    known = numbers(settings.wide.plant, "nominal.")
    symbols |= {key: value for key, value in leaves(nominal, "nominal.").items() if key in known}
    return settings.function("parameters_of", values=[symbols[name] for name in settings.loop.parameters])


def _nominal_plant(settings: Settings) -> Plant:
    """The controller's nominal plant."""
    plant = with_leaves(
        settings.wide.plant, {key: settings.symbols[NOMINAL + key] for key in settings.nominal}, "plant."
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
    """``drawn(parameters) -> random``: `SIGNAL_FIELDS` of each exogenous signal in turn; periods in samples."""
    symbols, step = settings.symbols, settings.symbols[SAMPLE_TIME]
    sensors = with_leaves(settings.wide.sensors, symbols, "sensors.")
    sea = with_leaves(settings.wide.disturbance, symbols, "disturbance.")
    vehicle = with_leaves(settings.wide.plant.vehicle, symbols, "plant.vehicle.")
    rows: dict[str, list[Scalar]] = {name: [0.0] * len(SIGNAL_FIELDS) for name in settings.loop.closed.exogenous}
    for name, signal in gauss_markov_signals(sensors, sea, vehicle).items():
        time = ca.SX(signal.time)
        decay = where(time > 0, exp(-step / maximum(time, 1e-300)), 0.0)
        rows[name] = [NORMAL * (signal.sigma > 0), signal.sigma, decay, signal.limit, 0.0, 0.0, signal.from_zero]
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


def idealised_function(settings: Settings) -> ca.Function:
    """``idealised(parameters) -> checks``: value and limit of each of `idealisation_checks`."""
    plant = with_leaves(settings.wide.plant, settings.symbols, "plant.")
    tension = settings.symbols["controller.coordination.tension_min"]
    return settings.function(
        "idealised", checks=[each for one in idealisation_checks(plant, tension) for each in (one.value, one.limit)]
    )


INLINED = Style(compares=True, inlined=True)
"""Style of operations: without calls, whose functions the module would have to contain."""


def module_source(settings: Settings) -> str:
    """C99 translation unit of a structure's module."""
    loop = settings.loop
    figures, idealised, given = figures_function(settings), idealised_function(settings), motion_names(settings)
    functions = [
        *hoisted_all(loop.functions),
        *hoisted(motion_function(settings)),
        start_function(structure_of(settings.wide)),
        parameters_function(settings),
        duration_function(settings),
        figures,
        idealised,
    ]
    exogenous = loop.closed.exogenous
    sizes = loop.sizes | {
        "SETTINGS": settings.vector.numel(),
        "SAMPLE_TIME": settings.keys.index(SAMPLE_TIME),
        "QUEUE": loop.queue,
        "KINDS": len(SIGNAL_FIELDS),
        "GIVEN": len(given),
        "METRICS": figures.numel_out("metrics"),
        "CHECKS": idealised.numel_out("checks"),
    }
    streams = (f"UINT64_C({stream_number(name)})" for name in exogenous)
    listed = macros_of_lists(STREAMS=streams, GIVEN_AT=map(exogenous.index, given))
    own = files("dualwinch.toolboxes.lab.wasm")
    delay, run = ((own / name).read_text(encoding="utf-8") for name in ("delay.h", "run.c"))
    # the decay of random signals must be exact: the effect of an error of 1e-9 grows with their correlation time
    written = c_source(functions, INLINED), c_source([drawn_function(settings)])
    return unit(sizes, functions, *FILL_PARTS, listed, *written, delay, "rollout.c", run)
