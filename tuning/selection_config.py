"""Hyper-parameters of a search and its training set, of ranking, validation, chance constraint and test set."""

from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, field, fields, replace
from typing import Any

from dualwinch.model.errors import ConfigurationError

TRIALS = 1000
"""Trials of a search without a budget; more where its gains need more (`SelectionConfig.trials_needed`)."""

SCENARIOS = 12
"""Scenarios of the training set where nothing else is asked for."""


def default_method(objectives: int) -> str:
    """The method where none is asked for."""
    return "hybrid" if objectives == 1 else "nsga2"


@dataclass(frozen=True)
class SampleSizes:
    """Numbers of candidates and scenarios in validation, chance constraint and test.

    Attributes:
        candidates: of a group that is evaluated in the validation set.
        screening_rollouts: number of rollouts after which no further group is evaluated there.
        draws, vertices: of the ensemble, in the validation set.
        chance: fresh draws for each candidate that the chance constraint looks at; the default is that of
            `tuning.scoring.chance.draws_needed` for the probabilities of `SelectionConfig`.
        test: scenarios of the test set.
    """

    candidates: int = 8
    screening_rollouts: int = 4000
    draws: int = 256
    vertices: int = 32
    chance: int = 819
    test: int = 200

    @property
    def rollouts(self) -> int:
        """Estimated number of rollouts of all of that, the start's and the paper's included."""
        screening = max(self.screening_rollouts, self.candidates * (self.draws + self.vertices)) // 2
        return screening + 2 * (self.draws + self.vertices + self.chance) + 3 * self.test

    @property
    def surveys(self) -> int:
        """Estimated number of times that stability margins of a controller are computed on all machines of a set."""
        return self.candidates + (self.candidates > 0) + 3

    @property
    def after_validation(self) -> "SampleSizes":
        """The part that comes after the validation set: chance constraint and test."""
        return replace(self, candidates=0, screening_rollouts=0, draws=0, vertices=0)

    def scaled(self, share: float, least: "SampleSizes") -> "SampleSizes":
        """A share of all sizes, none below `least` unless it is so already."""
        sizes = zip(astuple(self), astuple(least), strict=True)
        return SampleSizes(*(max(round(share * size), min(size, lowest)) for size, lowest in sizes))


