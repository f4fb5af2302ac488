"""A gain set's certificate: the theorem's conditions, its Lyapunov function along a run, and gains that would do."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from controllers.auxiliary import AuxiliaryGains
from model.quantity import leaves, with_leaves
from simulation.errors import ConfigurationError
from simulation.experiment import Experiment
from simulation.result import Result
from simulation.simulate import simulate
from simulation.stability import (
    IDEAL,
    REAL,
    Bounds,
    Condition,
    LyapunovTerms,
    auxiliary_weight_needed,
    bounds,
    claimed_decay,
    conditions,
    disturbance,
    lyapunov_terms,
    nominal_mass,
)

Floats = NDArray[np.float64]

KINDS = ("fando-nftsm", "nftsm")
"""Position laws the theorem is about; the second has no observer, and V then no terms for one."""

ROUNDS = 8
"""Gain sets the search for satisfying gains tries."""

HEADROOM = 1.02
"""How far beyond its bound the search sets a gain that has to rise: the next run's bound will not be quite the same."""


@dataclass(frozen=True)
class Certificate:
    """What the theorem says of one experiment, and what its Lyapunov function does.

    Attributes:
        result: the run, every sample kept.
        bounds: basis → bounds seen in the run.
        conditions: every condition with both sides.
        terms: the terms of V at every sample (samples,).
        rate: mean dV/dt within every sample, (V at its end − V at its beginning)/Ts (samples − 1,).
        decreasing: share of the samples over which V decreases.
        within_claim: share of the samples over which dV/dt is as negative as the paper's last line says.
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
        """Whether the run is complete and all conditions hold as the paper has them: with ideal ropes."""
        return self.result.outcome == "completed" and all(c.holds for c in self.conditions if c.basis != REAL)

    @property
    def certified_with_ropes(self) -> bool:
        """Whether they also hold with what the ropes do not deliver counted as disturbance."""
        return self.certified and all(c.holds for c in self.conditions)


@dataclass(frozen=True)
class NearbyGains:
    """The search for gains that satisfy every condition, from the given ones upwards.

    Attributes:
        certificate: of the last gain set tried.
        changes: key → (given, tried), of every gain that differs.
        found: whether that gain set satisfies every condition in its own run.
        history: for every gain set tried, in words, what it lacked.
    """

    certificate: Certificate
    changes: dict[str, tuple[float, float]]
    found: bool
    history: list[str]


def certify(experiment: Experiment, *, progress: Callable[[float], None] | None = None) -> Certificate:
    """Run an experiment and hold the paper's stability theorem against it (Section 3.1.5).

    Args:
        experiment: gains and scenario; the position law must be ``fando-nftsm`` or ``nftsm``.
        progress: called now and then with the share of the run that is done.

    Raises:
        ConfigurationError: another position law, or an observer without a constant gain (V divides by it).
    """
    controller = experiment.controller
    if controller.kind not in KINDS:
        raise ConfigurationError(
            f'controller.kind = "{controller.kind}": the theorem is about {" or ".join(f"{kind!r}" for kind in KINDS)}'
        )
    if controller.kind == "fando-nftsm" and controller.observer.l0 <= 0:
        raise ConfigurationError("controller.observer.l0 = 0: must be > 0, V divides by the observer's gain")
    result = simulate(experiment, progress=progress)
    columns, mass = result.columns, nominal_mass(experiment)
    s, Z_a = columns["s"], columns["Z_a"]
    gains, observer = controller.nftsm, controller.observer
    if controller.kind == "fando-nftsm":
        d_tilde = disturbance(columns, mass, IDEAL) - columns["d_hat"]
        terms = lyapunov_terms(s, Z_a, d_tilde, columns["L1"], observer.l0, observer.kf, mass)
    else:
        d_tilde = np.zeros_like(s)
        terms = LyapunovTerms(s**2 / 2, Z_a**2 / 2, d_tilde, d_tilde)
    rate = np.diff(terms.total) / experiment.simulation.sample_time
    claim = claimed_decay(s, Z_a, d_tilde, gains.eta, controller.auxiliary.k_a, mass)[:-1]
    known = {basis: bounds(columns, experiment, basis) for basis in (IDEAL, REAL)}
    return Certificate(
        result=result,
        bounds=known,
        conditions=conditions(experiment, known),
        terms=terms,
        rate=rate,
        decreasing=float(np.mean(rate < 0)) if rate.size else np.nan,
        within_claim=float(np.mean(rate <= claim)) if rate.size else np.nan,
    )


def nearby_gains(given: Certificate, *, progress: Callable[[float], None] | None = None) -> NearbyGains:
    """Raise the gains that fall short, run again, and repeat: a change of gains also changes the bounds.

    Raised are ``k``, ``l0``, ``k_a`` (where it is 0), ``gamma`` and ``gamma_force``, each to where the last run's
    bounds put it; nothing is lowered.

    Args:
        given: the certificate to start from.
        progress: called after every run with the share of `ROUNDS` that is done.
    """
    start = given.result.experiment
    tried, history = given, [_shortfall(given)]
    for number in range(ROUNDS):
        if tried.certified or tried.result.outcome != "completed":
            break
        tried = certify(_raised(tried))
        history.append(_shortfall(tried))
        if progress:
            progress((number + 1) / ROUNDS)
    before, after = leaves(start.controller), leaves(tried.result.experiment.controller)
    return NearbyGains(
        certificate=tried,
        changes={f"controller.{key}": (before[key], value) for key, value in after.items() if value != before[key]},
        found=tried.certified,
        history=history,
    )


def _raised(certificate: Certificate) -> Experiment:
    """The experiment with every gain that falls short set to what the certificate's run asks for."""
    experiment, seen = certificate.result.experiment, certificate.bounds[IDEAL]
    controller = experiment.controller
    k_a = controller.auxiliary.k_a or AuxiliaryGains().k_a
    weight = auxiliary_weight_needed(controller.coordination.tension_max, k_a)
    wanted = {"auxiliary.k_a": k_a, "auxiliary.gamma": weight, "auxiliary.gamma_force": weight}
    for condition in certificate.conditions:
        if condition.name == "switching gain" and condition.basis == IDEAL and not condition.holds:
            wanted["nftsm.k"] = HEADROOM * condition.right
    if seen.observer_gain < seen.disturbance_rate:
        wanted["observer.l0"] = HEADROOM * seen.disturbance_rate
    before = leaves(controller)
    rising = {key: max(before[key], value) for key, value in wanted.items()}
    return replace(experiment, controller=with_leaves(controller, rising))


def _shortfall(certificate: Certificate) -> str:
    """What a gain set lacks, in one line."""
    result = certificate.result
    if result.outcome != "completed":
        return f"the run {result.outcome.replace('_', ' ')} at {result.end_time:.4g} s"
    lacking = [
        f"{condition.name} {condition.left:.4g} < {condition.right:.4g} {condition.unit}".rstrip()
        for condition in certificate.conditions
        if condition.basis != REAL and not condition.holds
    ]
    return "; ".join(lacking) or "every condition holds"
