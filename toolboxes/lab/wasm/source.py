"""C source of a module: the closed loop, its exogenous signals and reference, and the driver of a run."""

from dataclasses import replace
from importlib.resources import files

import casadi as ca

from dualwinch.toolbox import (
    compiled,
    exogenous_signals,
    idealisations,
    language,
    leaves,
    loops,
    merits,
    motions,
    nominal_model,
    physics,
    references,
    scalar,
    structures,
    translation_unit,
    tree,
    with_leaves,
)
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
    duration: scalar.Scalar = 0.0
    for number, kind in enumerate(MOTIONS):
        duration = scalar.where(settings.symbols[REFERENCE_KIND] == number, references.PAPER_DURATION[kind], duration)
    return settings.function("duration_of", duration=[settings.given(DURATION, duration)])


def motion_names(settings: Settings) -> tuple[str, ...]:
    """The exogenous signals that follow from the reference."""
    prefixes = ("reference.", "steady", "ahead.")
    return tuple(name for name in settings.loop.closed.exogenous if name.startswith(prefixes))


def motion_function(settings: Settings) -> ca.Function:
    """``motion(t, parameters) -> given``: the reference's signals at a sample, in the order of `motion_names`."""
    t, symbols = ca.SX.sym("t"), settings.symbols
    signals: dict[str, scalar.Scalar] = {}
    for number, kind in enumerate(MOTIONS):
        for limited in (False, True):
            here = _given(t, settings, kind, symbols[JERK] if limited else None)
            condition = scalar.both(symbols[REFERENCE_KIND] == number, symbols[GIVEN + JERK] == limited)
            signals = {name: scalar.where(condition, value, signals.get(name, 0.0)) for name, value in here.items()}
    return settings.function("motion", {"t": t}, given=[signals[name] for name in motion_names(settings)])


def _given(t: ca.SX, settings: Settings, kind: str, jerk_limit: scalar.Scalar | None) -> dict[str, scalar.Scalar]:
    """Signals of one kind of reference at time t, by name."""
    numbers = {key: settings.symbols[key] for key in TIMES}
    numbers |= {SPEED: settings.given(SPEED, references.PAPER_SPEED[kind]), JERK: jerk_limit}
    reference = with_leaves(replace(references.Reference(), kind=kind), numbers, "reference.")
    now, half = references.setpoint(t, reference), settings.symbols[SAMPLE_TIME] / 2
    start, end = references.steady_window(reference, settings.given(DURATION, references.PAPER_DURATION[kind]))
    signals = {"reference.x": now.x, "reference.v": now.v, "reference.a": now.a}
    signals["steady"] = scalar.both(t >= start - half, t <= end + half)
    times = settings.wide.controller.preview
    ahead = (value for column in vars(references.departures(t, times, reference)).values() for value in column)
    return signals | dict(zip(leaves(motions.no_departures(times), "ahead."), ahead, strict=True))


SIGNAL_FIELDS = ("kind", "sigma", "decay", "limit", "period", "length", "from_zero")
"""Fields of a random signal, as in ``Signal`` of sources.h."""


def parameters_function(settings: Settings) -> ca.Function:
    """``parameters_of(parameters) -> values``: the parameters of the closed loop."""
    lags = {key: scalar.maximum(settings.symbols[key], SHORTEST_LAG) for key in LAGS}
    symbols = structures.parameters_of(settings.wide) | settings.symbols | lags
    nominal = _nominal_plant(settings)
    plant_keys = tree.numbers(settings.wide.plant, "nominal.")
    symbols |= {key: value for key, value in leaves(nominal, "nominal.").items() if key in plant_keys}
    return settings.function("parameters_of", values=[symbols[name] for name in settings.loop.parameters])


def _nominal_plant(settings: Settings) -> physics.Plant:
    """The controller's nominal plant."""
    plant = with_leaves(
        settings.wide.plant, {key: settings.symbols[NOMINAL + key] for key in settings.nominal}, "plant."
    )
    vehicle, prefix = plant.vehicle, "controller.nominal."
    nominal = nominal_model.Nominal(
        mass=settings.given(f"{prefix}mass", vehicle.mass + vehicle.added_mass),
        drag_coefficient=settings.given(f"{prefix}drag_coefficient", vehicle.drag_coefficient),
        friction_coefficient=settings.given(f"{prefix}friction_coefficient", vehicle.friction_coefficient),
    )
    limits = with_leaves(settings.wide.controller.limits, settings.symbols, "controller.coordination.")
    return nominal_model.nominal_plant(nominal, plant, limits.preload)


