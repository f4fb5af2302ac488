"""The certificate: the probability that a fresh draw violates a bound is at most ε, with confidence 1 − β.

Sequential probabilistic validation (Alamo, Tempo, Luque and Ramirez, Automatica 52, 2015): the k-th candidate is tested
in fresh draws of its own with β_k = 6β/(π²k²), so that the error of all tests together is at most β, however many there
are. Each test is sequential, too, by the same series: its stage s = 0, 1, … allows s violations in the least number of
draws M_s for which Clopper and Pearson's upper limit (Biometrika 26, 1934) at confidence 1 − 6β_k/(π²(s + 1)²) is at
most ε. A candidate is accepted at the first stage whose violations it does not exceed, and rejected once as many
violations as it has had, or more, would have a probability below β if that of one were ε.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from scipy.stats import beta, binom


def clopper_pearson(violations: int, draws: int, confidence: float) -> tuple[float, float]:
    """Two-sided Clopper–Pearson interval of a probability from a number of violations (Biometrika 26, 1934)."""
    tail = (1 - confidence) / 2
    return (
        float(beta.ppf(tail, violations, draws - violations + 1)) if violations else 0.0,
        upper_limit(violations, draws, tail),
    )


def upper_limit(violations: int, draws: int, error: float) -> float:
    """One-sided Clopper–Pearson limit: a probability above it is excluded with an error of at most `error`."""
    return float(beta.ppf(1 - error, violations + 1, draws - violations)) if violations < draws else 1.0


def series(error: float, number: int) -> float:
    """The part of an error for the test of a number from 1: the parts of all numbers add up to it."""
    return 6 * error / (math.pi * number) ** 2


def draws_needed(violation: float, error: float, violations: int = 0) -> int:
    """Least number of draws in which a number of violations supports a probability of `violation`."""
    if not violations:
        return math.ceil(math.log(error) / math.log1p(-violation))
    low, high = violations, 2 * draws_needed(violation, error) + math.ceil(4 * violations / violation)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if upper_limit(violations, middle, error) <= violation else (middle, high)
    return high


def is_unlikely(violations: int, draws: int, violation: float, error: float) -> bool:
    """Whether so many violations, or more, have a probability below `error` if that of one is `violation`."""
    return violations > 0 and float(binom.sf(violations - 1, draws, violation)) < error


@dataclass(frozen=True)
class SampleCertificate:
    """What fresh draws and machines support of a candidate.

    Attributes:
        violation: ε, the requested largest probability of a violation.
        confidence: 1 − β, requested.
        candidate: k, its number among the examined ones, from 1.
        draws: number of its fresh draws.
        violations: number of draws in which a bound on the worst case is violated or the run is incomplete.
        machines: number of its fresh machines.
        machines_below: number of machines on which a margin is below its bound.
        means: bound on a mean that it violates in these draws → its violation.
    """

    violation: float
    confidence: float
    candidate: int = 1
    draws: int = 0
    violations: int = 0
    machines: int = 0
    machines_below: int = 0
    means: Mapping[str, float] = field(default_factory=dict)

    @property
    def error(self) -> float:
        """β_k, the part of the error for this candidate."""
        return series(1 - self.confidence, self.candidate)

    def draws_of_stage(self, violations: int) -> int:
        """M_s, the number of draws in which a number of violations supports ε."""
        return draws_needed(self.violation, series(self.error, violations + 1), violations)

    @property
    def supported(self) -> float:
        """Upper limit of the probability of a violation."""
        return upper_limit(self.violations, self.draws, series(self.error, self.violations + 1)) if self.draws else 1.0

    @property
    def rejected(self) -> bool:
        """Whether a probability of ε or less is unlikely."""
        return is_unlikely(self.violations, self.draws, self.violation, 1 - self.confidence)

    @property
    def satisfied(self) -> bool:
        """Whether ε is supported, all machines keep their margins, and means their bounds."""
        in_draws = self.draws > 0 and self.supported <= self.violation
        return in_draws and not self.machines_below and not self.means

    @property
    def machine_share(self) -> float:
        """Upper limit of the share of machines on which a margin is below its bound."""
        return upper_limit(self.machines_below, self.machines, self.error)

    @property
    def sentences(self) -> list[str]:
        """What is certified, with its evidence; or why nothing is, and what is supported."""
        confidence = f"with {100 * self.confidence:g} % confidence"
        if self.satisfied:
            return [f"certified {confidence}: {self._support}"]
        sentences = [f"not certified: {' and '.join(self._obstacles)}"]
        return [*sentences, f"{confidence}, {self._support}"] if self._support else sentences

    @property
    def _obstacles(self) -> Iterator[str]:
        """Why it is not certified."""
        request = _share(1 - self.violation)
        if self.machines_below:
            yield f"on {self.machines_below} of {self.machines} fresh machines a margin is below its bound"
        elif not self.draws:
            yield "no fresh draws were run"
        elif self.rejected:
            yield f"{self.violations} of {self.draws} fresh draws violate a bound, more than {request} allows"
        elif self.supported > self.violation:
            yield f"{self.draws} fresh draws, {self.violations} of which violate a bound, are too few for {request}"
        for mean in self.means:
            yield f"over the fresh draws, {mean} is violated"

    @property
    def _support(self) -> str:
        """The supported shares of draws and machines, with their evidence."""
        words = []
        if self.draws:
            share = _share(1 - max(self.violation, self.supported))
            words.append(
                f"bounds hold in ≥ {share} of draws ({self.violations} of {self.draws} fresh ones violate one)"
            )
        if self.machines:
            below = f"{self.machines_below} of {self.machines} fresh ones below"
            words.append(f"margins hold on ≥ {_share(1 - self.machine_share)} of machines ({below})")
        return ", and ".join(words)

    def to_dict(self) -> dict[str, Any]:
        """As a dictionary for JSON."""
        fields = asdict(self)
        return {
            "violated_means": fields.pop("means"),
            **fields,
            "probability": 1 - self.violation,
            "draws_needed": self.draws_of_stage(self.violations),
            "machine_share": self.machine_share if self.machines else None,
            "machine_share_satisfied": 1 - self.machine_share if self.machines else None,
            "supported": self.supported,
            "supported_probability": 1 - self.supported,
            "satisfied": self.satisfied,
        }


def _share(probability: float) -> str:
    """A probability in per cent, rounded down to stay on the safe side."""
    return f"{math.floor(1e4 * probability + 1e-6) / 100:g} %"
