"""The paper's stability theorem (Section 3.1.5): conditions on the gains, and the Lyapunov function along a run.

The theorem assumes that the force command acts on the vehicle directly, ``dv/dt = (u - F_f - F_w)/M + d``, with
``|d| <= D/M`` and ``|dd/dt| <= Delta``. Its terms have different units and are added as numbers in SI units.

`certify` evaluates every condition with bounds from a run, and `nearby_gains` raises the gains that violate one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.nominal import nominal_plant
from dualwinch.model.arguments import instance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import inertia
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.page import GivenAxes, new_page, scenario
from dualwinch.simulation.plots.style import BLUE, GOLD, GREEN, GREY, INK, PURPLE, VERMILION, WINE, law_label, plain
from dualwinch.simulation.plots.traces import peaks
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SLIDING_MODE = FandoNftsm, Nftsm
"""Laws with odd powers of the speed error."""


def sliding_mode(experiment: Experiment, reason: str = "must be") -> FandoNftsm | Nftsm:
    """The sliding-mode law of an experiment.

    Raises:
        ConfigurationError: it has another law; `reason` are the words before the allowed kinds.
    """
    instance("experiment", experiment, Experiment)
    law = experiment.controller.law
    if not isinstance(law, SLIDING_MODE):
        raise ConfigurationError(f'controller.kind = "{law.kind}": {reason} "{FandoNftsm.kind}" or "{Nftsm.kind}"')
    return law


Floats = NDArray[np.float64]

IDEAL, REAL = "ideal ropes", "real ropes"
"""Definition of the disturbance: sea and model error only, or also the force that the ropes do not deliver."""

GAPS = (
    "The derivative of V has p/(q beta) |e2 + gamma Z_a|^(p/q-1) before the reaching law too; the paper drops it (E7).",
    "Inside the boundary layer, |s| < phi, the switching term shrinks with s and dominates no disturbance.",
    "Delta L = K_f FLS >= 0, so its term Delta L FLS in dV/dt is never negative: it cannot be <= -mu Delta L^2.",
    "While the force saturates, dZ_a/dt holds Z_a (u - u_sat), which no condition bounds by k_a Z_a^2.",
    "Ropes, winches and sampling are left out: the force on the vehicle is taken to be the command.",
)
"""Gaps of the proof for any gains: satisfied conditions do not imply that V decreases."""


@dataclass(frozen=True)
class Bounds:
    """Bounds from a run that the conditions need.

    Attributes:
        disturbance: largest |d| = D/M in m/s².
        disturbance_rate: largest change of d from sample to sample over the sample time, Delta in m/s³.
        speed_error: largest |e2 + gamma Z_a| in m/s.
        observer_gain: smallest L(t) in 1/s; NaN without an observer.
    """

    disturbance: float
    disturbance_rate: float
    speed_error: float
    observer_gain: float


@dataclass(frozen=True)
class Condition:
    """One condition of the theorem, ``left >= right`` (for the decay rate ``left > right``).

    Attributes:
        name: name of the condition.
        statement: as the paper prints it.
        left, right: both sides, in SI units.
        unit: of the left side.
        basis: `IDEAL` or `REAL` if a bound on the disturbance enters, else empty.
        holds: whether it is satisfied.
    """

    name: str
    statement: str
    left: float
    right: float
    unit: str
    basis: str
    holds: bool


@dataclass(frozen=True)
class LyapunovTerms:
    """The four terms of V: (samples,) arrays or scalars."""

    surface: Scalar
    auxiliary: Scalar
    estimate: Scalar
    adaptation: Scalar

    @property
    def total(self) -> Scalar:
        """V."""
        return self.surface + self.auxiliary + self.estimate + self.adaptation


def lyapunov_terms(s: Scalar, Z_a: Scalar, d_tilde: Scalar, L1: Scalar, l0: Scalar, kf: Scalar, mass: Scalar) -> Scalar:
    """The terms of V = s²/2 + Z_a²/2 + M d̃²/(2 L) + ΔL²/(2 K_f) (paper Section 3.1.5, step 1).

    s in m, Z_a in N s, the disturbance observer's error d̃ in m/s², its gain L > 0 with its constant part and the gain
    of its fuzzy part in 1/s, mass in kg; `kf` = 0 switches the last term off.
    """
    adaptation = (L1 - l0) ** 2 / (2 * kf) if kf > 0 else 0.0 * L1
    return LyapunovTerms(s**2 / 2, Z_a**2 / 2, mass * d_tilde**2 / (2 * L1), adaptation)


def claimed_decay(s: Scalar, Z_a: Scalar, d_tilde: Scalar, eta: Scalar, k_a: Scalar, mass: Scalar) -> Scalar:
    """The paper's bound −η s² − k_a Z_a² − M d̃²/2 of dV/dt, without its term μ ΔL² (Section 3.1.5).

    Arguments as in `lyapunov_terms`; `eta` and `k_a` are gains.
    """
    return -eta * s**2 - k_a * Z_a**2 - mass / 2 * d_tilde**2


def switching_gain_needed(disturbance: Scalar, speed_error: Scalar, ratio: Scalar, beta: Scalar, eta: Scalar) -> Scalar:
    """Right side of the switching condition: 2 p D/(q β M) max|e2 + γ Z_a|^(p/q−1) + η (paper Section 3.1.5).

    `disturbance` is D/M in m/s², `speed_error` max|e2 + γ Z_a| in m/s, `ratio` p/q.
    """
    return 2 * ratio / beta * disturbance * speed_error ** (ratio - 1) + eta


def auxiliary_weight_needed(tension_max: Scalar, k_a: Scalar) -> Scalar:
    """Right side of the condition on γ: 2 F_max/k_a (paper Section 3.1.5), tension in N and decay rate in 1/s."""
    return 2 * tension_max / k_a if k_a > 0 else np.inf


def nominal_mass(experiment: Experiment) -> float:
    """M in kg: the controller's nominal mass moved by the ropes."""
    return inertia(nominal_plant(experiment.controller.nominal, experiment.plant).vehicle)


