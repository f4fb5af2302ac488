"""A tuning problem: search space, scenarios, objectives and constraints.

It is data only; `tuning.scoring.training_set` prepares it for evaluation.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import product

from dualwinch.codegen.text import enumeration
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves, rules, with_leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import Statistic, statistic_from
from dualwinch.simulation.exogenous.signals import named_seed
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.baseline import swings
from dualwinch.tuning.constraints import Constraint, MarginStatistic
from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.space import ContinuousDimension, Point, Space

TRAINING, CHECKS, CERTIFICATE, TEST, SEARCH, DESIGN = "training", "checks", "certificate", "test", "search", "design"
"""Names of a study's random streams; no two share a draw, for any seed (`TuningProblem.stream`)."""

STEADY_PREFIX = "steady_"
"""Prefix of the names of steady-state metrics."""

AMPLITUDES = (0.01, 0.1)
"""Amplitudes of the speed error in m/s of margins, besides the sensor's noise; the first alone where drums swing."""

AS_DESCRIBED, DESIGNED = "as it was before tuning", "designed for this machine"
"""Controllers that a search starts from, in words (`TuningProblem.start_words`)."""

REPORTED = (
    "mean.mse",
    "mean.chatter",
    "worst.peak_tension",
    "worst.min_tension",
    "mean.slack_share",
    "mean.saturated_share",
    "mean.continuous_load",
)
"""Statistics kept for every candidate, besides objectives, constraints and means of the experiment's own metrics."""


