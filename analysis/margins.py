"""Stability margins of opened loops: gain, phase, delay and disk; of one loop, or the smallest of many.

They are derived from the complementary sensitivity T = L/(1 + L): |L| = 1 where Re T = 1/2, L is real where T is, and
the largest disk has the radius 1 / max|T - 1/2|. T is stable if the closed loop is, and its poles show where to refine
the frequency grid: margins are found on this grid, then refined by inverse interpolation.

A late computer or a weak supply changes both torques alike. For such changes the eigenvalues of the two torques' T, a
matrix, take the place of T at a single opening (the characteristic loci of MacFarlane and Postlethwaite, Int. J.
Control 25, 1977).
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.properties import BACKWARD_ERROR, balancing_scales, has_growth, states_that_matter
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.quantities.quantity import Quantity

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]

MARGIN_KINDS: tuple[str, ...] = ("gain", "phase", "delay", "disk")
"""Kinds of margins: names of fields of `Margins`."""

BOTH = "torques"
"""Name of equal changes of both torques, in addition to the openings."""

LOCI = ("u", "tau_1", "tau_2", BOTH, BOTH)
"""Opening of each of the five loci of a loop with three openings."""

LOWEST, SLOW, BELOW = 1e-3, 1e-2, 0.25
"""Lowest angular frequency of the regular grid in rad/s. For a closed loop with slower poles the grid extends down to
the share SLOW of the slowest pole, with the share BELOW of the grid's points. Every grid includes 0."""

ALL_BUT_REAL = 1e-6
"""Relative imaginary part of a locus of both torques up to which it is round-off of a real one."""

ROUND_OFF_MARGIN = 1e9
"""Gain margin at the frequency 0, or factor by which the gain may fall, from which on it is round-off: the loop has no
gain there, or an integrator."""

FORGOTTEN, SILENT = 0.05, 1e-14
"""Magnitude up to which poles are left out of sums over poles (those of delays are 0, with too few eigenvectors), and
relative magnitude at which the series of their impulse responses ends."""

AT_A_POLE = math.sqrt(np.finfo(float).max)
"""Finite substitute for infinity at a pole, so that a residue of 0 gives 0."""

NEAR_LEAST, NEARER_LEAST = 1.3, 1 + 1e-4
"""Ratios to the smallest margin: up to the first, margins on the grid are refined; up to the second, made exact."""

CLOSE = 1e-6
"""Relative half-width of the bracket around a nearly known frequency."""

ITERATIONS, TOLERANCE, QUICK_TOLERANCE = 60, 1e-12, 1e-8
"""Maximum iterations for a frequency, and its relative tolerance: from matrices, and from sums over poles."""


@dataclass(frozen=True)
class Margins:
    """Changes that a loop tolerates before it becomes unstable; infinite where no such change makes it unstable."""

    stable: Annotated[
        bool, Quantity("", "whether the closed loop is stable; margins of an unstable loop are meaningless")
    ]
    gain: Annotated[float, Quantity("1", "largest factor on the loop gain")]
    gain_frequency: Annotated[float, Quantity("rad/s", "frequency of the oscillation at that gain")]
    least_gain: Annotated[float, Quantity("1", "smallest factor on the loop gain; 0: it may vanish")]
    least_gain_frequency: Annotated[float, Quantity("rad/s", "frequency of the oscillation at that gain")]
    phase: Annotated[float, Quantity("deg", "largest extra phase lag")]
    phase_frequency: Annotated[float, Quantity("rad/s", "gain crossover with the smallest phase margin")]
    delay: Annotated[float, Quantity("s", "largest extra delay")]
    delay_frequency: Annotated[float, Quantity("rad/s", "gain crossover with the smallest delay margin")]
    disk: Annotated[
        float, Quantity("1", "radius of the largest disk of simultaneous gain and phase changes; from 2 on any gain")
    ]
    disk_gain: Annotated[float, Quantity("1", "factor the gain may rise or fall by while the phase shifts too")]
    disk_phase: Annotated[float, Quantity("deg", "phase that may shift either way while the gain changes too")]
    disk_frequency: Annotated[float, Quantity("rad/s", "frequency at which the disk touches")]