def disturbance(columns: Mapping[str, Floats], mass: float, basis: str) -> Floats:
    """The theorem's d in m/s² along a run (samples,).

    Args:
        columns: of a result.
        mass: M in kg.
        basis: `IDEAL`: acceleration that the nominal model does not explain, given the true tensions. `REAL`: plus
            the rope force beyond the command, (F_1 − F_2 − u_sat)/M, which the theorem neglects.
    """
    undelivered = (columns["F1"] - columns["F2"] - columns["u_sat"]) / mass if basis == REAL else 0.0
    return columns["d_true"] + undelivered


def bounds(columns: Mapping[str, Floats], experiment: Experiment, basis: str = IDEAL) -> Bounds:
    """The bounds of a run, from the columns of a result that keeps every sample."""
    d = disturbance(columns, nominal_mass(experiment), basis)
    speed_error = columns["v"] - columns["v_ref"] + sliding_mode(experiment).auxiliary.gamma * columns["Z_a"]
    changes = np.abs(np.diff(d)) / experiment.simulation.sample_time
    return Bounds(
        disturbance=float(np.max(np.abs(d))),
        disturbance_rate=float(np.max(changes, initial=0.0)),
        speed_error=float(np.max(np.abs(speed_error))),
        observer_gain=float(np.min(columns["L1"])) if "L1" in columns else np.nan,
    )


def conditions(experiment: Experiment, known: Mapping[str, Bounds]) -> list[Condition]:
    """Every condition of the theorem with both its sides, for the bounds of a run by basis."""
    law = sliding_mode(experiment)
    gains, auxiliary = law.nftsm, law.auxiliary
    units = {key: leaf.quantity.unit for key, leaf in describe_parts(law).items()}
    entries: list[Condition] = []

    def at_least(name: str, statement: str, left: float, right: float, unit: str, basis: str = "") -> None:
        entries.append(Condition(name, statement, left, right, unit, basis, left >= right))

    for basis, bounds in known.items():
        needed = switching_gain_needed(bounds.disturbance, bounds.speed_error, gains.p / gains.q, gains.beta, gains.eta)
        statement = "k >= 2 p D/(q beta M) max|e2 + gamma Z_a|^(p/q-1) + eta"
        at_least("switching gain", statement, gains.k, needed, units["nftsm.k"], basis)
    for basis, bounds in known.items():
        if isinstance(law, FandoNftsm):
            statement = "L(t) >= Delta, bound of |dd/dt|"
            at_least("observer gain", statement, bounds.observer_gain, bounds.disturbance_rate, "1/s", basis)
    decays = auxiliary.k_a > 0
    entries.append(Condition("decay of Z_a", "k_a > 0", auxiliary.k_a, 0.0, units["auxiliary.k_a"], "", decays))
    needed = auxiliary_weight_needed(experiment.controller.limits.tension_max, auxiliary.k_a)
    weights = leaves(auxiliary)
    for name, where in (("gamma", "in the surface"), ("gamma_force", "in the force")):
        at_least(f"weight of Z_a {where}", f"{name} >= 2 F_max/k_a", weights[name], needed, units[f"auxiliary.{name}"])
    return entries


