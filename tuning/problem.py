"""A tuning problem: what varies, in which scenarios, what is minimised and what must be kept to."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.unfiltered import Unfiltered
from dualwinch.model.description import describe_parts
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.tree import with_leaves
from dualwinch.simulation.batch.rollout import NOT_RUN, BatchResult, rollout
from dualwinch.simulation.check import check
from dualwinch.simulation.ensembles.ensemble import Ensemble, Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.constraint import Constraint, constraints_from
from dualwinch.tuning.objective import objectives_from
from dualwinch.tuning.scoring.scenarios import PROMISED, Pick, corners, pick, promised
from dualwinch.tuning.scoring.statistic import Statistic, statistic_from
from dualwinch.tuning.space import Interval, Point, Space

SELECTION, HELD_OUT = 1_000_000, 2_000_000
"""Added to a study's seed: scenarios among which the best is chosen, and those that score it; never tuned on."""

LIMITS = "controller.coordination."
"""Gains that have to fit together."""

MARGIN = 0.01
"""Distance that what is the worst keeps from its bound in the few scenarios of tuning, as a share: others are worse."""

STRESS = 16
"""Number of the scenarios in which only the best candidates are tried."""

REPORTED = (
    "mean.mse",
    "mean.chatter",
    "worst.peak_tension",
    "worst.min_tension",
    "mean.slack_share",
    "mean.saturated_share",
    "mean.continuous_load",
)
"""Statistics kept of every candidate, beside objectives and constraints."""