class FrequencyGrid(NamedTuple):
    """Frequency grid of the search for margins.

    Attributes:
        points: number of logarithmically spaced points, up to half the sample rate.
        around: offsets of further points around every complex pole, whose peak the regular points may miss, in units of
            its decay rate.
        exact: whether T is evaluated from its matrices instead of as a sum over its poles, which is faster.
    """

    points: int
    around: Floats
    exact: bool


FINE = FrequencyGrid(1000, np.linspace(-5, 5, 41), exact=True)
"""For one loop."""

COARSE = FrequencyGrid(160, np.array([-5.0, -2.5, -1.2, -0.5, 0.0, 0.5, 1.2, 2.5, 5.0]), exact=False)
"""For thousands of loops."""


def margins(loop: LinearSystem) -> Margins:
    """Margins of a loop L with negative feedback, ``1/(1 + L)``; with two signals, for equal changes of both.

    The disk is the balanced one: ``L`` times any ``(1 + d/2)/(1 - d/2)`` with |d| smaller than its radius is stable.

    Where the direct feedthrough of ``1 + L`` is singular, the closed loop is not well posed, and all margins are those
    of no change at all.

    Args:
        loop: discrete, with one input and one output, or two of each, e.g. from
            `analysis.linear_loop.linear_open_loop`, or a ``StateSpace`` of python-control.

    Raises:
        ConfigurationError: a continuous system, more inputs or outputs, no state-space system, or elements that are
            not finite.

    Example:
        >>> import dualwinch as dw
        >>> margins = dw.margins(dw.linear_open_loop(dw.case(4)))
        >>> f"gain {margins.gain:.3g}, phase {margins.phase:.3g} deg, delay {1e3 * margins.delay:.3g} ms"
        'gain 5.34, phase 88.1 deg, delay 23.6 ms'
    """
    requirement = "a discrete state-space system of one input and one output, or two of each"
    if not hasattr(loop, "D"):
        raise ConfigurationError(f"loop: is a {type(loop).__name__}: must be {requirement}, e.g. control.ss(loop)")
    if loop.D.shape not in {(1, 1), (2, 2)}:
        outputs, inputs = loop.D.shape
        raise ConfigurationError(f"loop: has {inputs} inputs and {outputs} outputs: must be {requirement}")
    if not all(np.isfinite(matrix).all() for matrix in (loop.A, loop.B, loop.C, loop.D)):
        raise ConfigurationError(f"loop: has elements that are no finite numbers: must be {requirement}")
    if isinstance(loop.dt, bool) or not loop.dt or loop.dt < 0:
        raise ConfigurationError(
            f"loop: dt = {loop.dt}: must be > 0 s, {requirement} "
            "(control.sample_system makes one of a continuous system)"
        )
    through = np.eye(len(loop.D)) + loop.D
    if abs(np.linalg.det(through)) <= np.finfo(float).eps:
        nowhere = math.nan
        return Margins(*(False, 1.0, nowhere, 1.0, nowhere, 0.0, nowhere, 0.0, nowhere, 0.0, 1.0, 0.0, nowhere))
    closed = complementary(loop.A[None], loop.B[None], -loop.C[None], -loop.D[None], loop.dt)
    (smallest,) = least_margins(closed, np.zeros(1, np.intp), (*MARGIN_KINDS, "fall"), 1, grid=FINE)
    gain, phase, delay, disk, fall = smallest.values()
    least_gain = 1 / fall.value if fall.value < ROUND_OFF_MARGIN else 0.0
    if fall.frequency == 0:  # for a slow loop T is round-off there, L is not
        least_gain = max((-1 / value for value in _at_rest(loop) if value <= -1), default=0.0)
    return Margins(
        stable=not has_growth(loop.A - loop.B @ np.linalg.solve(through, loop.C), loop.dt),
        gain=gain.value,
        gain_frequency=gain.frequency,
        least_gain=least_gain,
        least_gain_frequency=fall.frequency,
        phase=phase.value,
        phase_frequency=phase.frequency,
        delay=delay.value,
        delay_frequency=delay.frequency,
        disk=disk.value,
        disk_gain=(1 + disk.value / 2) / (1 - disk.value / 2) if disk.value < 2 else math.inf,
        disk_phase=math.degrees(2 * math.atan(disk.value / 2)),
        disk_frequency=disk.frequency,
    )


