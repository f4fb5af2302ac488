"""Controllers in the same scenarios of an ensemble: paired statistics, with confidence intervals on the differences."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.unfiltered import Unfiltered
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.analysis.authority import least_mse
from dualwinch.simulation.batch.rollout import BatchResult, in_portions, portion_size, rollout
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.metrics.metrics import BUILT_IN
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.results.outcomes import RunOutcomes, concatenated
from dualwinch.simulation.scenario import Scenario

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
"""Probability that an interval is to cover."""

RESAMPLES = 4000
"""Bootstrap samples behind an interval."""

PORTION = 2**18
"""Numbers drawn at a time, so that memory does not grow."""

COMPARED = ("mse", "mae", "max_abs_error", "chatter", "peak_tension", "energy")
"""Figures of merit whose ratios are given: all positive, small is good."""

SUMMARY = {
    "mean_mse": Statistic("mean", "mse"),
    "median_mse": Statistic("median", "mse"),
    "p95_mse": Statistic("p95", "mse"),
    "mean_chatter": Statistic("mean", "chatter"),
    "max_tension": Statistic("worst", "peak_tension"),
    "min_tension": Statistic("worst", "min_tension"),
    "slack_share": Statistic("mean", "slack_share"),
    "saturated_share": Statistic("mean", "saturated_share"),
}
"""What is said of a controller: name in tables and files → statistic."""


@dataclass(frozen=True)
class Interval:
    """An estimate with its confidence interval, a percentile bootstrap over the scenarios at level `CONFIDENCE`."""

    estimate: float
    low: float
    high: float


@dataclass(frozen=True)
class Paired:
    """A figure of merit of a controller over that of the first, in the scenarios that both ran to their end.

    Attributes:
        pairs: number of those scenarios.
        ratio_of_means: its mean over the mean of the first's.
        median_ratio: median of the scenarios' own ratios.
        better: share of the scenarios in which it is smaller than the first's.
    """

    pairs: int
    ratio_of_means: Interval
    median_ratio: Interval
    better: float


@dataclass(frozen=True, eq=False)
class Contender(RunOutcomes):
    """What a controller came to; arrays of outcomes are (scenarios,).

    Attributes:
        controller: its laws and gains.
    """

    controller: Controller

    def over(self, statistic: Statistic) -> float:
        """A statistic over the scenarios that ran to their end; NaN without any."""
        return statistic.over(self.of_completed(statistic.metric))

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the figures of merit that are none of the built-in ones."""
        return tuple(name for name in self.metrics if name not in BUILT_IN)

    def summary(self) -> dict[str, float | int | dict[str, int]]:
        """Statistics over the scenarios that ran to their end (a run that ended early measured something else).

        Returns:
            The names of `SUMMARY`, each in the unit of its figure of merit and NaN where no scenario ran to its end;
            likewise ``mean_*`` of the ensemble's own metrics;
            ``slack_scenarios``, the number of scenarios with any slack sample; ``outcomes``, counts of all scenarios.
        """
        statistics = SUMMARY | {f"mean_{name}": Statistic("mean", name) for name in self.own}
        found = {name: self.over(statistic) for name, statistic in statistics.items()}
        slack = self.of_completed("slack_share") > 0
        return found | {
            "slack_scenarios": int(slack.sum()),
            "outcomes": self.outcome_counts,
        }


