"""Budgets of a study: what was spent, and what is left for the certificate and the test set."""

from dataclasses import dataclass

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
class Meter:
    """Rollouts, fresh draws and stability margins so far, and the wall time that they took.

    Attributes:
        rollouts: number of rollouts.
        seconds: their wall time in s.
        draws: number of fresh draws.
        draw_seconds: wall time in s of drawing them.
        margin_seconds: wall time in s of stability margins.
        machines: number of machines on which a controller's margins were computed in all loops.
        machine_seconds: their part of `margin_seconds`.
    """

    rollouts: int = 0
    seconds: float = 0.0
    draws: int = 0
    draw_seconds: float = 0.0
    margin_seconds: float = 0.0
    machines: int = 0
    machine_seconds: float = 0.0

    def count_runs(self, began: float, rollouts: int) -> None:
        """Count rollouts that began at a time of `clock.now`."""
        self.rollouts += rollouts
        self.seconds += clock.now() - began

    def count_draws(self, began: float, draws: int) -> None:
        """Count fresh draws that were drawn since `began`."""
        self.draws += draws
        self.draw_seconds += clock.now() - began

    def count_margins(self, began: float, machines: int) -> None:
        """Count margins since `began` in all loops of some machines; 0 machines: in some loops."""
        elapsed = clock.now() - began
        self.margin_seconds += elapsed
        if machines:
            self.machines += machines
            self.machine_seconds += elapsed

    @property
    def pace(self) -> float:
        """Mean wall time of a rollout in s; 0 before the first."""
        return self.seconds / self.rollouts if self.rollouts else 0.0

    @property
    def draw_pace(self) -> float:
        """Mean wall time of drawing a fresh draw in s; 0 before the first."""
        return self.draw_seconds / self.draws if self.draws else 0.0

    @property
    def margin_pace(self) -> float:
        """Mean wall time in s of a controller's margins on a machine; 0 before the first."""
        return self.machine_seconds / self.machines if self.machines else 0.0


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
        seconds = rollouts * meter.pace + draws * meter.draw_pace + machines * meter.margin_pace
        in_time = self.until is None or clock.without_compiling() + seconds <= self.until
        return in_time and (self.rollouts is None or meter.rollouts + rollouts <= self.rollouts)


def seconds_of_test(options: TuningOptions, meter: Meter) -> float:
    """Estimated time in s of the test set, at the pace so far."""
    scores = 3 * (meter.pace * options.test + meter.margin_pace * (1 + options.machines_checked))
    return scores + meter.draw_pace * options.test