def _at_rest(loop: LinearSystem) -> list[float]:
    """The real loci of a loop at the frequency 0; infinite with an integrator, even a rounded one.

    Real up to round-off, by the same criterion as T = L/(1 + L) on the frequency grid.
    """
    try:
        gains = loop.C @ np.linalg.solve(np.eye(len(loop.A)) - loop.A, loop.B) + loop.D
    except np.linalg.LinAlgError:
        return [math.inf]
    loci = np.linalg.eigvals(gains)
    real = loci.real[np.abs(loci.imag) <= ALL_BUT_REAL * np.abs(loci * (1 + loci))]
    return np.where(np.abs(real) < ROUND_OFF_MARGIN, real, math.inf).tolist()


ROWS = {1: (0,), 2: (0, 0, 1, 1), 3: (0, 1, 1, 2, 2)}
COLUMNS = {1: (0,), 2: (0, 1, 0, 1), 3: (0, 1, 2, 1, 2)}
DIAGONAL = {1: (0,), 2: (0, 0), 3: (0, 1, 4, 1, 1)}
"""Number of openings → `ComplementarySensitivity.rows`, `columns` and `diagonal`."""


@dataclass(frozen=True, eq=False)
class ComplementarySensitivity:
    """T of s loops with one sample time, at one opening, at both torques, or at three openings.

    Attributes:
        A, B, C, D: closed loops, (s, n, n), (s, n, m), (s, m, n), (s, m, m): T = C (z - A)^-1 B + D. A state that is
            idle in a loop has zeros there.
        dt: sample time in s.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    dt: float

    @property
    def rows(self) -> tuple[int, ...]:
        """Row indices of the needed elements of T; see `columns`."""
        return ROWS[self.D.shape[1]]

    @property
    def columns(self) -> tuple[int, ...]:
        """Column indices of the needed elements of T; see `rows`."""
        return COLUMNS[self.D.shape[1]]

    @property
    def diagonal(self) -> Indices:
        """Index of the element that each locus equals; arbitrary for the last two loci, which are eigenvalues."""
        return np.array(DIAGONAL[self.D.shape[1]])

    @cached_property
    def _modes(self) -> tuple[Complex, Complex]:
        return _by_size(self.A)

    @property
    def poles(self) -> Complex:
        """(s, n) eigenvalues of A."""
        return self._modes[0]

    @property
    def stable(self) -> Flags:
        """(s,) whether no mode of a loop grows (`model.linear.properties.has_growth`).

        The rounding error of a double pole is of the order of the square root of that of the matrix: no further from
        the unit circle a closer look is needed.
        """
        excess = np.abs(self.poles).max(axis=1, initial=0.0) - 1
        rounding = BACKWARD_ERROR * self.A.shape[1] * np.finfo(float).eps * np.linalg.norm(self.A, axis=(1, 2))
        stable = excess <= 0
        for loop in np.flatnonzero(~stable & (excess < np.sqrt(rounding))):
            stable[loop] = not has_growth(self.A[loop], self.dt)
        return stable

    @cached_property
    def _parts(self) -> tuple[Complex, Floats]:
        """Residues of the slow poles, by right and left eigenvectors, and impulse response of the fast ones ("echoes").

        Residues (s, elements, poles) are those of the elements of T at the largest poles; 0 for poles that decay
        within few samples (`FORGOTTEN`). Echoes (j, s, elements) are the contribution of those to the impulse response.
        """
        poles, right = self._modes
        _, left_vectors = _by_size(np.swapaxes(self.A, 1, 2))
        lasting = np.abs(poles) > FORGOTTEN
        count = int(lasting.sum(axis=1).max(initial=0))
        lasting, right, left_vectors = lasting[:, :count], right[:, :, :count], left_vectors[:, :, :count]
        right, left_vectors = np.where(lasting[:, None], right, 0.0), np.where(lasting[:, None], left_vectors, 0.0)
        across = np.swapaxes(left_vectors, 1, 2) @ right
        index = np.arange(count)
        across[:, index, index] += ~lasting
        weights = np.linalg.solve(across, np.swapaxes(left_vectors, 1, 2) @ self.B)
        output_vectors = self.C @ right
        residues = output_vectors[:, self.rows] * np.swapaxes(weights, 1, 2)[:, self.columns]
        echoes, remainder = [], self.B - (right @ weights).real
        for _ in range(self.A.shape[1] + 10):
            echoes.append((self.C @ remainder)[:, self.rows, self.columns])
            if not np.abs(remainder).max(initial=0.0) > SILENT * np.abs(self.B).max(initial=0.0):
                break
            remainder = self.A @ remainder
        return np.asarray(residues, complex), np.array(echoes)

    def loci(self, omega: Floats, *, exact: bool) -> Complex:
        """Loci (s, loci, k) of all loops at ascending frequencies (s, k) in rad/s, exact or by sums over poles."""
        elements = self._exact_elements(omega) if exact else self._summed_elements(omega)
        if elements.shape[1] == 1:
            return elements
        alone = elements[:, self.diagonal[:-2]]
        half, root = _halves(elements)
        return np.concatenate([alone, np.stack(continuous_loci(half + root, half - root), axis=1)], axis=1)

    def _summed_elements(self, omega: Floats) -> Complex:
        z = np.exp(1j * self.dt * omega)
        residues, echoes = self._parts
        constant = self.D[:, self.rows, self.columns].astype(complex)
        with np.errstate(divide="ignore", invalid="ignore"):  # at a pole of an unstable loop
            inverse = 1 / (z[:, None] - self.poles[:, : residues.shape[2], None])
        elements = residues @ np.where(np.isfinite(inverse), inverse, AT_A_POLE) + constant[:, :, None]
        delay_factor = 1 / z[:, None]
        for echo in echoes:
            elements += echo[:, :, None] * delay_factor
            delay_factor = delay_factor / z[:, None]
        return elements

    def _exact_elements(self, omega: Floats) -> Complex:
        pencils = np.exp(1j * self.dt * omega)[..., None, None] * np.eye(self.A.shape[1]) - self.A[:, None]
        values = self.C[:, None] @ _solved(pencils, self.B[:, None].astype(complex)) + self.D[:, None]
        return np.moveaxis(np.asarray(values[:, :, self.rows, self.columns], complex), 2, 1)

    def quick(self, omega: Floats, loop: Indices, locus: Indices, near: Complex) -> tuple[Complex, Complex]:
        """Loci (a,) and their slopes over frequency, at one frequency in rad/s each, by sums over poles.

        `loop` and `locus` are indices (a,); approximate values (a,) distinguish the last two loci.
        """
        z = np.exp(1j * self.dt * omega)
        residues, echoes = self._parts
        distance = (z[:, None] - self.poles[loop, : residues.shape[2]])[:, None]
        terms = residues[loop] / distance
        values = terms.sum(axis=2) + self.D[loop][:, self.rows, self.columns]
        slopes = -1j * self.dt * z[:, None] * (terms / distance).sum(axis=2)
        for number, echo in enumerate(echoes[:, loop], start=1):
            delayed_echo = echo * z[:, None] ** -number
            values += delayed_echo
            slopes -= 1j * self.dt * number * delayed_echo
        return self._locus(values, slopes, locus, near)

    def exact(self, omega: Floats, loop: Indices, locus: Indices, near: Complex) -> tuple[Complex, Complex]:
        """The same, from the matrices."""
        z = np.exp(1j * self.dt * omega)
        pencils = z[:, None, None] * np.eye(self.A.shape[1]) - self.A[loop]
        states = _solved(pencils, self.B[loop].astype(complex))
        values = self.C[loop] @ states + self.D[loop]
        slopes = -1j * self.dt * z[:, None, None] * (self.C[loop] @ _solved(pencils, states))
        elements, slopes = (np.asarray(matrix[:, self.rows, self.columns], complex) for matrix in (values, slopes))
        return self._locus(elements, slopes, locus, near)

    def _locus(self, values: Complex, slopes: Complex, locus: Indices, near: Complex) -> tuple[Complex, Complex]:
        """Loci and their slopes (a,) from the elements of T and their slopes (a, elements)."""
        row = np.arange(len(values))
        alone = values[row, self.diagonal[locus]], slopes[row, self.diagonal[locus]]
        if values.shape[1] == 1:
            return alone
        half, root = _halves(values)
        both = half + np.where(np.abs(half + root - near) <= np.abs(half - root - near), root, -root)
        element_11, upper, lower, element_22 = values.T[-4:]
        d_first, d_upper, d_lower, d_second = slopes.T[-4:]
        turned = d_first * (both - element_22) + d_second * (both - element_11) + d_upper * lower + upper * d_lower
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = turned / (2 * (both - half))
        together = locus >= len(self.diagonal) - 2
        return np.where(together, both, alone[0]), np.where(together, rate, alone[1])


def _solved(pencils: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solutions of many linear systems; very large for a singular one, at a pole."""
    try:
        return np.linalg.solve(pencils, right)
    except np.linalg.LinAlgError:
        return np.linalg.solve(pencils + np.finfo(float).eps * np.eye(pencils.shape[-1]), right)


