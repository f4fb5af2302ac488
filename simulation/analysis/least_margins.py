"""Least margins of families of loops: found on a grid, refined where they may be least, exact in the end.

What `margins` says of one loop after the other, to the last digits, at a hundredth of the cost.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.analysis.complementary import LOCI, Complementary
from dualwinch.simulation.analysis.margins import LOWEST

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.intp]

KINDS: tuple[str, ...] = ("gain", "phase", "delay", "disk")
"""Margins, as fields of `margins.Margins` are called."""

POINTS = 160
"""Points of the grid, evenly apart in logarithms, beside those around lightly damped poles."""

AROUND = np.array([-5.0, -2.5, -1.2, -0.5, 0.0, 0.5, 1.2, 2.5, 5.0])
"""Points around a pole, in units of the rate at which it decays."""

NEAR, NEARER = 1.3, 1 + 1e-4
"""How much larger than the least a margin read off the grid may be, to be refined; and one refined, to be exact."""

CLOSE = 1e-6
"""Half width of the bracket about a frequency that is nearly known, as a share."""

ITERATIONS, TOLERANCE = 60, 1e-14
"""Steps to a frequency at most, and the share of it that the last one moves."""


@dataclass(frozen=True)
class Least:
    """The least margin of a family.

    Attributes:
        value: as in `margins.Margins`; infinite where nothing makes any of the loops unstable.
        loop: index of the loop it is attained in; -1 where in none.
        cut: where that is cut, of `complementary.LOCI`.
        frequency: at which, in rad/s.
    """

    value: float = math.inf
    loop: int = -1
    cut: str = ""
    frequency: float = math.nan


@dataclass(frozen=True, eq=False)
class _Found:
    """Places where a margin may be least: loops, loci, frequencies and their brackets, and the margins there; (a,).

    `before` and `after` are the loci at the ends of the bracket, or about where they are between.
    """

    loop: Indices
    locus: Indices
    lower: Floats
    upper: Floats
    before: Complex
    after: Complex
    frequency: Floats
    value: Floats

    def near(self, omega: Floats, chosen: Indices) -> Complex:
        """About where the loci of some places are at frequencies within their brackets."""
        lower, width = self.lower[chosen], self.upper[chosen] - self.lower[chosen]
        share = (omega - lower) / np.where(width > 0, width, 1.0)
        return self.before[chosen] * (1 - share) + self.after[chosen] * share

    def __getitem__(self, chosen: NDArray[np.bool_]) -> "_Found":
        return _Found(*(column[chosen] for column in vars(self).values()))


def least_margins(
    loops: Complementary, family: Indices, kinds: Sequence[str], families: int, cuts: Collection[str] = LOCI
) -> list[dict[str, Least]]:
    """The least of some margins of every family of loops; those of one that is unstable mean nothing.

    Args:
        loops: s of them.
        family: (s,) to which each belongs, from 0.
        kinds: some of `KINDS`.
        families: number of families.
        cuts: where the loops are cut, some of `complementary.LOCI`.

    Returns:
        Kind → the least, for every family.
    """
    if not len(loops.poles):
        return [dict.fromkeys(kinds, Least()) for _ in range(families)]
    omega = _grid(loops)
    response = loops.loci(omega)
    found: list[dict[str, Least]] = [{} for _ in range(families)]
    wanted = np.array([cut in cuts for cut in LOCI])
    for kind in kinds:
        places = _read_off(kind, omega, response)
        places = _near_least(places[wanted[places.locus]], family, NEAR)
        places = _near_least(_refined(kind, loops.quick, places), family, NEARER)
        exact = _refined(kind, loops.exact, places)
        for number, of_family in enumerate(found):
            mine = np.flatnonzero(family[exact.loop] == number)
            of_family[kind] = _least(exact, mine)
    return found


def _least(places: _Found, mine: Indices) -> Least:
    if not len(mine):
        return Least()
    index = mine[np.argmin(places.value[mine])]
    columns = places.value, places.loop, places.locus, places.frequency
    value, loop, locus, frequency = (column[index] for column in columns)
    return Least(float(value), int(loop), LOCI[int(locus)], float(frequency))


def _grid(loops: Complementary) -> Floats:
    """Angular frequencies (s, k) up to half the sample rate, dense around lightly damped poles."""
    highest = math.pi / loops.dt
    poles = loops.poles.copy()
    poles[(np.abs(poles) == 0) | (poles.imag <= 0)] = 1.0
    number = int((poles.imag > 0).sum(axis=1).max(initial=0))
    order = np.argsort(-poles.imag, axis=1)[:, :number]
    rate = np.log(np.take_along_axis(poles, order, axis=1)) / loops.dt
    around = (rate.imag[:, :, None] + np.abs(rate.real)[:, :, None] * AROUND).reshape(len(poles), -1)
    even = np.broadcast_to(np.geomspace(LOWEST, highest, POINTS), (len(poles), POINTS))
    return np.sort(np.clip(np.hstack([even, around]), LOWEST, highest), axis=1)


def _read_off(kind: str, omega: Floats, response: Complex) -> _Found:
    """Every place on the grid where a margin of a kind may be, and about how large it is there."""
    if kind == "disk":
        away, last = np.abs(response - 0.5), omega.shape[1] - 1
        rises = np.diff(away, axis=2) > 0
        side = np.ones((*away.shape[:2], 1), bool)
        loop, locus, at = np.nonzero(np.concatenate([side, rises], axis=2) & ~np.concatenate([rises, ~side], axis=2))
        lower, upper = omega[loop, np.maximum(at - 1, 0)], omega[loop, np.minimum(at + 1, last)]
        top = response[loop, locus, at]
        return _Found(loop, locus, lower, upper, top, top, omega[loop, at], 1 / away[loop, locus, at])
    values = response.imag if kind == "gain" else response.real - 0.5
    loop, locus, at = np.nonzero(values[:, :, :-1] * values[:, :, 1:] < 0)
    falling = values[loop, locus, at]
    share = falling / (falling - values[loop, locus, at + 1])
    before, after = response[loop, locus, at], response[loop, locus, at + 1]
    lower, upper = omega[loop, at], omega[loop, at + 1]
    if kind == "gain":
        ends = np.indices(response.shape[:2]).reshape(2, -1)  # at half the sample rate the response is real
        end, there = omega[ends[0], -1], response[ends[0], ends[1], -1]
        loop, locus, share = np.append(loop, ends[0]), np.append(locus, ends[1]), np.append(share, np.zeros(len(end)))
        lower, upper = np.append(lower, end), np.append(upper, end)
        before, after = np.append(before, there), np.append(after, there)
    frequency = lower + (upper - lower) * share
    value = _margin(kind, before * (1 - share) + after * share, frequency)
    return _Found(loop, locus, lower, upper, before, after, frequency, value)[np.isfinite(value)]


def _margin(kind: str, response: Complex, omega: Floats) -> Floats:
    """A margin from T where it is attained; infinite where that is none."""
    if kind == "disk":
        return 1 / np.abs(response - 0.5)
    if kind == "gain":
        with np.errstate(divide="ignore"):
            return np.where(response.real < 0, 1 - 1 / response.real, np.inf)
    lag = (math.pi + 2 * np.arctan2(response.imag, 0.5)) % (2 * math.pi)
    return np.degrees(lag) if kind == "phase" else lag / omega


def _near_least(places: _Found, family: Indices, factor: float) -> _Found:
    """The places whose margin is not much larger than the least of their family."""
    least = np.full(int(family.max(initial=-1)) + 1, np.inf)
    np.minimum.at(least, family[places.loop], places.value)
    return places[places.value <= factor * least[family[places.loop]]]


Evaluate = Callable[[Floats, Indices, Indices, Complex], tuple[Complex, Complex]]


def _refined(kind: str, evaluate: Evaluate, places: _Found) -> _Found:
    """The places with their frequencies found, and the margins there."""

    def wanted(omega: Floats, chosen: Indices) -> Floats:
        near = places.near(omega, chosen)
        value, slope = evaluate(omega, places.loop[chosen], places.locus[chosen], near)
        if kind == "disk":
            return ((value - 0.5).conj() * slope).real
        return value.imag if kind == "gain" else value.real - 0.5

    omega = _root(wanted, places)
    near = places.near(omega, np.arange(len(omega)))
    value = _margin(kind, evaluate(omega, places.loop, places.locus, near)[0], omega)
    return replace(places, frequency=omega, value=value)


def _root(function: Callable[[Floats, Indices], Floats], places: _Found) -> Floats:
    """Where a function of the frequency is zero: regula falsi with halved ends (Illinois), from about there.

    A function that does not change its sign has the largest integral at an end of its bracket; that end is returned.
    """
    every = np.arange(len(places.frequency))
    low, high = (np.clip(places.frequency * side, places.lower, places.upper) for side in (1 - CLOSE, 1 + CLOSE))
    at_low, at_high = function(low, every), function(high, every)
    wide = np.flatnonzero(at_low * at_high > 0)
    low[wide], high[wide] = places.lower[wide], places.upper[wide]
    at_low[wide], at_high[wide] = function(low[wide], wide), function(high[wide], wide)
    root = np.where(at_low > 0, high, low)
    active = np.flatnonzero(at_low * at_high < 0)
    for _ in range(ITERATIONS):
        if not len(active):
            break
        a, b, at_a, at_b = low[active], high[active], at_low[active], at_high[active]
        now = np.clip((a * at_b - b * at_a) / (at_b - at_a), a, b)
        at_now = function(now, active)
        moved = np.abs(now - root[active])
        root[active] = now
        same = at_now * at_a > 0  # as the lower end
        low[active], high[active] = np.where(same, now, a), np.where(same, b, now)
        at_low[active] = np.where(same, at_now, at_a / 2)
        at_high[active] = np.where(same, at_b / 2, at_now)
        active = active[(moved > TOLERANCE * now) & (at_now != 0)]
    return root