@dataclass(frozen=True)
class Certificate:
    """The theorem applied to one experiment, with the Lyapunov function along its run.

    Attributes:
        result: the run, every sample kept.
        bounds: basis → bounds found in the run.
        conditions: every condition with both sides.
        terms: the terms of V at every sample (samples,).
        rate: mean dV/dt within every sample, (V at its end − V at its beginning)/Ts (samples − 1,).
        decreasing: share of the samples over which V decreases.
        within_claim: share of the samples over which dV/dt is within the paper's final bound (`claimed_decay`).
    """

    result: Result
    bounds: dict[str, Bounds]
    conditions: list[Condition]
    terms: LyapunovTerms
    rate: Floats
    decreasing: float
    within_claim: float

    @property
    def certified(self) -> bool:
        """Whether the run is complete and all conditions hold as in the paper: with ideal ropes."""
        return self.result.outcome == "completed" and all(c.holds for c in self.conditions if c.basis != REAL)

    @property
    def certified_with_ropes(self) -> bool:
        """Whether they also hold with the force that the ropes do not deliver as part of the disturbance."""
        return self.certified and all(c.holds for c in self.conditions)

    def plot(self, *, ax: "Axes | Sequence[Axes] | None" = None) -> "Figure":
        """Plot the Lyapunov function and its rate over the run.

        Args:
            ax: axes for these; default: a figure of its own.
        """
        return lyapunov(self, ax=ax)


INTERVALS = 250
"""Intervals of a run; each shows its largest value."""

DECADES = 12.0
"""Decades shown below the largest value."""

TERMS = {
    "surface": ("$s^2/2$", BLUE),
    "auxiliary": ("$Z_a^2/2$", GOLD),
    "estimate": (r"$M \tilde{d}^2/(2L)$", PURPLE),
    "adaptation": (r"$\Delta L^2/(2K_f)$", WINE),
}
"""Term of V → its formula and colour."""


def lyapunov(certificate: Certificate, *, ax: GivenAxes = None) -> "Figure":
    """V with its terms, and positive and negative parts of dV/dt, on logarithmic axes.

    Panels: V, and its rate.

    Raises:
        ConfigurationError: the run ended with its first sample.
    """
    if not certificate.rate.size:
        raise ConfigurationError("V along a run needs at least two samples")
    experiment, t = certificate.result.experiment, certificate.result["t"]
    width, total = experiment.duration / INTERVALS, certificate.terms.total
    holding = [condition.holds for condition in certificate.conditions]
    words = f"{scenario(experiment).capitalize()}. V decreases over {100 * certificate.decreasing:.3g} % of the samples"
    words += f"; {sum(holding)} of {len(holding)} conditions hold"
    with new_page(ax, 5.4, f"{plain(law_label(experiment))}: the theorem's Lyapunov function", words) as page:
        value, rate = panels = page.panels(2, sharex=True, height_ratios=(1.15, 1))
        value.plot(*peaks(t, total, width), color=INK, linewidth=1.5, label="$V$", zorder=3)
        for name, (formula, colour) in TERMS.items():
            if np.any(values := getattr(certificate.terms, name)):
                value.plot(*peaks(t, values, width), color=colour, linewidth=0.9, label=formula)
        for sign, colour, label in ((1.0, VERMILION, "dV/dt > 0"), (-1.0, GREEN, "dV/dt < 0")):
            part = np.where(sign * certificate.rate > 0, certificate.rate, 0.0)
            rate.plot(*peaks(t[:-1], part, width), color=colour, linewidth=1.0, label=label)
        _decades(value, total)
        _decades(rate, certificate.rate)
        value.set_ylabel("V and its terms")
        value.set_title("V, largest value of every interval", color=GREY)
        rate.set_ylabel("|dV/dt| (1/s)")
        rate.set_title("rate of V, largest of every interval, by its sign", color=GREY)
        page.time_axes(panels, experiment, shaded=False)
        page.legend()
    return page.figure