def continuous_loci(locus_1: Complex, locus_2: Complex) -> tuple[Complex, Complex]:
    """Two loci (…, k) at ascending frequencies, exchanged from where on that makes their steps shorter."""
    in_order = np.abs(np.diff(locus_1)) + np.abs(np.diff(locus_2))
    crossed = np.abs(locus_1[..., 1:] - locus_2[..., :-1]) + np.abs(locus_2[..., 1:] - locus_1[..., :-1])
    exchanges = np.zeros(locus_1.shape, bool)
    exchanges[..., 1:] = np.logical_xor.accumulate(crossed < in_order, axis=-1)
    return np.where(exchanges, locus_2, locus_1), np.where(exchanges, locus_1, locus_2)


def _halves(elements: Complex) -> tuple[Complex, Complex]:
    """Mean and half the difference of the eigenvalues of the torques' T, from its elements along the second axis."""
    element_11, upper, lower, element_22 = np.moveaxis(elements, 1, 0)[-4:]
    return (element_11 + element_22) / 2, np.sqrt(((element_11 - element_22) / 2) ** 2 + upper * lower)


def complementary(A: Floats, B: Floats, C: Floats, D: Floats, dt: float) -> ComplementarySensitivity:
    """T from state-space matrices of s loops that are opened at all their m openings.

    A (s, n, n), B (s, n, m) of the injected signals, C (s, m, n) of the returned ones, D (s, m, m); sample time in s.
    """
    through = np.linalg.inv(np.eye(D.shape[1]) - D)
    C, entered = through @ C, B @ through
    closed = A + B @ C
    matter = states_that_matter(closed, entered, C)
    closed = np.where(matter[:, :, None] & matter[:, None, :], closed, 0.0)
    entered, C = np.where(matter[:, :, None], entered, 0.0), np.where(matter[:, None, :], C, 0.0)
    state_order = np.argsort(~matter, axis=1, kind="stable")[:, : int(matter.sum(axis=1).max(initial=0))]
    by_row, by_column = state_order[:, :, None], state_order[:, None, :]
    closed = np.take_along_axis(np.take_along_axis(closed, by_row, 1), by_column, 2)
    entered, C = np.take_along_axis(entered, by_row, 1), np.take_along_axis(C, by_column, 2)
    size = balancing_scales(closed)
    balanced = closed / size[:, :, None] * size[:, None, :]
    return ComplementarySensitivity(balanced, entered / size[:, :, None], -C * size[:, None, :], -through @ D, dt)