@dataclass(frozen=True, repr=False)
class Comparison:
    """Controllers in the same scenarios.

    Attributes:
        ensemble: what the scenarios were drawn from.
        seed: of the draws, and of the resampling.
        asked: number of scenarios asked for; more than there are where the run was interrupted.
        contenders: name → what it came to, the first being what the others are compared with.
    """

    ensemble: Ensemble
    seed: int
    asked: int
    contenders: dict[str, Contender]

    def __len__(self) -> int:
        """Number of scenarios that every controller ran."""
        return len(next(iter(self.contenders.values())).outcomes)

    def __repr__(self) -> str:
        """A line for each controller."""
        lines = [f"Comparison in {len(self)} scenarios of '{self.ensemble.name}', seed {self.seed}:"]
        first = next(iter(self.contenders))
        for name, contender in self.contenders.items():
            peak = contender.over(Statistic("worst", "peak_tension"))
            mse, chatter = (contender.over(Statistic("mean", metric)) for metric in ("mse", "chatter"))
            words = f"mean MSE {mse:.3g} m², chatter {chatter:.3g} N, largest tension {peak:.0f} N"
            if name != first:
                words += f"; {self.paired(name)['mse'].ratio_of_means.estimate:.3g} times the MSE of {first}"
            lines.append(f"  {name}: {words}")
        return "\n".join(lines)

    @property
    def partial(self) -> bool:
        """Whether the run was interrupted."""
        return len(self) < self.asked

    @cached_property
    def least_mse(self) -> Floats:
        """(scenarios,) What no controller gets below that does not foresee them, in m² (`least_error`).

        0 in a scenario that asks for no more force than the motors can give.

        Raises:
            DualwinchError: the solver found no optimum.
        """
        scenarios = self.ensemble.scenarios(len(self), self.seed)
        return np.array([least_mse(scenario.experiment) for scenario in scenarios])

    @cached_property
    def least_mse_foreseeing(self) -> Floats:
        """(scenarios,) What no controller gets below that foresees all that is to come, in m²; 0 as in `least_mse`.

        Raises:
            DualwinchError: the solver found no optimum.
        """
        scenarios = self.ensemble.scenarios(len(self), self.seed)
        return np.array(
            [
                least_mse(scenario.experiment, anticipating=True) if blind else 0.0
                for scenario, blind in zip(scenarios, self.least_mse, strict=True)
            ]
        )

    def mean_mse_within_authority(self, name: str) -> float:
        """Mean of a controller's MSE in m² over the completed scenarios within the actuators' authority.

        NaN without any.
        """
        contender = self.contenders[name]
        values = contender.metrics["mse"][contender.completed & (self.least_mse == 0)]
        return Statistic("mean", "mse").over(values)

    def paired(self, name: str) -> dict[str, Paired]:
        """Ratios of a controller's figures of merit to the first controller's.

        Returns:
            Name of `COMPARED`, or of one of the ensemble's own metrics → ratios; NaN where no scenario was run to its
            end by both.
        """
        first, other = next(iter(self.contenders.values())), self.contenders[name]
        both = first.completed & other.completed
        return {
            metric: paired_ratio(other.metrics[metric][both], first.metrics[metric][both], self.seed)
            for metric in (*COMPARED, *first.own)
        }


