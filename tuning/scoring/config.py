"""How many finalists meet in how many scenarios, and how many score the best: all there should be, or what time allows.

The search has its time; choosing and scoring come on top of it, and must not take long beside a short search.
"""

from dataclasses import astuple, dataclass


@dataclass(frozen=True)
class SampleSizes:
    """Numbers of the final choice and of the score.

    Attributes:
        finalists: of a ladder of the first round.
        sieved: rollouts after which no further ladder is begun.
        draws, vertices: of the ensemble, in which they meet.
        hard, looked_at: further draws in which they meet, the hardest of so many.
        last: finalists of the second round, beside the start.
        last_draws: further draws, in which they meet.
        confirmed: yet further draws, in which the best meets alone.
        held_out: scenarios that score the best, the start and the paper's gains.
    """

    finalists: int = 16
    sieved: int = 4000
    draws: int = 96
    vertices: int = 32
    hard: int = 8
    looked_at: int = 400
    last: int = 8
    last_draws: int = 192
    confirmed: int = 1500
    held_out: int = 200

    @property
    def rollouts(self) -> int:
        """Rollouts that it takes, nearly, with those of the start and of the paper's gains."""
        scenarios = self.draws + self.vertices + self.hard
        first = max(self.sieved, self.finalists * scenarios // 2) + 2 * scenarios
        return first + (self.last + 2) * self.last_draws + self.confirmed + 3 * self.held_out

    def scaled(self, share: float) -> "SampleSizes":
        """The plan with a share of all numbers, but no fewer than `LEAST`, or than this plan has."""
        counts = zip(astuple(self), astuple(LEAST), strict=True)
        return SampleSizes(*(max(round(share * count), min(count, least)) for count, least in counts))


FULL = SampleSizes()
"""What is made where nobody is in a hurry."""

LEAST = SampleSizes(
    finalists=16,
    sieved=0,
    draws=8,
    vertices=4,
    hard=1,
    looked_at=25,
    last=2,
    last_draws=8,
    confirmed=250,
    held_out=32,
)
"""The fewest that are worth anything."""

STEPS = 20
"""Shares of a plan that are looked at."""

BESIDE_SHARE, BESIDE_SECONDS = 0.3, 3.0
"""What everything beside a search of some time may take: a share of it, or the time in s if that is longer."""

LEFT_SHARE, LEFT_SECONDS = 0.2, 1.0
"""What choosing and scoring may take where preparing has taken what there was, as when much had to be compiled: a share
of the search, or the time in s if that is longer. What is presented rests on it."""


def time_for(search: float, spent: float) -> float:
    """Time in s for choosing and scoring.

    Args:
        search: time in s that was asked for.
        spent: what else takes time beside it, in s.
    """
    beside = max(BESIDE_SECONDS, BESIDE_SHARE * search)
    return max(beside - spent, LEFT_SHARE * search, LEFT_SECONDS)


def affordable(full: SampleSizes, seconds: float, pace: float) -> SampleSizes:
    """The largest share of a plan that can be carried out in some time.

    Args:
        full: the plan.
        seconds: time in s.
        pace: time in s that a rollout takes in the search.
    """
    for step in range(STEPS, 0, -1):
        plan = full.scaled(step / STEPS)
        if pace * plan.rollouts <= seconds:
            return plan
    return full.scaled(0.0)