def _by_size(A: Floats) -> tuple[Complex, Complex]:
    """Eigenvalues and eigenvectors of matrices, in order of falling magnitude."""
    values, vectors = np.linalg.eig(A)
    order = np.argsort(-np.abs(values), axis=1)
    spectrum = np.take_along_axis(values, order, axis=1), np.take_along_axis(vectors, order[:, None], axis=2)
    return spectrum[0].astype(complex), spectrum[1].astype(complex)


@dataclass(frozen=True)
class LeastMargin:
    """The smallest margin of a group of loops, with its opening (of `LOCI`) and its frequency in rad/s.

    As in `Margins`; infinite, with the loop -1, if no such change makes any loop unstable.
    """

    value: float = math.inf
    loop: int = -1
    opening: str = ""
    frequency: float = math.nan


@dataclass(frozen=True, eq=False)
class _Places:
    """Candidates for the smallest margin: loops, loci, frequencies with their brackets, and margins there; (a,) each.

    `before` and `after` are the loci at the ends of the bracket, or approximations of them.
    """

    loop: Indices
    locus: Indices
    lower: Floats
    upper: Floats
    before: Complex
    after: Complex
    frequency: Floats
    value: Floats

    def near(self, omega: Floats, places: Indices) -> Complex:
        """Approximate loci of some places at frequencies within their brackets, by linear interpolation."""
        lower, width = self.lower[places], self.upper[places] - self.lower[places]
        share = (omega - lower) / np.where(width > 0, width, 1.0)
        return self.before[places] * (1 - share) + self.after[places] * share

    def __getitem__(self, places: Flags) -> "_Places":
        return _Places(*(column[places] for column in vars(self).values()))


