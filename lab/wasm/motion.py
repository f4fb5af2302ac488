"""The reference of a module, as functions of its numbers: how long it lasts, and what it asks for at a time."""

from dataclasses import replace

import casadi as ca

from dualwinch.lab.wasm.settings import DURATION, GIVEN, KIND, MOTIONS, SAMPLE_TIME, Settings
from dualwinch.model.motions import no_departures
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.reference import PAPER_DURATION, PAPER_SPEED, Reference, departures, setpoint, steady_window
from dualwinch.model.scalar import Scalar, both, where

TIMES = ("reference.accelerate_until", "reference.cruise_until", "reference.brake_until")

SPEED, JERK = "reference.speed", "reference.jerk_limit"


def duration_function(settings: Settings) -> ca.Function:
    """``duration_of(parameters) -> duration``: length of the run in s."""
    own: Scalar = 0.0
    for number, kind in enumerate(MOTIONS):
        own = where(settings.symbols[KIND] == number, PAPER_DURATION[kind], own)
    return settings.function("duration_of", duration=[settings.given(DURATION, own)])


def motion_names(settings: Settings) -> tuple[str, ...]:
    """The exogenous signals that the reference gives."""
    given = ("reference.", "steady", "ahead.")
    return tuple(name for name in settings.loop.closed.exogenous if name.startswith(given))


def motion_function(settings: Settings) -> ca.Function:
    """``motion(t, parameters) -> given``: what the reference gives of a sample, in the order of `motion_names`."""
    t, symbols = ca.SX.sym("t"), settings.symbols
    found: dict[str, Scalar] = {}
    for number, kind in enumerate(MOTIONS):
        for limited in (False, True):
            here = _given(t, settings, kind, symbols[JERK] if limited else None)
            chosen = both(symbols[KIND] == number, symbols[GIVEN + JERK] == limited)
            found = {name: where(chosen, value, found.get(name, 0.0)) for name, value in here.items()}
    return settings.function("motion", {"t": t}, given=[found[name] for name in motion_names(settings)])


def _given(t: ca.SX, settings: Settings, kind: str, jerk_limit: Scalar | None) -> dict[str, Scalar]:
    """What a kind of reference gives of the sample at a time."""
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