def paired_ratio(values: Floats, references: Floats, seed: int) -> Paired:
    """How paired values compare, with percentile-bootstrap intervals: pairs are drawn anew, with replacement.

    Args:
        values: (pairs,) positive.
        references: (pairs,) positive, of the same scenarios.
        seed: of the resampling; the same seed gives the same intervals.
    """
    count = len(values)
    if not count:
        nothing = Interval(np.nan, np.nan, np.nan)
        return Paired(0, nothing, nothing, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = values / references
        drawn = np.empty((2, RESAMPLES))
        generator = np.random.default_rng(seed)
        portion = max(1, PORTION // count)
        for start in range(0, RESAMPLES, portion):
            end = min(start + portion, RESAMPLES)
            chosen = generator.integers(count, size=(end - start, count))
            drawn[0, start:end] = values[chosen].mean(axis=1) / references[chosen].mean(axis=1)
            drawn[1, start:end] = np.median(ratios[chosen], axis=1)
        estimates = values.mean() / references.mean(), np.median(ratios)
        tail = (1 - CONFIDENCE) / 2
        intervals = [
            Interval(float(estimate), *map(float, np.quantile(samples, (tail, 1 - tail))))
            for estimate, samples in zip(estimates, drawn, strict=True)
        ]
    return Paired(count, *intervals, better=float((values < references).mean()))


def paper_controller() -> Controller:
    """The paper's controller with the paper's gains: it sees the sensors as they are."""
    return Controller(estimator=Unfiltered())


def compare(
    controllers: Mapping[str, Controller],
    ensemble: Ensemble,
    scenarios: int,
    seed: int,
    *,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Run every controller in every scenario (common random numbers).

    A controller brings its position law, gains, estimator, coordination and preload, and what it believes of the
    plant where `controller.nominal` says so. All else comes from the ensemble: the drawn plant, sea, sensors and
    their noise are the same numbers for all. Scenarios are drawn and run in portions, so memory grows by a hundred
    bytes a run only.

    Args:
        controllers: name → controller; the first is what the others are compared with.
        ensemble: what the scenarios are drawn from; its own controller is not used.
        scenarios: how many.
        seed: of the draws, and of the resampling behind the intervals.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Returns:
        The comparison. An interrupt (Ctrl-C) keeps the portions that all controllers have finished.

    Raises:
        ConfigurationError: nothing to compare, a count or seed out of range, an ensemble that draws the controller's
            own values, or a controller that does not fit; the message names it.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: before the first portion was finished.
    """
    if not controllers:
        raise ConfigurationError("controllers: must be at least one")
    if scenarios < 1:
        raise ConfigurationError(f"scenarios = {scenarios}: must be a whole number >= 1")
    if seed < 0:
        raise ConfigurationError(f"seed = {seed}: must be a whole number >= 0")
    drawn = {name: _with_controller(ensemble, name, controller) for name, controller in controllers.items()}
    size, threads = portion_size(ensemble.experiment, threads)
    streams = [in_portions(variant.scenarios(scenarios, seed), size) for variant in drawn.values()]
    portions: list[dict[str, BatchResult]] = []
    done = 0
    try:
        for chosen in zip(*streams, strict=True):

            def report(share: float, before: int = done, count: int = len(chosen[0])) -> None:
                if progress:
                    progress((before + share * count) / scenarios)

            portions.append(_run_portion(dict(zip(drawn, chosen, strict=True)), threads, report))
            done += len(chosen[0])
    except KeyboardInterrupt:
        if not portions:
            raise
    contenders = {
        name: _gathered(controller, [part[name] for part in portions]) for name, controller in controllers.items()
    }
    return Comparison(ensemble, seed, scenarios, contenders)


def _run_portion(
    chosen: Mapping[str, list[Scenario]], threads: int, report: Callable[[float], None]
) -> dict[str, BatchResult]:
    """The next scenarios by every controller, or an interrupt: pairs need all of them."""
    results: dict[str, BatchResult] = {}
    for number, (name, scenarios) in enumerate(chosen.items()):

        def say(share: float, before: int = number) -> None:
            report((before + share) / len(chosen))

        results[name] = rollout([], np.empty((1, 0)), scenarios, threads=threads, progress=say)
        if results[name].interrupted:
            raise KeyboardInterrupt
    return results


def _with_controller(ensemble: Ensemble, name: str, controller: Controller) -> Ensemble:
    for key in ensemble.distributions:
        if key.startswith("controller."):
            raise ConfigurationError(
                f"{key}: is drawn in the ensemble '{ensemble.name}'; a comparison needs the controllers as they are"
            )
    experiment = replace(ensemble.experiment, controller=controller)
    try:
        prepare(experiment)
    except ConfigurationError as error:
        raise ConfigurationError(f"{name}: {error}") from error
    return replace(ensemble, experiment=experiment)


def _gathered(controller: Controller, parts: list[BatchResult]) -> Contender:
    runs = concatenated([part.take(0, axis=0) for part in parts])
    return Contender(runs.outcomes, runs.end_times, runs.metrics, controller)