def least_margins(
    loops: ComplementarySensitivity,
    group: Indices,
    kinds: Sequence[str],
    groups: int,
    openings: Collection[str] = LOCI,
    *,
    grid: FrequencyGrid = COARSE,
    among: Indices | None = None,
) -> list[dict[str, LeastMargin]]:
    """The smallest margins of every group of loops, by kind; meaningless for a group with an unstable loop.

    Args:
        loops: the s loops.
        group: (s,) index of the group of each loop, from 0.
        kinds: of `MARGIN_KINDS`, or ``fall``, the factor by which the gain may fall.
        groups: number of groups.
        openings: of `LOCI`.
        grid: frequency grid.
        among: (s,) larger groups: margins far above the smallest of these are only read off the grid. Default: `group`.
    """
    if not len(loops.D):
        return [dict.fromkeys(kinds, LeastMargin()) for _ in range(groups)]
    omega = _frequencies(loops, grid)
    response = loops.loci(omega, exact=grid.exact)
    margins_by_group: list[dict[str, LeastMargin]] = [{} for _ in range(groups)]
    opening_mask = np.array([opening in openings for opening in LOCI])
    for kind in kinds:
        places = _read_off(kind, omega, response)
        places = places[opening_mask[places.locus]]
        for of_group in margins_by_group:
            of_group[kind] = LeastMargin()
        if among is not None:
            _note_least(margins_by_group, kind, places, group)
        places = _near_least(places, group if among is None else among, NEAR_LEAST)
        if not grid.exact:
            places = _near_least(_refined(kind, loops.quick, places, QUICK_TOLERANCE), group, NEARER_LEAST)
        exact = _refined(kind, loops.exact, places, TOLERANCE)
        _note_least(margins_by_group, kind, exact, group)
    return margins_by_group


def _note_least(margins_by_group: Sequence[dict[str, LeastMargin]], kind: str, places: _Places, group: Indices) -> None:
    """Note the smallest margin of each group with any places."""
    order = np.lexsort((comparable(places.value), group[places.loop]))
    numbers, positions = np.unique(group[places.loop][order], return_index=True)
    for number, index in zip(numbers.tolist(), order[positions].tolist(), strict=True):
        at = int(places.loop[index]), LOCI[int(places.locus[index])], float(places.frequency[index])
        margins_by_group[number][kind] = LeastMargin(float(places.value[index]), *at)


def comparable(values: ArrayLike) -> Floats:
    """Values rounded to eight digits: those that only rounding distinguishes, as by symmetry, are equal.

    The first of the smallest of them is then the same on every processor.
    """
    mantissa, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.round(mantissa, 8), exponent), float)