def drawn_function(settings: Settings) -> ca.Function:
    """``drawn(parameters) -> random``: `SIGNAL_FIELDS` of each exogenous signal in turn; periods in samples."""
    symbols, step = settings.symbols, settings.symbols[SAMPLE_TIME]
    sensors = with_leaves(settings.wide.sensors, symbols, "sensors.")
    sea = with_leaves(settings.wide.disturbance, symbols, "disturbance.")
    vehicle = with_leaves(settings.wide.plant.vehicle, symbols, "plant.vehicle.")
    rows: dict[str, list[scalar.Scalar]] = {name: [0.0] * len(SIGNAL_FIELDS) for name in settings.loop.closed.exogenous}
    for name, signal in exogenous_signals.gauss_markov_signals(sensors, sea, vehicle).items():
        time = ca.SX(signal.time)
        decay = scalar.where(time > 0, scalar.exp(-step / scalar.maximum(time, 1e-300)), 0.0)
        rows[name] = [
            compiled.NORMAL * (signal.sigma > 0),
            signal.sigma,
            decay,
            signal.limit,
            0.0,
            0.0,
            signal.from_zero,
        ]
    rows["noise.lateness"][0] = compiled.UNIFORM * (symbols["simulation.jitter"] > 0)
    length, period = symbols["sensors.outage_length"], symbols["sensors.outage_period"]
    rows["noise.silent"] = [compiled.OUTAGES * (length > 0), 0.0, 0.0, 0.0, period / step, length / step, 0.0]
    return settings.function("drawn", random=[value for row in rows.values() for value in row])


def figures_function(settings: Settings) -> ca.Function:
    """``figures(state) -> metrics``: the figures of merit, from the final state."""
    states = settings.loop.closed.states
    state = ca.SX.sym("state", len(states))
    by_name = dict(zip(states, ca.vertsplit(state), strict=True))
    metrics = merits.finish({name: by_name[key] for name, key in merits.KEYS.items()}, by_name["sample"])
    return loops.named_function("figures", {"state": state}, {"metrics": ca.vertcat(*vars(metrics).values())})


def idealised_function(settings: Settings) -> ca.Function:
    """``idealised(parameters) -> checks``: value and limit of each of `idealisation_checks`."""
    plant = with_leaves(settings.wide.plant, settings.symbols, "plant.")
    tension = settings.symbols["controller.coordination.tension_min"]
    return settings.function(
        "idealised",
        checks=[each for one in idealisations.idealisation_checks(plant, tension) for each in (one.value, one.limit)],
    )


INLINED = language.Style(compares=True, inlined=True)
"""Style of operations: without calls, whose functions the module would have to contain."""


def module_source(settings: Settings) -> str:
    """C99 translation unit of a structure's module."""
    loop = settings.loop
    figures, idealised, names = figures_function(settings), idealised_function(settings), motion_names(settings)
    functions = [
        *translation_unit.hoisted_all(loop.functions),
        *language.hoisted(motion_function(settings)),
        loops.start_function(structures.structure_of(settings.wide)),
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
        "GIVEN": len(names),
        "METRICS": figures.numel_out("metrics"),
        "CHECKS": idealised.numel_out("checks"),
    }
    streams = (f"UINT64_C({exogenous_signals.stream_number(name)})" for name in exogenous)
    listed = translation_unit.macros_of_lists(STREAMS=streams, GIVEN_AT=map(exogenous.index, names))
    folder = files("dualwinch.toolboxes.lab.wasm")
    delay, run = ((folder / name).read_text(encoding="utf-8") for name in ("delay.h", "run.c"))
    # the decay of random signals must be exact: the effect of an error of 1e-9 grows with their correlation time
    written = language.c_source(functions, INLINED), language.c_source([drawn_function(settings)])
    return translation_unit.unit(sizes, functions, *compiled.FILL_PARTS, listed, *written, delay, "rollout.c", run)
