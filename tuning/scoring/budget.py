"""Budgets of a study: what was spent, and what is left for the certificate and the test set."""

from collections.abc import Collection
from dataclasses import dataclass, field

from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.scoring import clock

CERTIFICATE_SHARE = 0.125
"""Largest share of the rollouts for certificates during the search; and share of a budget that certificates may take
besides, where the first candidates are rejected."""

TIME_SHARE, TIME_MORE = 0.3, 10.0
"""A study with a time T for its search takes at most this share of T and this time in s besides, after preparation."""

LEAST_SEARCH = 0.5
"""Least share of its budget that a search keeps, however much the certificate takes."""


@dataclass
class Tally:
    """How often something was computed so far, and the wall time that it took.

    Attributes:
        count: how often.
        seconds: wall time in s.
    """

    count: int = 0
    seconds: float = 0.0

    def add(self, began: float, count: int) -> None:
        """Add what was computed since a time of `clock.now`."""
        self.count += count
        self.seconds += clock.now() - began

    @property
    def pace(self) -> float:
        """Mean wall time in s; 0 before the first."""
        return self.seconds / self.count if self.count else 0.0


@dataclass
class Meter:
    """What a study has computed so far.

    Attributes:
        rollouts: runs of candidates and of other controllers.
        draws: fresh draws.
        margins: stability margins, of a controller on a machine in all loops.
        some_margins: those in some loops alone.
    """

    rollouts: Tally = field(default_factory=Tally)
    draws: Tally = field(default_factory=Tally)
    margins: Tally = field(default_factory=Tally)
    some_margins: Tally = field(default_factory=Tally)

    def margins_in(self, loops: Collection[int] | None) -> Tally:
        """Margins in some loops, given by their indices, or in all (``None``)."""
        return self.margins if loops is None else self.some_margins


@dataclass(frozen=True)
class SelectionBudget:
    """Limits of the certificate; beyond them no further candidate is examined.

    Attributes:
        until: time by `clock.without_compiling`; ``None``: no limit. An examination stops there, with what it has.
        rollouts: of the study so far, search included; ``None``: no limit. An examination that has begun has all the
            draws that it needs without a violation, and more of them within the limit.
    """

    until: float | None = None
    rollouts: int | None = None

    def ended(self) -> bool:
        """Whether the time is over."""
        return self.until is not None and clock.without_compiling() >= self.until

    def allows(self, meter: Meter, rollouts: int, draws: int, machines: int = 0) -> bool:
        """Whether so many rollouts and fresh draws more, and margins on so many machines, are within the limits.

        Times are those at the pace so far.
        """
        seconds = rollouts * meter.rollouts.pace + draws * meter.draws.pace + machines * meter.margins.pace
        in_time = self.until is None or clock.without_compiling() + seconds <= self.until
        return in_time and (self.rollouts is None or meter.rollouts.count + rollouts <= self.rollouts)


def seconds_of_test(options: TuningOptions, meter: Meter) -> float:
    """Estimated time in s of the test set, at the pace so far."""
    scores = 3 * (meter.rollouts.pace * options.test + meter.margins.pace * (1 + options.machines_checked))
    return scores + meter.draws.pace * options.test