def _frequencies(loops: ComplementarySensitivity, grid: FrequencyGrid) -> Floats:
    """Angular frequencies (s, k), 0 and up to half the sample rate, dense around lightly damped poles."""
    highest = math.pi / loops.dt
    round_off = np.finfo(float).eps / loops.dt
    poles = loops.poles.copy()
    poles[(np.abs(poles) == 0) | (poles.imag <= 0)] = 1.0
    number = int((poles.imag > 0).sum(axis=1).max(initial=0))
    order = np.argsort(-poles.imag, axis=1)[:, :number]
    rate = np.log(np.take_along_axis(poles, order, axis=1)) / loops.dt
    around = (rate.imag[:, :, None] + np.abs(rate.real)[:, :, None] * grid.around).reshape(len(poles), -1)
    even = np.broadcast_to(np.geomspace(LOWEST, highest, grid.points), (len(poles), grid.points))
    with np.errstate(divide="ignore"):
        speed = np.abs(np.log(loops.poles)) / loops.dt
    slowest = np.where(speed > 1e3 * round_off, speed, np.inf).min(axis=1, initial=np.inf)
    lowest = np.minimum(LOWEST, SLOW * slowest)[:, None]
    if (lowest < LOWEST).any():
        below = np.geomspace(lowest[:, 0], LOWEST, round(BELOW * grid.points), axis=1)
        even = np.hstack([below, even])
    frequencies = np.sort(np.clip(np.hstack([even, around]), lowest, highest), axis=1)
    return np.hstack([np.zeros((len(poles), 1)), frequencies])


def _read_off(kind: str, omega: Floats, response: Complex) -> _Places:
    """All candidate places of a kind of margin on the grid, with approximate margins."""
    if kind == "disk":
        away, last = np.abs(response - 0.5), omega.shape[1] - 1
        rises = np.diff(away, axis=2) > 0
        side = np.ones((*away.shape[:2], 1), bool)
        loop, locus, at = np.nonzero(np.concatenate([side, rises], axis=2) & ~np.concatenate([rises, ~side], axis=2))
        lower, upper = omega[loop, np.maximum(at - 1, 0)], omega[loop, np.minimum(at + 1, last)]
        top = response[loop, locus, at]
        frequency = omega[loop, at]
        return _Places(loop, locus, lower, upper, top, top, frequency, _margin(kind, top, frequency))
    of_gain = kind in {"gain", "fall"}
    values = response.imag if of_gain else response.real - 0.5
    loop, locus, at = np.nonzero(values[:, :, :-1] * values[:, :, 1:] < 0)
    falling = values[loop, locus, at]
    share = falling / (falling - values[loop, locus, at + 1])
    # crossings that coincide with grid points: at 0 and at half the sample rate the response of a single opening is
    # real, and the loci of both torques are real or a complex pair
    on_grid = values == 0
    if of_gain:
        on_grid = np.zeros_like(on_grid)
        on_grid[:, :, [0, -1]] = True
        if response.shape[1] > 1:
            pair = response[:, -2:, [0, -1]]
            on_grid[:, -2:, [0, -1]] = np.abs(pair.imag) <= ALL_BUT_REAL * np.abs(pair)
    points = np.nonzero(on_grid)
    loop, locus, share = (
        np.append(loop, points[0]),
        np.append(locus, points[1]),
        np.append(share, np.zeros(len(points[0]))),
    )
    lower, upper = np.append(at, points[2]), np.append(at + 1, points[2])
    before, after = response[loop, locus, lower], response[loop, locus, upper]
    lower, upper = omega[loop, lower], omega[loop, upper]
    frequency = lower + (upper - lower) * share
    value = _margin(kind, before * (1 - share) + after * share, frequency)
    is_margin = np.isfinite(value) & ((frequency > 0) | (value < ROUND_OFF_MARGIN))
    return _Places(loop, locus, lower, upper, before, after, frequency, value)[is_margin]


