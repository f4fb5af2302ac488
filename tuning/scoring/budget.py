"""Budgets of a study: what was spent, and what is left for the certificate and the test set."""

from dataclasses import dataclass

from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.scoring import clock

CERTIFICATE_SHARE = 0.125
"""Share of a budget of rollouts that is reserved for the certificate, 1 500 of 12 000, and that it may take besides."""

TIME_SHARE, TIME_MORE = 0.3, 10.0
"""A study with a time T for its search takes at most this share of T and this time in s besides, after preparation."""

LEAST_SEARCH = 0.5
"""Least share of its time that a search keeps, however long the certificate takes."""


@dataclass
class Meter:
    """Rollouts and stability margins so far, and the wall time that they took.

    Attributes:
        rollouts: number of rollouts.
        seconds: their wall time in s.
        margin_seconds: wall time in s of stability margins.
        machines: number of machines on which a controller's margins were computed in all loops.
        machine_seconds: their part of `margin_seconds`.
    """

    rollouts: int = 0
    seconds: float = 0.0
    margin_seconds: float = 0.0
    machines: int = 0
    machine_seconds: float = 0.0

    def count_runs(self, began: float, rollouts: int) -> None:
        """Count rollouts that began at a time of `clock.now`."""
        self.rollouts += rollouts
        self.seconds += clock.now() - began

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
    def margin_pace(self) -> float:
        """Mean wall time in s of a controller's margins on a machine; 0 before the first."""
        return self.machine_seconds / self.machines if self.machines else 0.0


@dataclass(frozen=True)
class SelectionBudget:
    """Limits of the certificate; beyond them no further candidate is examined.

    Attributes:
        until: time by `clock.without_compiling`; ``None``: no limit. An examination stops there, with what it has.
        rollouts: of the study so far, search included; ``None``: no limit. An examination that has begun has all the
            draws that it needs without a violation.
    """

    until: float | None = None
    rollouts: int | None = None

    def ended(self) -> bool:
        """Whether the time is over."""
        return self.until is not None and clock.without_compiling() >= self.until

    def allows(self, meter: Meter, rollouts: int) -> bool:
        """Whether a number of further rollouts is within both limits, at the pace so far."""
        if self.until is not None:
            return clock.without_compiling() + rollouts * meter.pace <= self.until
        return self.rollouts is None or meter.rollouts + rollouts <= self.rollouts


def seconds_of_search(seconds: float, left: float, after: float) -> float:
    """Time in s of a search, of the `seconds` asked for.

    Args:
        seconds: asked for.
        left: time in s for search, certificate and test set.
        after: estimated time in s of certificate and test set.
    """
    return max(min(seconds, left - after), LEAST_SEARCH * seconds)


def seconds_after_search(options: TuningOptions, draws: int, pace: float, margin_pace: float) -> tuple[float, float]:
    """Estimated times in s of the certificate, with the search's last generation, and of the test set.

    Args:
        options: have the sizes.
        draws: that the certificate of the first candidate needs.
        pace: time in s of a rollout.
        margin_pace: time in s of a controller's margins on a machine; 0: none is bounded.
    """
    last = options.generation * (options.draws + options.cuts) if draws else 0
    certificate = pace * (draws + last) + margin_pace * options.machines
    test = 3 * (pace * options.test + margin_pace * (1 + options.machines_checked))
    return certificate, test
