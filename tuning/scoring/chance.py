"""Chance constraint, by the scenario approach: the probability that a fresh draw violates a bound is at most ε.

Each of at most K candidates is run in M independent draws of its own, not used in search and validation. If a candidate
violates no bound in them, its probability of violation is at most ε with confidence 1 − β, provided that
M ≥ ln(K/β)/ε (Tempo, Bai and Dabbene, Systems & Control Letters 30, 1997; Calafiore and Campi, IEEE TAC 51, 2006;
Tempo, Calafiore and Dabbene, Randomized Algorithms for Analysis and Control of Uncertain Systems, 2013).
"""

import math
from dataclasses import dataclass
from typing import Any

from scipy.stats import beta


def clopper_pearson(violations: int, draws: int, confidence: float) -> tuple[float, float]:
    """Two-sided Clopper–Pearson interval of a probability from a number of violations (Biometrika 26, 1934)."""
    rest = (1 - confidence) / 2
    return (
        float(beta.ppf(rest, violations, draws - violations + 1)) if violations else 0.0,
        float(beta.ppf(1 - rest, violations + 1, draws - violations)) if violations < draws else 1.0,
    )


def draws_needed(violation: float, confidence: float, candidates: int) -> int:
    """Number of draws M = ln(K/β)/ε, rounded up, for a violation ε, a confidence 1 − β and K candidates."""
    return math.ceil(math.log(candidates / (1 - confidence)) / violation)


@dataclass(frozen=True)
class ChanceConstraint:
    """Result of the chance constraint for the selected candidate.

    Attributes:
        violation: ε, the requested largest probability of a violation.
        confidence: 1 − β, requested.
        candidates: K, the largest number of candidates.
        draws: M, the number of fresh draws of the candidate.
        violations: number of draws in which a bound on the worst case is violated or the run is incomplete.
    """

    violation: float
    confidence: float
    candidates: int
    draws: int
    violations: int

    @property
    def supported(self) -> float:
        """Upper confidence limit of the probability of a violation (Clopper–Pearson, β divided by K)."""
        if self.violations >= self.draws:
            return 1.0
        rest = (1 - self.confidence) / self.candidates
        return float(beta.ppf(1 - rest, self.violations + 1, self.draws - self.violations))

    @property
    def draws_needed(self) -> int:
        """Number of draws without a violation that supports ε."""
        return draws_needed(self.violation, self.confidence, self.candidates)

    @property
    def satisfied(self) -> bool:
        """Whether that limit is at most ε."""
        return self.supported <= self.violation

    @property
    def words(self) -> str:
        """The probability that bounds on runs (not on margins) are satisfied, with its evidence, in words."""
        seen = f"{self.violations or 'no'} violation{'s' * (self.violations != 1)} in {self.draws} fresh draws"
        sure = f"{100 * self.confidence:g} % confidence"
        if self.satisfied:
            return f"bounds on runs are satisfied with probability ≥ {_share(1 - self.violation)} ({sure}: {seen})"
        words = f"bounds on runs are satisfied with probability ≥ {_share(1 - self.supported)} ({sure}: {seen}"
        more = f", {self.draws_needed} are needed" if self.draws < self.draws_needed and not self.violations else ""
        return f"{words}{more}; asked for: {_share(1 - self.violation)})"

    def to_dict(self) -> dict[str, Any]:
        """As a dictionary for JSON."""
        return {
            "violation": self.violation,
            "probability": 1 - self.violation,
            "confidence": self.confidence,
            "candidates": self.candidates,
            "draws": self.draws,
            "draws_needed": self.draws_needed,
            "violations": self.violations,
            "supported": self.supported,
            "supported_probability": 1 - self.supported,
            "satisfied": self.satisfied,
        }


def _share(probability: float) -> str:
    """A probability in per cent, rounded down to stay on the safe side."""
    return f"{math.floor(1e4 * probability + 1e-6) / 100:g} %"
