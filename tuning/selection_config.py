"""Hyper-parameters of search, training set, ranking, validation, chance constraint and test set."""

from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, field, replace
from typing import Any

from dualwinch.model.errors import ConfigurationError

TRIALS = 1000
"""Trials of a search without a budget, or more if its gains need more (`SelectionConfig.trials_needed`)."""

SCENARIOS = 12
"""Default number of training scenarios."""


def default_method(objectives: int) -> str:
    """The default method for a number of objectives."""
    return "hybrid" if objectives == 1 else "nsga2"


@dataclass(frozen=True)
class SampleSizes:
    """Numbers of candidates and scenarios in validation, chance constraint and test.

    Attributes:
        candidates: per group that is evaluated on the validation set.
        screening_rollouts: number of rollouts after which no further group is evaluated there.
        draws, vertices: of the ensemble, in the validation set.
        chance: fresh draws per candidate in the chance constraint; the default is
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
        """Estimated number of rollouts of all these sets, the start's and the paper's included."""
        screening = max(self.screening_rollouts, self.candidates * (self.draws + self.vertices)) // 2
        return screening + 2 * (self.draws + self.vertices + self.chance) + 3 * self.test

    @property
    def surveys(self) -> int:
        """Estimated number of computations of a controller's stability margins on all machines of a set."""
        return self.candidates + (self.candidates > 0) + 3

    @property
    def after_validation(self) -> "SampleSizes":
        """The sizes of chance constraint and test set only."""
        return replace(self, candidates=0, screening_rollouts=0, draws=0, vertices=0)

    def scaled(self, share: float, least: "SampleSizes") -> "SampleSizes":
        """A share of all sizes, each at least that of `least` or, if smaller, its own."""
        sizes = zip(astuple(self), astuple(least), strict=True)
        return SampleSizes(*(max(round(share * size), min(size, lowest)) for size, lowest in sizes))


