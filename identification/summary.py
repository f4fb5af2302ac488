"""What logs say of a machine, in words and tables: the same at a prompt, in a notebook and on the terminal."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.found import Found
from dualwinch.identification.surprises import Whiteness
from dualwinch.identification.unknowns import Unknown
from dualwinch.model.quantities.quantity import behind_number

Floats = NDArray[np.float64]

CORRELATED = 0.9
"""Correlation of two estimates' errors from which on it is told."""

HARDLY = 0.9
"""Deviation after the fit over that before, from which on logs have hardly said anything of a number."""


def headline(found: Found) -> str:
    """What was done, in one line."""
    many = len(found.logs) != 1
    return (
        f"{len(found.keys)} number{'s' * (len(found.keys) != 1)} from {found.duration:.4g} s of "
        f"{len(found.logs)} log{'s' * many}"
    )


def estimates_table(found: Found) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: what was believed, the estimate, its standard deviation, 95 % interval."""
    rows = []
    for unknown, value, deviation in zip(found.unknowns, found.values, found.deviations, strict=True):
        low, high = found.interval(unknown.key)
        share = f"{deviation / abs(value):.2%}" if value and deviation < abs(value) else ""
        digits = _digits(value, deviation)
        rows.append([
            unknown.key,
            f"{unknown.start:.6g}",
            f"{value:.{digits}g}",
            f"{deviation:.2g}",
            share,
            f"{low:.{digits}g} to {high:.{digits}g}",
            behind_number(unknown.unit).strip(),
        ])  # fmt: skip
    return ["", "believed", "estimate", "± 1 s.d.", "", "95 % interval", ""], rows


def sensors_table(found: Found) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: how noisy each sensor is, and whether what is left of it is noise."""
    rows = []
    held = {test.name: test for test in found.held_out}
    for test in found.tests:
        other = held.get(test.name)
        rows.append([
            test.name,
            f"{test.count}",
            f"{found.noise.get(test.name, math.nan):.3g}",
            left(test),
            f"{other.variance:.3f}" if other else "",
        ])  # fmt: skip
    headings = ["sensor", "readings", "noise (s.d.)", "what is left", "variance held out" if held else ""]
    return headings, rows


def optima_table(found: Found) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: where searches from several starts came to rest, and how likely the logs are there."""
    rows = [
        [f"{each.searches}", f"{-each.worse / 2:.3g}", *(f"{value:.5g}" for value in each.values)]
        for each in found.optima
    ]
    return ["searches", "log likelihood over the best", *found.keys], rows


def profiles_table(found: Found) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: intervals by the likelihood itself, beside those by the standard deviation."""
    rows = []
    for profile in found.profiles:
        ends = (*profile.interval, *found.interval(profile.key))
        low, high, by_low, by_high = (f"{end:.6g}" for end in ends)
        rows.append([profile.key, f"{low} to {high}", f"{by_low} to {by_high}"])
    return ["", "95 % interval by its profile", "by its deviation"], rows


def tables(found: Found) -> list[tuple[list[str], list[list[str]]]]:
    """All tables that there are."""
    further = [optima_table(found)] if len(found.optima) > 1 else []
    further += [profiles_table(found)] if found.profiles else []
    return [estimates_table(found), sensors_table(found), *further]


def left(test: Whiteness) -> str:
    """What is left of a sensor, in words."""
    if test.white:
        return "white"
    if abs(test.by_torque) > abs(test.correlation):
        return f"follows torques: {test.by_torque:+.2f} after {test.torque_lag} samples"
    return f"correlated: {test.correlation:+.2f} after {test.lag} samples"


def notes(found: Found) -> list[str]:
    """What a reader has to know of the tables."""
    words = [*found.excess, *(each.words for each in found.blind)]
    correlation = found.correlation
    words += [f"{key}: the logs add hardly anything to what was known beforehand" for key in hardly_told(found)]
    for row in range(len(found.keys)):
        for column in range(row):
            if abs(correlation[row, column]) > CORRELATED:
                pair = f"{found.keys[column]} and {found.keys[row]}"
                words.append(f"{pair}: errors go together, correlation {correlation[row, column]:+.3f}")
    for unknown, value in zip(found.unknowns, found.values, strict=True):
        if min(value - unknown.lower, unknown.upper - value) <= 1e-6 * unknown.scale:
            words.append(f"{unknown.key}: lies at the end of its range; is the log of this machine?")
    if len(found.optima) > 1:
        words.append(
            f"{len(found.optima)} distinct optima; the second is less likely, exp({-found.optima[1].worse / 2:.3g})"
        )
    if not found.settled:
        words.append("the fit had not come to rest after the last round: deviations may be too small")
    return words


def hardly_told(found: Found) -> tuple[str, ...]:
    """Keys that are known hardly any better than beforehand."""
    return hardly_known(found.unknowns, found.deviations)


def hardly_known(unknowns: Sequence[Unknown], deviations: Floats) -> tuple[str, ...]:
    """Keys whose deviation after a fit is hardly less than that beforehand."""
    return tuple(
        unknown.key
        for unknown, deviation in zip(unknowns, deviations.tolist(), strict=True)
        if unknown.prior and deviation > HARDLY * unknown.prior.deviation
    )


def _digits(value: float, deviation: float) -> int:
    """So many digits of a value that the last is a tenth of its deviation."""
    if not value or not deviation or not math.isfinite(deviation):
        return 4
    return min(max(math.floor(math.log10(abs(value))) - math.floor(math.log10(deviation)) + 2, 2), 9)
