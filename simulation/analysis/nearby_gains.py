"""Search for gains near the given ones that satisfy every condition of the stability theorem."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.analysis.certificate import Certificate, certify
from dualwinch.simulation.analysis.sliding_mode import sliding_mode
from dualwinch.simulation.analysis.stability import IDEAL, REAL, auxiliary_weight_needed
from dualwinch.simulation.experiment import Experiment

ROUNDS = 6
"""Times the gains are raised from one start."""

HEADROOM = 1.02
"""How far beyond its bound a gain is set that has to rise: the next run's bound will not be quite the same."""


@dataclass(frozen=True)
class NearbyGains:
    """What the search came to.

    Attributes:
        certificate: of the last gain set tried.
        changes: key → (given, tried), of every gain that differs.
        found: whether that gain set satisfies every condition in its own run.
        history: what every gain set tried lacked, in words.
        reason: why there are such gains, or why none was found, in words.
    """

    certificate: Certificate
    changes: dict[str, tuple[float, float]]
    found: bool
    history: list[str]
    reason: str


def nearby_gains(given: Certificate, *, progress: Callable[[float], None] | None = None) -> NearbyGains:
    """Raise the gains that fall short, run again, and repeat: a change of gains also changes the bounds.

    Raised are ``k``, ``l0``, ``gamma`` and ``gamma_force``, each to where the last run's bounds put it. Where that
    fails with the given ``k_a``, it is tried once more with the largest that forgets Z_a without overshoot from one
    sample to the next, 1/Ts, which lets gamma be smallest. Nothing else is changed.

    Args:
        given: the certificate to start from.
        progress: called after every run with the share of the longest search that is done.
    """
    experiment = given.result.experiment
    k_a, fastest = sliding_mode(experiment).auxiliary.k_a, 1 / experiment.simulation.sample_time
    tried, history, runs = given, [_shortfall(given)], 0
    for decay in (k_a or AuxiliaryGains().k_a, fastest):
        if tried.certified:
            break
        tried = given
        for _ in range(ROUNDS):
            tried = certify(_raised(tried, decay))
            runs += 1
            history.append(f"k_a = {decay:g}: {_shortfall(tried)}")
            if progress:
                progress(runs / (2 * ROUNDS))
            if tried.certified or tried.result.outcome != "completed":
                break
    before, after = leaves(experiment.controller), leaves(tried.result.experiment.controller)
    return NearbyGains(
        certificate=tried,
        changes={f"controller.{key}": (before[key], value) for key, value in after.items() if value != before[key]},
        found=tried.certified,
        history=history,
        reason=_reason(given, tried),
    )


def _raised(certificate: Certificate, k_a: float) -> Experiment:
    """The experiment with this k_a, and every gain that falls short set to what the certificate's run asks for."""
    experiment, bounds = certificate.result.experiment, certificate.bounds[IDEAL]
    weight = auxiliary_weight_needed(experiment.controller.limits.tension_max, k_a)
    wanted = {"auxiliary.k_a": k_a, "auxiliary.gamma": weight, "auxiliary.gamma_force": weight}
    for condition in certificate.conditions:
        if condition.name == "switching gain" and condition.basis == IDEAL and not condition.holds:
            wanted["nftsm.k"] = HEADROOM * condition.right
    if bounds.observer_gain < bounds.disturbance_rate:
        wanted["observer.l0"] = HEADROOM * bounds.disturbance_rate
    before = leaves(experiment.controller)
    rising = {key: max(before[key], value) for key, value in wanted.items()}
    return replace(experiment, controller=with_leaves(experiment.controller, rising))


def _shortfall(certificate: Certificate) -> str:
    """What a gain set lacks, in one line."""
    result = certificate.result
    if result.outcome != "completed":
        return f"the run {result.outcome.replace('_', ' ')} at {result.end_time:.4g} s"
    lacking = [
        f"{condition.name} {condition.left:.4g} < {condition.right:.4g} {condition.unit}"
        for condition in certificate.conditions
        if condition.basis != REAL and not condition.holds
    ]
    return "; ".join(lacking) or "every condition holds"


def _reason(given: Certificate, tried: Certificate) -> str:
    experiment, columns = given.result.experiment, given.result.columns
    if given.certified:
        return "the given gains satisfy every condition in this run"
    if tried.certified and not np.any(tried.result["Z_a"]):
        return "the force is never cut off in this run, so Z_a stays 0 and the weights of Z_a may be anything"
    if tried.certified:
        return "the raised gains satisfy every condition in their own run"
    cut_off = np.abs(columns["u"] - columns["u_sat"])
    excess = float(cut_off[np.argmax(cut_off > 0)])
    if not excess > 0:
        return f"after {ROUNDS} rounds the bounds still grow as fast as the gains"
    sample_time = experiment.simulation.sample_time
    least = auxiliary_weight_needed(experiment.controller.limits.tension_max, 1 / sample_time)
    return (
        f"the force is cut off, at first by {excess:.4g} N. Z_a forgets within a sample at most (k_a <= 1/Ts), so "
        f"gamma must be >= 2 F_max Ts = {least:.4g}, and that one sample puts gamma Ts {excess:.4g} N = "
        f"{least * sample_time * excess:.4g} m/s into "
        "e2 + gamma Z_a: the force is cut off the more, and the loop runs away"
    )
