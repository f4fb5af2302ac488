"""The theorem checked on one experiment: its conditions, and its Lyapunov function along the run."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.analysis.sliding_mode import sliding_mode
from dualwinch.simulation.analysis.stability import (
    IDEAL,
    REAL,
    Bounds,
    Condition,
    LyapunovTerms,
    bounds,
    claimed_decay,
    conditions,
    disturbance,
    lyapunov_terms,
    nominal_mass,
)
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Certificate:
    """What the theorem says of one experiment, and what its Lyapunov function does.

    Attributes:
        result: the run, every sample kept.
        bounds: basis → bounds found in the run.
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


def certify(experiment: Experiment, *, progress: Callable[[float], None] | None = None) -> Certificate:
    """Run an experiment and hold the paper's stability theorem against it (Section 3.1.5).

    Args:
        experiment: gains and scenario; the position law must be ``fando-nftsm`` or ``nftsm``.
        progress: called now and then with the share of the run that is done.

    Raises:
        ConfigurationError: another position law, or an observer without a constant gain (V divides by it).
    """
    law = sliding_mode(experiment, "the theorem is about")
    if isinstance(law, FandoNftsm) and law.observer.l0 <= 0:
        raise ConfigurationError("controller.observer.l0 = 0: must be > 0, V divides by the observer's gain")
    result = simulate(experiment, progress=progress)
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging run is a result too
        return _judged(result)


def _judged(result: Result) -> Certificate:
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
