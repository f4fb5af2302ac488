"""The paper's stability theorem as it is printed: Lyapunov function and conditions on the gains (Section 3.1.5).

The theorem regards the vehicle as driven by the force command itself, ``dv/dt = (u - F_f - F_w)/M + d``, with
``|d| <= D/M`` and ``|dd/dt| <= Delta``. Its terms have different units and are added as numbers in SI units.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.nominal import nominal_plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import inertia
from dualwinch.simulation.analysis.sliding_mode import sliding_mode
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

IDEAL, REAL = "ideal ropes", "real ropes"
"""What counts as disturbance: what the sea and a wrong model do; or also the force the ropes do not deliver."""

GAPS = (
    "The derivative of V has p/(q beta) |e2 + gamma Z_a|^(p/q-1) before the reaching law too; the paper drops it (E7).",
    "Inside the boundary layer, |s| < phi, the switching term shrinks with s and dominates no disturbance.",
    "Delta L = K_f FLS >= 0, so its term Delta L FLS in dV/dt is never negative: it cannot be <= -mu Delta L^2.",
    "While the force is cut off, dZ_a/dt holds Z_a (u - u_sat), which no condition bounds by k_a Z_a^2.",
    "Ropes, winches and sampling are left out: the force on the vehicle is taken to be the command.",
)
"""What the proof takes for granted whatever the gains: conditions that hold do not make V decrease."""


@dataclass(frozen=True)
class Bounds:
    """What the conditions need to know of a run.

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
        name: what it is about.
        statement: as the paper prints it.
        left, right: both sides, in SI units.
        unit: of the left side.
        basis: `IDEAL` or `REAL` where a bound on the disturbance enters, else empty.
        holds: the verdict.
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

    Args:
        s: sliding variable in m.
        Z_a: anti-saturation state in N s.
        d_tilde: estimation error of the disturbance acceleration in m/s².
        L1: observer gain in 1/s, > 0.
        l0: its constant part in 1/s.
        kf: gain of its fuzzy part in 1/s; 0 switches that term off.
        mass: in kg.
    """
    adaptation = (L1 - l0) ** 2 / (2 * kf) if kf > 0 else 0.0 * L1
    return LyapunovTerms(s**2 / 2, Z_a**2 / 2, mass * d_tilde**2 / (2 * L1), adaptation)


def claimed_decay(s: Scalar, Z_a: Scalar, d_tilde: Scalar, eta: Scalar, k_a: Scalar, mass: Scalar) -> Scalar:
    """The bound −η s² − k_a Z_a² − M d̃²/2 that the paper derives for dV/dt, its term μ ΔL² left out (Section 3.1.5).

    Arguments as in `lyapunov_terms`; `eta` and `k_a` are gains.
    """
    return -eta * s**2 - k_a * Z_a**2 - mass / 2 * d_tilde**2


def switching_gain_needed(disturbance: Scalar, speed_error: Scalar, ratio: Scalar, beta: Scalar, eta: Scalar) -> Scalar:
    """Right side of the switching condition: 2 p D/(q β M) max|e2 + γ Z_a|^(p/q−1) + η (paper Section 3.1.5).

    Args:
        disturbance: D/M in m/s².
        speed_error: max|e2 + γ Z_a| in m/s.
        ratio: p/q.
        beta: weight of the position error.
        eta: rate of the exponential reaching law.
    """
    return 2 * ratio / beta * disturbance * speed_error ** (ratio - 1) + eta


def auxiliary_weight_needed(tension_max: Scalar, k_a: Scalar) -> Scalar:
    """Right side of the condition on γ: 2 F_max/k_a (paper Section 3.1.5), tension in N and decay rate in 1/s."""
    return 2 * tension_max / k_a if k_a > 0 else np.inf


def nominal_mass(experiment: Experiment) -> float:
    """M in kg: what the controller believes the ropes accelerate."""
    return inertia(nominal_plant(experiment.controller.nominal, experiment.plant).vehicle)


def disturbance(columns: Mapping[str, Floats], mass: float, basis: str) -> Floats:
    """The theorem's d in m/s² along a run (samples,).

    Args:
        columns: of a result.
        mass: M in kg.
        basis: `IDEAL`: what the nominal model does not explain, given the true tensions. `REAL`: also the force that
            the ropes give beyond the command, (F_1 − F_2 − u_sat)/M, which the theorem does not know of.
    """
    missing = (columns["F1"] - columns["F2"] - columns["u_sat"]) / mass if basis == REAL else 0.0
    return columns["d_true"] + missing


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
    """Every condition of the theorem with both its sides.

    Args:
        experiment: gives the gains.
        known: basis → bounds of a run.
    """
    law = sliding_mode(experiment)
    gains, auxiliary = law.nftsm, law.auxiliary
    units = {key: leaf.quantity.unit for key, leaf in describe_parts(law).items()}
    found: list[Condition] = []

    def at_least(name: str, statement: str, left: float, right: float, unit: str, basis: str = "") -> None:
        found.append(Condition(name, statement, left, right, unit, basis, left >= right))

    for basis, bounds in known.items():
        needed = switching_gain_needed(bounds.disturbance, bounds.speed_error, gains.p / gains.q, gains.beta, gains.eta)
        statement = "k >= 2 p D/(q beta M) max|e2 + gamma Z_a|^(p/q-1) + eta"
        at_least("switching gain", statement, gains.k, needed, units["nftsm.k"], basis)
    for basis, bounds in known.items():
        if isinstance(law, FandoNftsm):
            statement = "L(t) >= Delta, bound of |dd/dt|"
            at_least("observer gain", statement, bounds.observer_gain, bounds.disturbance_rate, "1/s", basis)
    decays = auxiliary.k_a > 0
    found.append(Condition("decay of Z_a", "k_a > 0", auxiliary.k_a, 0.0, units["auxiliary.k_a"], "", decays))
    needed = auxiliary_weight_needed(experiment.controller.limits.tension_max, auxiliary.k_a)
    weights = leaves(auxiliary)
    for name, where in (("gamma", "in the surface"), ("gamma_force", "in the force")):
        at_least(f"weight of Z_a {where}", f"{name} >= 2 F_max/k_a", weights[name], needed, units[f"auxiliary.{name}"])
    return found