@dataclass(frozen=True)
class SelectionConfig:
    """Hyper-parameters of the tuning method, which `tuning.scoring.selection` describes.

    Violations, back-offs and shares without another reference are relative to a bound.

    Attributes:
        hard_training: number of hard training scenarios besides those in which every candidate is run.
        demand_among: number of draws from which the hard ones are selected.
        largest_lag: largest distance in m by which the vehicle may fall behind in hard draws for lack of force.
        share_vertices: of the hard training scenarios.
        margin_machines, margin_machines_swinging, margin_machines_validated: number of drawn machines on which
            stability margins are computed in training (the start's margins are smallest there), more where drums swing
            on their ropes, as the worst machine depends on the gains there; and in validation and test.
        margin_machines_active: number of machines, besides one, whose margins are computed for all candidates: as many
            pairs of a machine and an amplitude, those with the least margins so far.
        margin_machines_screened: number of machines in the second stage of their selection; the first compares the
            start's margins only at the points where the nominal machine's are smallest.
        margin_amplitudes, margin_amplitudes_swinging: amplitudes of the speed error in m/s at which margins are
            computed, besides that of the speed sensor's noise; the latter where drums swing on their ropes.
        loop_range: largest ratio of a loop's margin to the least of its machine and amplitude; larger ones are clipped
            to it when active loops are determined.
        back_off: distance from bounds on the worst case, kept in training and by a repair, because more scenarios have
            worse cases.
        pool_size: number of active scenarios for the best candidates of a batch.
        pool_memory: weight of a scenario's earlier violations in exponential smoothing.
        pool_range: violations are clipped to this range before smoothing.
        pool_review: number of batches after which the leader is run in all hard scenarios.
        first_share: of the common scenarios, in which all candidates of a batch are run (the first rung).
        eta: η of successive halving: one in η candidates of a rung is run in the scenarios of the next.
        prune_above: candidates are pruned in the first rung if the batch is larger.
        most_leaders: largest number of candidates of a batch that are run in the active scenarios, the last rung.
        hopeless: violation above which a candidate is run in no further scenarios.
        max_slack: share of a run with a slack rope above which the run is stopped, if no rope may be slack.
        penalty: of the exact penalty: added to the logarithm of the objective for a violation of 1. A violation of 2 %
            costs a factor of e; an optimum on its bounds gains only a few times the violation, far less.
        first_screened: number of validation scenarios in the first round of a candidate's evaluation.
        repair_most: violation above which a peak is not attributed to the reserve.
        repair_steps: shares of the wanted change of the reserve in the line search; the first feasible one is taken.
        violation: ε, the largest probability that a draw violates a bound.
        confidence: 1 − β, of the chance constraint and of the intervals of the test set.
        chance_candidates: K, the largest number of candidates in the chance constraint.
        sizes, least_sizes: of validation, chance constraint and test, and the smallest if time is short.
        size_steps: number of shares of `sizes` that are considered.
        time_share, time_more: a study with a time T for its search ends within (1 + share) T + more, in s; compilation
            comes on top.
        judging_share, judging_more: share of T, and time in s, that the search leaves for validation and test if
            preparation took long.
        time_caution: share added to the estimated duration of validation and test.
        trials_per_gain: number of trials per gain below which a search is called short: CMA-ES needs about 100 to learn
            the covariance (Hansen, arXiv:1604.00772); with fewer its best is mostly luck.
    """

    hard_training: int = 48
    demand_among: int = 600
    largest_lag: float = 0.01
    share_vertices: float = 1 / 6
    margin_machines: int = 2
    margin_machines_swinging: int = 8
    margin_machines_active: int = 2
    margin_machines_validated: int = 16
    margin_machines_screened: int = 16
    margin_amplitudes: tuple[float, ...] = (0.01, 0.1)
    margin_amplitudes_swinging: tuple[float, ...] = (0.01,)
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
    max_slack: float = 0.01
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
        """Raise `ConfigurationError` for an invalid probability."""
        for name, value in (("violation", self.violation), ("confidence", self.confidence)):
            if not 0 < value < 1:
                raise ConfigurationError(f"{name} = {value:g}: must be > 0 and < 1, i.e. between 0 and 100 %")

    def trials_needed(self, gains: int) -> int:
        """Number of trials that a search for a number of gains needs."""
        return self.trials_per_gain * gains

    def time_of_all(self, search: float) -> float:
        """Time limit in s of a study, without compilation, whose search may take `search` seconds."""
        return (1 + self.time_share) * search + self.time_more

    def time_of_search(self, search: float, left: float, pace: float = 0.0, margin_pace: float = 0.0) -> float:
        """Time in s for the search after preparation, at least a share of the requested time, `search`.

        `left` is the time in s for search, validation and test; `pace` that of a rollout, and `margin_pace` that of the
        stability margins of a controller on a machine.
        """
        least = self._time_of(self.least_sizes, pace, margin_pace)
        judging = max(self.judging_share * search + self.judging_more, least)
        return max(min(search, left - judging), self.judging_share * search)

    def _time_of(self, sizes: SampleSizes, pace: float, margin_pace: float) -> float:
        """Estimated time in s of validation and test, with `time_caution`; paces as in `time_of_search`."""
        machines = 1 + self.margin_machines_validated
        return (1 + self.time_caution) * (pace * sizes.rollouts + margin_pace * machines * sizes.surveys)

    def affordable(self, sizes: SampleSizes, seconds: float, pace: float, margin_pace: float = 0.0) -> SampleSizes:
        """The largest share of given sizes whose rollouts and stability margins take at most a time in s.

        Paces are those so far, as in `time_of_search`.
        """
        for step in range(self.size_steps, -1, -1):
            scaled = sizes.scaled(step / self.size_steps, self.least_sizes)
            if self._time_of(scaled, pace, margin_pace) <= seconds:
                return scaled
        return sizes.scaled(0.0, self.least_sizes)

    def to_record(self) -> dict[str, Any]:
        """As a dictionary for JSON."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "SelectionConfig":
        """The configuration of a record from `to_record`."""
        plain: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in record.items()
        }
        for name in ("sizes", "least_sizes"):
            plain[name] = SampleSizes(**record[name])
        return cls(**plain)