@dataclass(frozen=True)
class TuningProblem:
    """A tuning problem.

    Attributes:
        experiment: structure, and values of everything that is not tuned; its gains are the start of the search.
        ensemble: distribution of the scenarios; ``None``: the experiment is the only one.
        space: the gains to tune, with their bounds.
        objectives: statistics to minimise.
        constraints: on candidates; a bound may be a factor on the value with the paper's controller.
        scenarios: number of training scenarios in which every candidate is run.
        seed: of all random streams (`stream`).
        options: parameters of the method.
        choices: the defaults chosen for this problem, each with its reason, in words.
        starts: controllers of the same parts, from whose gains the search may begin as well; the better begins
            (`tuning.scoring.starts`).
        fixed: keys whose values a design of the start keeps (`analysis.design`); the designed controller is one more
            start then. ``None``: no design.
        design: the one of `starts` that is designed for the machine; ``None``: none is.
        start_words: which controller the search starts from, in words.
    """

    experiment: Experiment
    ensemble: Ensemble | None
    space: Space
    objectives: tuple[Statistic, ...]
    constraints: tuple[Constraint, ...]
    scenarios: int
    seed: int
    options: TuningOptions = field(default_factory=TuningOptions)
    choices: tuple[str, ...] = field(default=(), compare=False)
    starts: tuple[Controller, ...] = ()
    fixed: tuple[str, ...] | None = field(default=None, compare=False)
    design: Controller | None = field(default=None, compare=False)
    start_words: str = field(default=AS_DESCRIBED, compare=False)

    def stream(self, name: str) -> int:
        """The seed of a named random stream: `TRAINING` to `SEARCH`, possibly with a number."""
        return named_seed(self.seed, name)

    def check(self) -> None:
        """Check the start and the bounds.

        Raises:
            ConfigurationError: inconsistent values, a metric that no run has, a start outside the bounds, or
                inconsistent bounds.
        """
        prepare(self.experiment)
        begin, end = self.experiment.steady_window
        if begin >= min(end, self.experiment.duration):
            for statistic in (*self.objectives, *(constraint.statistic for constraint in self.constraints)):
                if (
                    isinstance(statistic, Statistic)
                    and statistic.part is None
                    and statistic.metric.startswith(STEADY_PREFIX)
                ):
                    raise ConfigurationError(
                        f"{statistic.name}: no run has it: the steady state begins at {begin:g} s, simulation.duration "
                        f"is {self.experiment.duration:g} s; must be longer, or take mean.mse"
                    )
        for dimension in self.space.dimensions:
            start = self.start[dimension.name]
            if not dimension.holds(start):
                keys = " and ".join(dimension.keys)
                text = start if isinstance(start, str) else f"{start:g}"
                raise ConfigurationError(
                    f"infeasible start: {keys} = {text} is outside of the space, {dimension.allowed}; "
                    "widen the bounds, or start elsewhere with --set"
                )
        for point in self._limits():
            try:
                prepare(self.tuned(point))
            except ConfigurationError as error:
                raise ConfigurationError(f"space: inconsistent bounds: {error}") from error

    def _limits(self) -> Iterator[Point]:
        """The start with every combination of bounds of the gains that a rule relates."""
        bound = {table + field for table, _, rule in rules(self.experiment) for field in rule.fields}
        dimensions = [
            dimension
            for dimension in self.space.dimensions
            if isinstance(dimension, ContinuousDimension) and not bound.isdisjoint(dimension.keys)
        ]
        for ends in product(*((dimension.lower, dimension.upper) for dimension in dimensions)):
            yield self.start | {dimension.name: end for dimension, end in zip(dimensions, ends, strict=True)}

    @property
    def beginnings(self) -> tuple["TuningProblem", ...]:
        """The problem with each of its starts, the experiment's own first; gains are moved into the space."""
        problems = []
        for number, controller in enumerate(self.starts, 1):
            experiment = replace(self.experiment, controller=controller)
            point = self.space.nearest(self.space.start(leaves(experiment)))
            experiment = with_leaves(experiment, self.space.settings(point))
            ensemble = self.ensemble and replace(self.ensemble, experiment=experiment)
            words = DESIGNED if controller is self.design else f"number {number} of starts"
            problem = replace(self, experiment=experiment, ensemble=ensemble, start_words=words)
            problems.append(replace(problem, starts=(), fixed=None, design=None))
        return replace(self, starts=(), fixed=None, design=None), *problems

    @property
    def start(self) -> Point:
        """The experiment's own gains."""
        return self.space.start(leaves(self.experiment))

    @property
    def paper_experiment(self) -> Experiment:
        """The experiment with the paper's controller, whatever law is tuned."""
        return replace(self.experiment, controller=paper_controller(self.experiment.controller))

    @property
    def paper_point(self) -> Point | None:
        """The point of the space nearest to the paper's gains; ``None`` where another law is tuned."""
        if self.experiment.controller.law.kind != self.paper_experiment.controller.law.kind:
            return None
        return self.space.nearest(self.space.start(leaves(self.experiment) | leaves(self.paper_experiment)))

    def tuned(self, point: Point) -> Experiment:
        """The experiment with a candidate's gains."""
        return with_leaves(self.experiment, self.space.settings(point))

    @property
    def reported(self) -> tuple[Statistic, ...]:
        """Every statistic of runs that is kept for a candidate, without repetition."""
        bounded = (constraint.statistic for constraint in self.constraints)
        used = (*self.objectives, *(statistic for statistic in bounded if isinstance(statistic, Statistic)))
        metrics = [Statistic("mean", metric.table(), metric) for metric in self.experiment.metrics]
        return tuple(dict.fromkeys((*used, *map(statistic_from, REPORTED), *metrics)))

    @property
    def units(self) -> dict[str, str]:
        """Name of a reported statistic → its unit."""
        return {statistic.name: statistic.unit for statistic in (*self.reported, *self.margins)}

    @property
    def margins(self) -> tuple[MarginStatistic, ...]:
        """The bounded stability margins."""
        bounded = (constraint.statistic for constraint in self.constraints)
        return tuple(dict.fromkeys(statistic for statistic in bounded if isinstance(statistic, MarginStatistic)))

    @property
    def margin_amplitudes(self) -> tuple[float, ...]:
        """Amplitudes of the speed error in m/s at which margins are computed; 0: infinitely small."""
        amplitudes = AMPLITUDES[:1] if swings(self.experiment.plant) else AMPLITUDES
        return tuple(sorted({self.experiment.sensors.speed_noise, *amplitudes}))

    @property
    def bounds_loop_margins(self) -> bool:
        """Whether any margin but that of the drums' resonance, which needs no linearised loop, is bounded."""
        return any(not statistic.by_rule for statistic in self.margins)

    @property
    def margin_conditions(self) -> str:
        """At which speeds and amplitudes margins are computed, in words; empty if none depends on them."""
        if not self.bounds_loop_margins:
            return ""
        sizes = [f"{100 * amplitude:.3g}" for amplitude in self.margin_amplitudes]
        return (
            "margins are those at rest and at the reference's largest speed, for speed errors of "
            f"{enumeration(sizes)} cm/s"
        )

    @property
    def drawn_ensemble(self) -> Ensemble:
        """The ensemble with the experiment's gains.

        Raises:
            ConfigurationError: the problem has no ensemble.
        """
        if self.ensemble is None:
            raise ConfigurationError("ensemble: this problem has none; only an ensemble has draws")
        return replace(self.ensemble, experiment=self.experiment)

    def drawn(self, count: int, seed: int, experiment: Experiment | None = None) -> tuple[Experiment | Scenario, ...]:
        """Scenarios drawn from the ensemble, or the experiment alone.

        `experiment` has nominal values in place of the problem's, such as those with the paper's controller.
        """
        nominal = experiment or self.experiment
        if self.ensemble is None:
            return (nominal,)
        return tuple(replace(self.ensemble, experiment=nominal).scenarios(count, seed))
