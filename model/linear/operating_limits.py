"""What an operating point must keep to: ranges that are errors, limits that are reported."""

import math
from collections.abc import Sequence

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.ropes.track import SHORTEST_ROPE, Track

FASTEST = 10.0
"""Bound in m/s on the speed of an operating point, far beyond what the ropes can give."""

TOLERANCE = 1e-9
"""Share by which a limit may be passed: round-off."""


def check_range(key: str, value: float, lower: float, upper: float, unit: str, *, strictly: bool = False) -> None:
    """Raise `ConfigurationError` for a number that is not finite or out of its range."""
    if math.isfinite(value) and (lower < value < upper if strictly else lower <= value <= upper):
        return
    ends = [
        f"{sign}{'' if strictly else '='} {bound:g}"
        for sign, bound in ((">", lower), ("<", upper))
        if math.isfinite(bound)
    ]
    raise ConfigurationError(
        f"{key} = {value:g}: must be a finite number {' and '.join(ends)} {unit}".replace("  ", " ")
    )


def check_position(x: float, track: Track) -> None:
    """Raise `ConfigurationError` for a position off the track, or one that leaves a rope at its shortest length."""
    overrun = track.rope_offset / 2
    check_range("x", x, -overrun, track.length + overrun, "m (the track of plant.track.length, and half a rope_offset)")
    for rope, length in enumerate((track.length - x + track.rope_offset, x + track.rope_offset), start=1):
        if length <= SHORTEST_ROPE:
            raise ConfigurationError(
                f"x = {x:g}: leaves {length:g} m of rope {rope}, must be > {SHORTEST_ROPE:g} m "
                f"(plant.track.rope_offset = {track.rope_offset:g} m)"
            )


def violations(
    v: float, forces: Sequence[float], torques: Sequence[float], plant: Plant, limits: tuple[float, float]
) -> tuple[str, ...]:
    """Limits that tensions in N and torques in N m do not respect, in words.

    Args:
        v: speed of the cruise in m/s.
        forces: tensions F1 and F2.
        torques: motor torques tau_1 and tau_2.
        plant: its winches say which torque gives which tension.
        limits: tension_min and tension_max.
    """
    words = []
    motion = f"cruise at {v:g} m/s" if v else "rest"
    lower, upper = limits
    for number, winch in enumerate((plant.winch_1, plant.winch_2), start=1):
        force, torque = forces[number - 1], torques[number - 1]
        if force > upper * (1 + TOLERANCE):
            words.append(f"{motion} needs {_newtons(force)} in rope {number} > tension_max = {_newtons(upper)}")
            continue
        ratio = winch.drum_radius / winch.gear_ratio
        for sign, limit, name in ((-1, lower, "tension_min"), (1, upper, "tension_max")):
            if sign * (torque - ratio * limit) > TOLERANCE * ratio * upper:
                words.append(
                    f"{motion} needs tau_{number} = {torque:.4g} N m {'<>'[sign > 0]} {ratio * limit:.4g} N m, "
                    f"the torque of {name}"
                )
    return tuple(words)


def remarks(preload: float, forces: Sequence[float]) -> tuple[str, ...]:
    """What else is to be known of tensions in N that were asked to sum up to a preload in N, in words."""
    total = sum(forces)
    if abs(total - preload) <= TOLERANCE * preload:
        return ()
    return (f"a rope is at its limit: the tensions' sum is {_newtons(total)}, not the preload's {_newtons(preload)}",)


def _newtons(force: float) -> str:
    return f"{force:,.0f} N".replace(",", " ")