@dataclass(frozen=True)
class Problem:
    """A tuning problem.

    Attributes:
        experiment: structure and values of everything that is not tuned; its gains are where the search starts.
        ensemble: what scenarios are drawn from; ``None``: the experiment is the only one.
        space: what varies.
        objectives: names of statistics to minimise.
        constraints: texts, as in `tuning.constraint`.
        scenarios: number of scenarios a candidate is tuned on.
        seed: of the tuning scenarios.
    """

    experiment: Experiment
    ensemble: Ensemble | None
    space: Space
    objectives: tuple[str, ...]
    constraints: tuple[str, ...]
    scenarios: int
    seed: int

    def check(self) -> None:
        """Find out now whether the start makes sense.

        Raises:
            ConfigurationError: values that do not fit together, a start outside of the bounds, or bounds that do
                not fit together.
        """
        check(self.experiment)
        for dimension in self.space.dimensions:
            start = self.start[dimension.name]
            if not dimension.holds(start):
                keys = " and ".join(dimension.keys)
                shown = start if isinstance(start, str) else f"{start:g}"
                raise ConfigurationError(
                    f"infeasible start: {keys} = {shown} is outside of the space, {dimension.allowed}; "
                    "widen the bounds, or start elsewhere with --set"
                )
        limits = [one for one in self.space.dimensions if one.name.startswith(LIMITS) and isinstance(one, Interval)]
        for ends in product(*((one.lower, one.upper) for one in limits)):
            settings = self.space.settings(self.start | {one.name: end for one, end in zip(limits, ends, strict=True)})
            try:
                check(with_leaves(self.experiment, settings))
            except ConfigurationError as error:
                raise ConfigurationError(f"space: bounds that do not go together: {error}") from error

    @property
    def start(self) -> Point:
        """The experiment's own gains."""
        return self.space.start(self.experiment)

    @property
    def paper_point(self) -> Point:
        """The paper's gains, as near as the space allows."""
        defaults = {key: leaf.default for key, leaf in describe_parts(self.experiment).items() if leaf.tunable}
        known = {key: value for key, value in defaults.items() if value is not None}
        return self.space.nearest(self.space.start(with_leaves(self.experiment, known)))

    @cached_property
    def paper_experiment(self) -> Experiment:
        """The experiment with the paper's controller and gains: no estimator, differential tension."""
        ours = self.experiment.controller
        theirs = Controller(law=type(ours.law)(), estimator=Unfiltered(), nominal=ours.nominal)
        return replace(self.experiment, controller=theirs)

    def tuned(self, point: Point) -> Experiment:
        """The experiment with a candidate's gains."""
        return with_leaves(self.experiment, self.space.settings(point))

    @cached_property
    def minimised(self) -> tuple[Statistic, ...]:
        """The objectives."""
        return objectives_from(self.objectives)

    @cached_property
    def bounded(self) -> tuple[Constraint, ...]:
        """The constraints; one relative to the paper's gains costs a rollout of those."""
        return constraints_from(self.constraints, self.experiment, self._paper_value)

    def margin(self, constraint: Constraint) -> float:
        """Distance that a constraint has to keep from its bound in tuning, as a share of the bound."""
        return MARGIN if self.ensemble and constraint.statistic.kind == "worst" else 0.0

    @cached_property
    def reported(self) -> tuple[Statistic, ...]:
        """Every statistic that is kept of a candidate, without repetition."""
        used = (*self.minimised, *(one.statistic for one in self.bounded))
        return tuple(dict.fromkeys((*used, *map(statistic_from, REPORTED))))

    def _scenarios(self, picks: Sequence[Pick], experiment: Experiment) -> tuple[Experiment | Scenario, ...]:
        if self.ensemble is None:
            return (experiment,)
        ensemble = replace(self.ensemble, experiment=experiment)
        return tuple(one.drawn(ensemble, self.seed) for one in picks)

    @cached_property
    def _picks(self) -> tuple[list[Pick], list[Pick]]:
        """Which scenarios candidates are tuned in, and in which further ones the best of them."""
        if self.ensemble is None:
            return [], []
        ensemble = replace(self.ensemble, experiment=self.experiment)
        return pick(ensemble, self.scenarios, STRESS, self.seed)

    def chosen_in(
        self, first: int, last: int, count: int, seed: int
    ) -> tuple[list[Experiment | Scenario], list[Experiment | Scenario]]:
        """Scenarios to choose among finalists in (`promised` there): two rounds; the experiment without any.

        Args:
            first: number of draws in the first round.
            last: number of draws in the last one.
            count: how many corners come to the first.
            seed: of the draws.
        """
        if self.ensemble is None:
            return [self.experiment], [self.experiment]
        ensemble = replace(self.ensemble, experiment=self.experiment)
        picks = corners(ensemble, count, seed, PROMISED)
        draws = list(ensemble.scenarios(first + last, seed))
        return (
            [*promised(draws[:first]), *(one.drawn(ensemble, seed) for one in picks)],
            [*promised(draws[first:])],
        )

    def drawn(self, count: int, seed: int, experiment: Experiment | None = None) -> tuple[Experiment | Scenario, ...]:
        """Scenarios of the ensemble as it is, or the experiment alone.

        Args:
            count: how many.
            seed: of the draws.
            experiment: other nominal values than the problem's, such as those of the paper's gains.
        """
        nominal = experiment or self.experiment
        if self.ensemble is None:
            return (nominal,)
        return tuple(replace(self.ensemble, experiment=nominal).scenarios(count, seed))

    @cached_property
    def tuning_scenarios(self) -> tuple[Experiment | Scenario, ...]:
        """What every candidate is tried in, the same for all: draws and corners of the ensemble, or the experiment."""
        return self._scenarios(self._picks[0], self.experiment)

    @cached_property
    def stress_scenarios(self) -> tuple[Experiment | Scenario, ...]:
        """Further corners of the ensemble, where the best of the candidates have to hold; none without an ensemble."""
        return self._scenarios(self._picks[1], self.experiment) if self.ensemble else ()

    @cached_property
    def paper_result(self) -> BatchResult:
        """The paper's gains in the tuning scenarios."""
        return run_pairs([], [[]], self._scenarios(self._picks[0], self.paper_experiment))

    def _paper_value(self, statistic: Statistic) -> float:
        return over(statistic, self.paper_result, 0, self.tuning_scenarios)


def counts(statistic: Statistic, scenario: Experiment | Scenario) -> bool:
    """Whether a scenario counts in a statistic: a corner of the ensemble does in what is the worst only."""
    return statistic.kind == "worst" or not (isinstance(scenario, Scenario) and scenario.extreme)


def over(statistic: Statistic, result: BatchResult, row: int, scenarios: Sequence[Experiment | Scenario]) -> float:
    """A statistic of a row of a result, over the scenarios that count and ran to their end."""
    counted = [counts(statistic, one) for one in scenarios]
    return statistic.over(result.metrics[statistic.metric][row, (result.outcomes[row] == "completed") & counted])


def run_pairs(
    keys: Sequence[str],
    parameters: Sequence[Sequence[float]],
    scenarios: Sequence[Experiment | Scenario],
    threads: int | None = None,
) -> BatchResult:
    """`rollout`, but an interrupt is raised, for half a batch is of no use here.

    Raises:
        KeyboardInterrupt: it was interrupted.
    """
    result = rollout(keys, parameters, scenarios, threads=threads)
    if (result.outcomes == NOT_RUN).any():
        raise KeyboardInterrupt
    return result