def _decades(axes: "Axes", values: np.ndarray) -> None:
    """A logarithmic axis down to `DECADES` below the largest value."""
    highest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    axes.set_yscale("log")
    if highest > 0:
        axes.set_ylim(max(highest * 10**-DECADES, 1e-300), 3 * highest)


def certify(experiment: Experiment, *, progress: Progress = no_progress) -> Certificate:
    """Run an experiment and check it against the paper's stability theorem (Section 3.1.5).

    Args:
        experiment: gains and scenario; the position law must be ``fando-nftsm`` or ``nftsm``.
        progress: called from time to time with the completed fraction of the run.

    Raises:
        ConfigurationError: another position law, or an observer without a constant gain (V divides by it).

    Example:
        >>> import dualwinch as dw
        >>> certificate = dw.certify(dw.override(dw.case(4), {"simulation.duration": 1.0}))
        >>> [condition.name for condition in certificate.conditions if not condition.holds and not condition.basis]
        ['weight of Z_a in the surface', 'weight of Z_a in the force']
    """
    law = sliding_mode(experiment, "the theorem applies to")
    if isinstance(law, FandoNftsm) and law.observer.l0 <= 0:
        raise ConfigurationError("controller.observer.l0 = 0: must be > 0, V divides by the observer's gain")
    result = simulate(experiment, progress=progress)
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging run is a result too
        return _evaluated(result)


def _evaluated(result: Result) -> Certificate:
    experiment, law = result.experiment, sliding_mode(result.experiment)
    columns, mass = result.columns, nominal_mass(experiment)
    s, Z_a = columns["s"], columns["Z_a"]
    if isinstance(law, FandoNftsm):
        d_tilde = disturbance(columns, mass, IDEAL) - columns["d_hat"]
        terms = lyapunov_terms(s, Z_a, d_tilde, columns["L1"], law.observer.l0, law.observer.kf, mass)
    else:
        d_tilde = np.zeros_like(s)
        terms = LyapunovTerms(s**2 / 2, Z_a**2 / 2, d_tilde, d_tilde)
    rate = np.diff(terms.total) / experiment.simulation.sample_time
    claim = claimed_decay(s, Z_a, d_tilde, law.nftsm.eta, law.auxiliary.k_a, mass)[:-1]
    bounds_by_basis = {basis: bounds(columns, experiment, basis) for basis in (IDEAL, REAL)}
    return Certificate(
        result=result,
        bounds=bounds_by_basis,
        conditions=conditions(experiment, bounds_by_basis),
        terms=terms,
        rate=rate,
        decreasing=float(np.mean(rate < 0)) if rate.size else np.nan,
        within_claim=float(np.mean(rate <= claim)) if rate.size else np.nan,
    )


GAIN_ROUNDS = 6
"""Maximum number of times the gains are raised from one start."""

HEADROOM = 1.02
"""Factor by which a raised gain exceeds its bound, since the bound of the next run differs slightly."""


@dataclass(frozen=True)
class NearbyGains:
    """Result of the search.

    Attributes:
        certificate: of the last gain set tried.
        changes: key → (given, tried), for every gain that differs.
        found: whether the last gain set satisfies every condition in its own run.
        history: violated conditions of every gain set tried, in words.
        reason: why the gains satisfy the conditions, or why none do, in words.
    """

    certificate: Certificate
    changes: dict[str, tuple[float, float]]
    found: bool
    history: list[str]
    reason: str