def _margin(kind: str, response: Complex, omega: Floats) -> Floats:
    """The margin for a value of T at its frequency; infinite where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        match kind:
            case "disk":
                return 1 / np.abs(response - 0.5)
            case "gain":
                return np.where(response.real < 0, 1 - 1 / response.real, np.inf)
            case "fall":
                return np.where(response.real > 1, response.real / (response.real - 1), np.inf)
        lag = (math.pi + 2 * np.arctan2(response.imag, 0.5)) % (2 * math.pi)
        return np.degrees(lag) if kind == "phase" else lag / omega


def _near_least(places: _Places, group: Indices, factor: float) -> _Places:
    """The places whose margin is at most `factor` times the smallest of their group."""
    smallest = np.full(int(group.max(initial=-1)) + 1, np.inf)
    np.minimum.at(smallest, group[places.loop], places.value)
    return places[places.value <= factor * smallest[group[places.loop]]]


Evaluate = Callable[[Floats, Indices, Indices, Complex], tuple[Complex, Complex]]


def _refined(kind: str, evaluate: Evaluate, places: _Places, tolerance: float) -> _Places:
    """The places with refined frequencies and margins."""

    def condition(omega: Floats, indices: Indices) -> Floats:
        near = places.near(omega, indices)
        value, slope = evaluate(omega, places.loop[indices], places.locus[indices], near)
        if kind == "disk":
            return ((value - 0.5).conj() * slope).real
        return value.imag if kind in {"gain", "fall"} else value.real - 0.5

    omega = _root(condition, places, tolerance)
    near = places.near(omega, np.arange(len(omega)))
    value = _margin(kind, evaluate(omega, places.loop, places.locus, near)[0], omega)
    return replace(places, frequency=omega, value=value)


def _root(function: Callable[[Floats, Indices], Floats], places: _Places, tolerance: float) -> Floats:
    """Zeros of a function of frequency near given places, by Chandrupatla's method (Adv. Eng. Software 28, 1997).

    Inverse quadratic interpolation where that is safe, else bisection. If the function does not change sign, its
    integral is largest at an end of the bracket, and that end is returned.
    """
    every = np.arange(len(places.frequency))
    low, high = (np.clip(places.frequency * side, places.lower, places.upper) for side in (1 - CLOSE, 1 + CLOSE))
    at_low, at_high = function(low, every), function(high, every)
    wide = np.flatnonzero(at_low * at_high > 0)
    low[wide], high[wide] = places.lower[wide], places.upper[wide]
    at_low[wide], at_high[wide] = function(low[wide], wide), function(high[wide], wide)
    root = np.where(at_low > 0, high, low)
    active = np.flatnonzero(at_low * at_high < 0)
    a, b, at_a, at_b = _taken(active, high, low, at_high, at_low)  # b is the newest, a the opposite end
    share = at_b / (at_b - at_a)
    for _ in range(ITERATIONS):
        if not len(active):
            break
        now = b + share * (a - b)
        at_now = function(now, active)
        same = at_now * at_b > 0
        c, at_c = np.where(same, b, a), np.where(same, at_b, at_a)
        a, at_a, b, at_b = np.where(same, a, b), np.where(same, at_a, at_b), now, at_now
        nearest = np.where(np.abs(at_a) < np.abs(at_b), a, b)
        root[active] = nearest
        step_tolerance = tolerance * nearest / np.maximum(np.abs(a - b), np.finfo(float).tiny)
        going = (step_tolerance < 0.5) & (at_now != 0)
        active = active[going]
        a, b, c, at_a, at_b, at_c, step_tolerance = _taken(going, a, b, c, at_a, at_b, at_c, step_tolerance)
        share = np.clip(_interpolated(a, b, c, at_a, at_b, at_c), step_tolerance, 1 - step_tolerance)
    return root


def _interpolated(a: Floats, b: Floats, c: Floats, at_a: Floats, at_b: Floats, at_c: Floats) -> Floats:
    """Share of the way from b to a at which the zero is: by inverse quadratic interpolation where safe, else 1/2."""
    with np.errstate(divide="ignore", invalid="ignore"):
        where, height = (b - a) / (c - a), (at_b - at_a) / (at_c - at_a)
        quadratic = (height**2 < where) & ((1 - height) ** 2 < 1 - where)
        inverse = at_b / (at_a - at_b) * at_c / (at_a - at_c)
        inverse += (c - b) / (a - b) * at_b / (at_c - at_b) * at_a / (at_c - at_a)
    return np.where(quadratic, inverse, 0.5)


def _taken(rows: Flags | Indices, *columns: Floats) -> tuple[Floats, ...]:
    """Some rows of each of several columns."""
    return tuple(column[rows] for column in columns)
