"""Parameters of the tuning method: sample average, cutting set, certificate (`tuning.scoring.selection`)."""

from dataclasses import dataclass

from dualwinch.model.errors import ConfigurationError

TRIALS = 1000
"""Trials of a search without a budget, or more if its gains need more (`TuningOptions.trials_needed`)."""


def default_method(objectives: int) -> str:
    """The default method for a number of objectives."""
    return "cmaes" if objectives == 1 else "nsga2"


@dataclass(frozen=True)
class TuningOptions:
    """Parameters of the tuning method, whose steps `tuning.scoring.selection` describes.

    Attributes:
        draws: random draws in which every candidate is run; more make the mean more exact, and the search slower.
        hard: draws that join the training set as first cuts: those of `population` that demand the most force.
        population: number of draws from which these are taken.
        cuts: largest number of cuts, the hard draws included; beyond, those with the most slack at the leader go.
        generation: candidates in a generation, one per vector lane.
        penalty: added to the logarithm of the objective for a violation of 1, a share of the bound: a violation of 2 %
            costs a factor of e.
        check_share: largest share of the rollouts for checks of the leader in fresh draws.
        chunk: fresh draws in a check, and between two looks of the certificate.
        machines_checked: fresh machines in a check, on which stability margins are computed.
        machines: fresh machines on which a candidate must keep its margins; with 59, at most 5 % of all machines are
            below with 95 % confidence.
        authority: share of the motors' force above which a draw counts towards bounds on the worst case only: there the
            vehicle falls behind with any gains, and one such draw outweighs hundreds in a mean.
        violation: ε, the largest probability that a draw violates a bound.
        confidence: 1 − β, of the certificate and of the intervals of the test set.
        test: scenarios of the test set.
        trials_per_gain: number of trials per gain below which a search is called short: CMA-ES needs about 100 to learn
            the covariance (Hansen, arXiv:1604.00772).
    """

    draws: int = 12
    hard: int = 6
    population: int = 600
    cuts: int = 18
    generation: int = 16
    penalty: float = 50.0
    check_share: float = 0.25
    chunk: int = 64
    machines_checked: int = 6
    machines: int = 59
    authority: float = 0.95
    violation: float = 0.005
    confidence: float = 0.95
    test: int = 200
    trials_per_gain: int = 100

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` for an invalid probability."""
        for name, value in (("violation", self.violation), ("confidence", self.confidence)):
            if not 0 < value < 1:
                raise ConfigurationError(f"{name} = {value:g}: must be > 0 and < 1, i.e. between 0 and 100 %")

    def trials_needed(self, gains: int) -> int:
        """Number of trials that a search for a number of gains needs."""
        return self.trials_per_gain * gains