@dataclass(frozen=True)
class SelectionConfig:
    """Hyper-parameters of the method that `tuning.scoring.selection` describes.

    Shares are of a bound where nothing else is said.

    Attributes:
        hard_training: hard scenarios of the training set, beyond those that all candidates are run in.
        demand_among: draws and vertices among which hard ones are looked for.
        largest_lag: distance in m by which the vehicle falls behind at most in hard draws, for lack of force.
        share_vertices: of these.
        margin_machines, margin_machines_validated: drawn machines on which stability margins are computed in training
            (those on which the start's are least), and in validation and test.
        margin_machines_screened: drawn machines among which the former are chosen, those on which the start's are least
            where the nominal machine's are.
        margin_amplitudes: of the speed error in m/s, at which margins are computed beside that of the speed sensor's
            noise.
        loop_range: margin over the least of its machine and amplitude up to which it says how nearly active a loop is.
        back_off: distance that bounds on the worst case keep in training and after a repair, for more scenarios have
            worse cases.
        pool_size: active scenarios for the best candidates of a batch.
        pool_memory: weight of what was known of a scenario's violations before (exponential smoothing).
        pool_range: least and largest violation that counts there.
        pool_review: every so many batches all hard scenarios are run for the leader.
        first_share: of the common scenarios, in which all candidates of a batch are run (the first rung).
        eta: η of successive halving: one in η candidates of a rung is run in the scenarios of the next.
        prune_above: batches of more candidates are pruned in the first rung.
        most_leaders: candidates of a batch that are run in the active scenarios, the last rung, at most.
        hopeless: violation beyond which a candidate is run in no further scenarios.
        most_slack: share of a run with a slack rope beyond which the run is stopped, where no rope may be slack.
        penalty: of the exact penalty: added to the logarithm of the objective for a violation of 1. 2 % cost a factor
            of e; an optimum on its bounds gains a few times the share by which it gives way, which is far less.
        first_screened: scenarios of the validation set in which candidates are evaluated first.
        repair_most: violation beyond which a peak is not due to the reserve.
        repair_steps: shares of the wanted change of the reserve in the line search; the first feasible one is taken.
        violation: ε, the largest probability that a draw violates a bound.
        confidence: 1 − β, of the chance constraint and of the intervals of the test set.
        chance_candidates: K, the most candidates that the chance constraint looks at.
        sizes, least_sizes: of validation, chance constraint and test, and the smallest where time is short.
        size_steps: number of shares of `sizes` that are considered.
        time_share, time_more: a study with a time T for its search ends within (1 + share) T + more, in s; compiling
            comes on top.
        judging_share, judging_more: of it, share of T and time in s that the search leaves for validation and test,
            where preparing took long.
        time_caution: share by which a rollout of validation and test is taken for longer than those before.
        trials_per_gain: trials for each gain below which a search is called short: CMA-ES needs about 100 to learn the
            covariance (Hansen, arXiv:1604.00772), and below that its best is mostly luck.
    """

    hard_training: int = 48
    demand_among: int = 600
    largest_lag: float = 0.01
    share_vertices: float = 1 / 6
    margin_machines: int = 2
    margin_machines_validated: int = 8
    margin_machines_screened: int = 8
    margin_amplitudes: tuple[float, ...] = (0.01, 0.1)
    loop_range: float = 3.0
    back_off: float = 0.005
    pool_size: int = 16
    pool_memory: float = 0.7
    pool_range: tuple[float, float] = (-0.02, 0.1)
    pool_review: int = 8
    first_share: float = 0.5
    eta: float = 3.0
    prune_above: int = 8
    most_leaders: int = 6
    hopeless: float = 0.05
    most_slack: float = 0.01
    penalty: float = 50.0
    first_screened: int = 12
    repair_most: float = 0.02
    repair_steps: tuple[float, ...] = (1.0, 0.75, 0.5, 0.25)
    violation: float = 0.005
    confidence: float = 0.95
    chance_candidates: int = 3
    sizes: SampleSizes = field(default_factory=SampleSizes)
    least_sizes: SampleSizes = SampleSizes(4, 0, 16, 4, 100, 32)
    size_steps: int = 20
    time_share: float = 0.3
    time_more: float = 10.0
    judging_share: float = 0.1
    judging_more: float = 2.0
    time_caution: float = 0.25
    trials_per_gain: int = 100

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` where a probability is none."""
        for name, value in (("violation", self.violation), ("confidence", self.confidence)):
            if not 0 < value < 1:
                raise ConfigurationError(f"{name} = {value:g}: must be > 0 and < 1, i.e. between 0 and 100 %")

    def trials_needed(self, gains: int) -> int:
        """Trials from which on a search for so many gains is not called short."""
        return self.trials_per_gain * gains

    def time_of_all(self, search: float) -> float:
        """Time in s in which a study ends whose search may take so many seconds, compiling apart."""
        return (1 + self.time_share) * search + self.time_more

    def time_of_search(self, search: float, left: float, pace: float = 0.0, margin_pace: float = 0.0) -> float:
        """Time in s that the search has, where so many seconds are left after preparing; some of it in any case.

        Args:
            search: time in s that was asked for.
            left: time in s for search, validation and test.
            pace: time in s that a rollout takes.
            margin_pace: time in s that the stability margins of a controller on a machine take.
        """
        least = self._time_of(self.least_sizes, pace, margin_pace)
        judging = max(self.judging_share * search + self.judging_more, least)
        return max(min(search, left - judging), self.judging_share * search)

    def _time_of(self, sizes: SampleSizes, pace: float, margin_pace: float) -> float:
        """Time in s that validation and test in some sizes take, with caution; arguments as of `affordable`."""
        machines = 1 + self.margin_machines_validated
        return (1 + self.time_caution) * (pace * sizes.rollouts + margin_pace * machines * sizes.surveys)

    def affordable(self, sizes: SampleSizes, seconds: float, pace: float, margin_pace: float = 0.0) -> SampleSizes:
        """The largest share of some sizes whose rollouts and stability margins end in time.

        Args:
            sizes: at most.
            seconds: time in s.
            pace: time in s that a rollout took so far.
            margin_pace: time in s that the stability margins of a controller on a machine took so far.
        """
        for step in range(self.size_steps, -1, -1):
            scaled = sizes.scaled(step / self.size_steps, self.least_sizes)
            if self._time_of(scaled, pace, margin_pace) <= seconds:
                return scaled
        return sizes.scaled(0.0, self.least_sizes)

    def to_record(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "SelectionConfig":
        """The configuration that `to_record` took apart."""
        tuples = {each.name for each in fields(cls) if str(each.type).startswith("tuple")}
        plain: dict[str, Any] = {name: tuple(value) if name in tuples else value for name, value in record.items()}
        for name in ("sizes", "least_sizes"):
            plain[name] = SampleSizes(**record[name])
        return cls(**plain)