def nearby_gains(certificate: Certificate, *, progress: Progress = no_progress) -> NearbyGains:
    """Raise gains that violate a condition, run again, and repeat, as a change of gains also changes the bounds.

    ``k``, ``l0``, ``gamma`` and ``gamma_force`` are raised, each as the bounds of the last run require. If that fails
    with the given ``k_a``, it is repeated once with the largest ``k_a`` with which Z_a decays without overshoot from
    one sample to the next, 1/Ts, which allows the smallest gamma. Nothing else is changed.

    Args:
        certificate: from which to start.
        progress: called after every run with the completed fraction of the longest possible search.

    Example:
        >>> import dualwinch as dw
        >>> certificate = dw.certify(dw.override(dw.case(4), {"simulation.duration": 1.0}))
        >>> sorted(dw.nearby_gains(certificate).changes)
        ['controller.auxiliary.gamma', 'controller.auxiliary.gamma_force']
    """
    instance("certificate", certificate, Certificate, hint=" (certify makes one)")
    experiment = certificate.result.experiment
    k_a, fastest = sliding_mode(experiment).auxiliary.k_a, 1 / experiment.simulation.sample_time
    candidate, history, runs = certificate, [_shortfall(certificate)], 0
    for decay in (k_a or AuxiliaryGains().k_a, fastest):
        if candidate.certified:
            break
        candidate = certificate
        for _ in range(GAIN_ROUNDS):
            candidate = certify(_raised(candidate, decay))
            runs += 1
            history.append(f"k_a = {decay:g}: {_shortfall(candidate)}")
            progress(runs / (2 * GAIN_ROUNDS))
            if candidate.certified or candidate.result.outcome != "completed":
                break
    before, after = leaves(experiment.controller), leaves(candidate.result.experiment.controller)
    return NearbyGains(
        certificate=candidate,
        changes={f"controller.{key}": (before[key], value) for key, value in after.items() if value != before[key]},
        found=candidate.certified,
        history=history,
        reason=_reason(certificate, candidate),
    )


def _raised(certificate: Certificate, k_a: float) -> Experiment:
    """The experiment with this k_a, and gains that violate a condition raised as the certificate's run requires."""
    experiment, bounds = certificate.result.experiment, certificate.bounds[IDEAL]
    weight = auxiliary_weight_needed(experiment.controller.limits.tension_max, k_a)
    gains = {"auxiliary.k_a": k_a, "auxiliary.gamma": weight, "auxiliary.gamma_force": weight}
    for condition in certificate.conditions:
        if condition.name == "switching gain" and condition.basis == IDEAL and not condition.holds:
            gains["nftsm.k"] = HEADROOM * condition.right
    if bounds.observer_gain < bounds.disturbance_rate:
        gains["observer.l0"] = HEADROOM * bounds.disturbance_rate
    before = leaves(experiment.controller)
    rising = {key: max(before[key], value) for key, value in gains.items()}
    return replace(experiment, controller=with_leaves(experiment.controller, rising))


def _shortfall(certificate: Certificate) -> str:
    """The violated conditions of a gain set, in one line."""
    result = certificate.result
    if result.outcome != "completed":
        return f"the run {result.outcome.replace('_', ' ')} at {result.end_time:.4g} s"
    lacking = [
        f"{condition.name} {condition.left:.4g} < {condition.right:.4g} {condition.unit}"
        for condition in certificate.conditions
        if condition.basis != REAL and not condition.holds
    ]
    return "; ".join(lacking) or "every condition holds"


def _reason(start: Certificate, raised: Certificate) -> str:
    experiment, columns = start.result.experiment, start.result.columns
    if start.certified:
        return "the given gains satisfy every condition in this run"
    if raised.certified and not np.any(raised.result["Z_a"]):
        return "the force never saturates in this run, so Z_a stays 0 and the weights of Z_a may be anything"
    if raised.certified:
        return "the raised gains satisfy every condition in their own run"
    clipped = np.abs(columns["u"] - columns["u_sat"])
    excess = float(clipped[np.argmax(clipped > 0)])
    if not excess > 0:
        return f"after {GAIN_ROUNDS} rounds the bounds still grow as fast as the gains"
    sample_time = experiment.simulation.sample_time
    weight_needed = auxiliary_weight_needed(experiment.controller.limits.tension_max, 1 / sample_time)
    return (
        f"the force saturates, at first by {excess:.4g} N. Z_a decays within one sample at best (k_a <= 1/Ts), so "
        f"gamma must be >= 2 F_max Ts = {weight_needed:.4g}, and that one sample puts gamma Ts {excess:.4g} N = "
        f"{weight_needed * sample_time * excess:.4g} m/s into "
        "e2 + gamma Z_a: the force then saturates even more, and the loop runs away"
    )
