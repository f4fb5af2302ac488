"""Compare controllers in the same scenarios: paired statistics with bootstrap confidence intervals."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.controller import Controller
from dualwinch.model.arguments import instance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.figures import FigureColumn, Figures, FigureTable, Sentence, measured
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.authority import LeastErrors, infeasible_words, least_errors
from dualwinch.simulation.batch.workers import Workers
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import SUMMARY, EnsembleResult, Statistic
from dualwinch.simulation.ensembles.run import run_side_by_side
from dualwinch.simulation.metrics.metrics import in_words, metric_quantities
from dualwinch.simulation.plots.page import GivenAxes, new_page
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    PURPLE,
    SKY,
    VERMILION,
    WINE,
    logarithmic,
    looks,
    plain,
)
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.progress import Progress, no_progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
"""Confidence level of intervals."""

METHOD = "percentile bootstrap, scenarios resampled in pairs"
"""Method of the intervals, in words."""

RESAMPLES = 4000
"""Bootstrap samples per interval."""

AT_ONCE = 2**18
"""Numbers resampled at a time, which bounds the memory."""

COMPARED = ("mse", "mae", "max_abs_error", "chatter", "continuous_load", "peak_tension", "energy")
"""Figures of merit with ratios: all are positive, and smaller is better."""


@dataclass(frozen=True)
class Interval:
    """An estimate with its confidence interval, a percentile bootstrap over the scenarios at level `CONFIDENCE`."""

    estimate: float
    low: float
    high: float

    def __str__(self) -> str:
        estimate, low, high = (measured(value, ".3g") for value in (self.estimate, self.low, self.high))
        return "–" if estimate == "–" else f"{estimate} ({low}–{high})"


@dataclass(frozen=True)
class Paired:
    """A figure of merit of a controller relative to the first controller, over the scenarios that both completed.

    Attributes:
        pairs: number of these scenarios.
        ratio_of_means: ratio of the means.
        median_ratio: median of the ratios of the scenarios.
        better: share of the scenarios in which it is smaller than that of the first.
    """

    pairs: int
    ratio_of_means: Interval
    median_ratio: Interval
    better: float


@dataclass(frozen=True, repr=False)
class Comparison:
    """Controllers in the same scenarios.

    Attributes:
        ensemble: ensemble of the scenarios.
        contenders: controller → its result; the others are compared with the first.
    """

    ensemble: Ensemble
    contenders: dict[str, EnsembleResult]

    @property
    def first(self) -> EnsembleResult:
        """Result of the first controller, the baseline of the comparison."""
        return next(iter(self.contenders.values()))

    @property
    def seed(self) -> int:
        """Seed of the draws, and of the resampling."""
        return self.first.seed

    @property
    def asked(self) -> int:
        """Number of scenarios requested; fewer were run if interrupted."""
        return self.first.asked

    def __len__(self) -> int:
        """Number of scenarios run by every controller."""
        return len(self.first)

    def __repr__(self) -> str:
        """A line for each controller."""
        lines = [f"Comparison in {len(self)} scenarios of '{self.ensemble.name}', seed {self.seed}:"]
        reference = next(iter(self.contenders))
        for name, contender in self.contenders.items():
            names = ("mean.mse", "mean.chatter", "worst.peak_tension")
            mse, chatter, peak = (contender.statistic(statistic) for statistic in names)
            words = f"mean MSE {mse:.3g} m², chatter {chatter:.3g} N, largest tension {peak:.0f} N"
            if name != reference:
                words += f"; {self.paired(name)['mse'].ratio_of_means.estimate:.3g} times the MSE of {reference}"
            lines.append(f"  {name}: {words}")
        return "\n".join(lines)

    def statistics_table(self, labels: Mapping[str, str] | None = None) -> FigureTable:
        """Statistics, scenarios with slack and outcomes, a row per controller, whose label may be another name."""
        merits = metric_quantities(self.ensemble.experiment.metrics)
        statistics = SUMMARY | {f"mean_{name}": f"mean.{name}" for name in self.first.own}
        words = {"p95": "95 %"}
        columns = [FigureColumn("name", "")]
        for name, statistic in statistics.items():
            kind, _, metric = statistic.partition(".")
            merit = merits[metric]
            columns.append(merit.column(name, f"{merit.label}, {words.get(kind, kind)}", ".4g"))
            if name == "mean_mse":
                heading = f"{merit.label}, feasible scenarios"
                columns.append(merit.column("mean_mse_within_authority", heading, ".4g"))
        columns.append(FigureColumn("slack_scenarios", heading="scenarios with slack"))
        outcomes = dict.fromkeys(word for contender in self.contenders.values() for word in contender.outcome_counts)
        columns += [FigureColumn(word, heading=word.replace("_", " ")) for word in outcomes]
        rows = []
        for name, contender in self.contenders.items():
            values = {
                "name": (labels or {}).get(name, name),
                "mean_mse_within_authority": self.mean_mse_within_authority(name),
            }
            values |= contender.summary() | dict.fromkeys(outcomes, 0) | contender.outcome_counts
            rows.append([values[column.name] for column in columns])
        return FigureTable("statistics", columns, rows, layout="columns")

    def figures(self, labels: Mapping[str, str]) -> Figures:
        """Statistics, lower bounds on the error, and ratios to the first controller; `labels` are names in tables."""
        figures: list[FigureTable | Sentence] = [
            Sentence(f"{len(self)} scenarios of '{self.ensemble.name}', seed {self.seed}, the same for all")
        ]
        if self.partial:
            words = f"interrupted: {len(self)} of {self.asked} scenarios were finished by all and are kept"
            figures.append(Sentence(words))
        figures.append(self.statistics_table(labels))
        bounds = self.least_errors
        if bounds.infeasible:
            causal_bound, foresight_bound = (measured(1e6 * value, ".3g") for value in bounds.means)
            words = (
                f"{infeasible_words(bounds.infeasible)}. Lower bound on the mean MSE of all: {causal_bound} mm² for a "
                f"non-anticipating optimal controller, {foresight_bound} mm² with full foresight."
            )
            figures.append(Sentence(words))
        if bounds.unknown:
            figures.append(Sentence(bounds.unknown_words))
        if any(set(contender.outcome_counts) != {"completed"} for contender in self.contenders.values()):
            words = "Statistics are those of the completed scenarios, ratios those of scenarios completed by both."
            figures.append(Sentence(words))
        return [*figures, *self._ratios(labels)]

    def _ratios(self, labels: Mapping[str, str]) -> Figures:
        reference, *rivals = self.contenders
        if not rivals:
            return []
        pairs = {name: self.paired(name) for name in rivals}
        columns, rows = [FigureColumn("name", "")], [[labels[name]] for name in rivals]
        for metric in pairs[rivals[0]]:
            columns.append(FigureColumn(metric, heading=metric.replace("_", " ")))
            columns.append(FigureColumn("better", heading="  smaller in", factor=100, shown_unit="%"))
            for row, pair in zip(rows, pairs.values(), strict=True):
                row += [str(pair[metric].ratio_of_means), pair[metric].better]
        sentence = f"Means over those of {reference}, with {100 * CONFIDENCE:g} % intervals:"
        return [Sentence(sentence), FigureTable("ratios", columns, rows, layout="columns")]

    def to_record(self) -> dict[str, Any]:
        """The comparison as plain data."""
        reference, bounds = next(iter(self.contenders)), self.least_errors
        causal_bound, foresight_bound = bounds.means
        files = [
            {
                "name": name,
                **contender.summary(),
                "mean_mse_within_authority": self.mean_mse_within_authority(name),
                "over_first": {}
                if name == reference
                else {key: asdict(pair) for key, pair in self.paired(name).items()},
                "controller": {key: value for key, value in leaves(contender.controller).items() if value is not None},
            }
            for name, contender in self.contenders.items()
        ]
        return {
            "ensemble": self.ensemble.name,
            "seed": self.seed,
            "scenarios": len(self),
            "scenarios_asked": self.asked,
            "intervals": {"method": METHOD, "confidence": CONFIDENCE, "resamples": RESAMPLES, "seed": self.seed},
            "beyond_authority": {
                "scenarios": bounds.infeasible,
                "without_bound": bounds.unknown,
                "lower_bound_mean_mse": causal_bound,
                "lower_bound_mean_mse_with_foresight": foresight_bound,
            },
            "units": self.statistics_table().to_record()["units"] | {"lower_bound_mean_mse": "m^2", "over_first": "1"},
            "files": files,
        }

    def plot(self, *, ax: "Axes | Sequence[Axes] | None" = None) -> "Figure":
        """Plot distributions of error and chatter, and ratios of means.

        Args:
            ax: axes for error, chatter and ratios; default: a figure of its own.
        """
        return comparison(self, ax=ax)

    @property
    def partial(self) -> bool:
        """Whether the run was interrupted."""
        return self.first.partial

    @cached_property
    def least_errors(self) -> LeastErrors:
        """Lower bounds of the error in each scenario, for any controller."""
        return self.find_least_errors()

    def find_least_errors(self, progress: Progress = no_progress) -> LeastErrors:
        """Find `least_errors`, which may take minutes where many scenarios are infeasible."""
        scenarios = self.ensemble.scenarios(len(self), self.seed)
        bounds = least_errors([scenario.experiment for scenario in scenarios], progress)
        vars(self)["least_errors"] = bounds
        return bounds

    def mean_mse_within_authority(self, name: str) -> float:
        """Mean of a controller's MSE in m² over the completed scenarios within the actuators' authority.

        NaN without any.
        """
        contender = self.contenders[name]
        values = contender.metrics["mse"][contender.completed & (self.least_errors.without_foresight == 0)]
        return Statistic("mean", "mse").over(values)

    def paired(self, name: str) -> dict[str, Paired]:
        """Ratios of a controller's figures of merit to the first controller's.

        Returns:
            Name of `COMPARED` or of a user's metric → ratios; NaN if no scenario was completed by both.
        """
        reference, other = self.first, self.contenders[name]
        both = reference.completed & other.completed
        return {
            metric: paired_ratio(other.metrics[metric][both], reference.metrics[metric][both], self.seed)
            for metric in (*COMPARED, *reference.own)
        }


def paired_ratio(values: Floats, references: Floats, seed: int) -> Paired:
    """Ratios of paired positive values, with percentile-bootstrap intervals by resampling pairs with replacement.

    Values and references are those of the same scenarios, (pairs,); the same seed gives the same intervals.
    """
    from scipy.stats import bootstrap

    count = len(values)
    if not count:
        nothing = Interval(np.nan, np.nan, np.nan)
        return Paired(0, nothing, nothing, np.nan)

    def interval(statistic: Callable[..., Floats]) -> Interval:
        estimate = float(statistic(values, references))
        if count == 1:
            return Interval(estimate, estimate, estimate)
        resampled = bootstrap(
            (values, references),
            statistic,
            n_resamples=RESAMPLES,
            batch=max(1, AT_ONCE // count),
            paired=True,
            confidence_level=CONFIDENCE,
            method="percentile",
            rng=np.random.default_rng(seed),
        ).confidence_interval
        return Interval(estimate, float(resampled.low), float(resampled.high))

    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ratios that are all NaN
        return Paired(
            count,
            interval(lambda x, y, axis=-1: x.mean(axis) / y.mean(axis)),
            interval(lambda x, y, axis=-1: np.median(x / y, axis)),
            better=float((values < references).mean()),
        )


def compare(
    controllers: Mapping[str, Controller],
    ensemble: Ensemble,
    scenarios: int,
    seed: int,
    *,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> Comparison:
    """Run every controller in every scenario (common random numbers).

    A controller comprises its position law, gains, estimator, coordination and preload, and its nominal plant as far as
    `controller.nominal` sets it. Everything else comes from the ensemble: drawn plant, sea, sensors and their noise are
    the same numbers for all. Scenarios are drawn and run in portions, so that memory grows by only a hundred bytes per
    run.

    Args:
        controllers: name → controller; the others are compared with the first.
        ensemble: ensemble of the scenarios; its own controller is not used.
        scenarios: number of scenarios.
        seed: seed of the draws, and of the resampling.
        workers: number of workers on this machine, or an executor; default: one thread per core.
        progress: called from time to time with the completed fraction.

    Returns:
        The comparison. After an interrupt (Ctrl-C), it covers the scenarios that all controllers have finished.

    Raises:
        ConfigurationError: nothing to compare, a count or seed out of range, an ensemble that draws values of the
            controller, or a controller that does not fit the ensemble; the message names it.
        DualwinchError: no compiler or no usable cache folder.
        KeyboardInterrupt: before all controllers have finished a scenario.

    Example:
        >>> import dualwinch as dw
        >>> sea = dw.load_ensemble("sea", dw.override(dw.Experiment(), {"simulation.duration": 2.0}))
        >>> controllers = {kind: dw.case(2, kind).controller for kind in ("fando-nftsm", "pid-cascade")}
        >>> dw.compare(controllers, sea, scenarios=4, seed=0)
        Comparison in 4 scenarios of 'sea', seed 0:
          fando-nftsm: mean MSE 4.74e-07 m², chatter 50.5 N, largest tension 2699 N
          pid-cascade: mean MSE 0.000323 m², chatter 37.8 N, largest tension 3036 N; 681 times the MSE of fando-nftsm
    """
    instance("ensemble", ensemble, Ensemble, hint=" (load_ensemble reads one)")
    if not isinstance(controllers, Mapping):
        raise ConfigurationError(f"controllers: must be names and controllers, not {type(controllers).__name__}")
    if not controllers:
        raise ConfigurationError("controllers: must be at least one")
    ensembles = [_with_controller(ensemble, name, controller) for name, controller in controllers.items()]
    results = run_side_by_side(ensembles, scenarios, seed, workers=workers, progress=progress)
    return Comparison(ensemble, dict(zip(controllers, results, strict=True)))


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


CONTROLLER_COLOURS = (GREY, BLUE, VERMILION, GREEN, PURPLE, GOLD, WINE, SKY)
"""Colours of controllers, the baseline first; reused with other dashes."""

PANELS = ("mse", "chatter")
"""Figures of merit whose distributions over the scenarios are shown."""


def comparison(result: Comparison, *, ax: GivenAxes = None) -> "Figure":
    """Cumulative distributions of error and chatter, and ratios to the first controller with confidence intervals.

    Panels: error, chatter, ratios.
    """
    styles = looks(result.contenders, CONTROLLER_COLOURS)
    rivals = list(result.contenders)[1:]
    ratios_height = 0.5 + len(COMPARED) * (0.12 + 0.13 * len(rivals)) if rivals else 0.0
    words = f"{len(result)} scenarios of “{plain(result.ensemble.name)}”, seed {result.seed}, the same for all"
    rows, layout = [[*PANELS]], {}
    if rivals:
        rows, layout = [[*PANELS], ["ratios"] * len(PANELS)], {"height_ratios": (2.2, ratios_height)}
    with new_page(ax, 3.0 + ratios_height, "Controllers in the same scenarios", words) as page:
        panels = page.mosaic(rows, **layout)
        for axes, metric in zip(panels, PANELS, strict=False):
            quantity = metric_quantities()[metric]
            for name, contender in result.contenders.items():
                values = np.sort(quantity.scale * contender.of_completed(metric))
                shares = np.arange(1, len(values) + 1) / len(values)
                axes.step(values, shares, where="post", **styles[name], label=plain(name))
            logarithmic(axes, (1, 2, 5))
            axes.set(ylim=(0, 1), title=in_words(metric), xlabel=quantity.axis)
        panels[0].set_ylabel("share of scenarios")
        for axes in panels[len(PANELS) :]:
            _ratios(axes, result, styles)
        page.legend()
    return page.figure


def _ratios(axes: "Axes", result: Comparison, styles: Mapping[str, dict[str, Any]]) -> None:
    reference, *rivals = result.contenders
    for index, name in enumerate(rivals):
        offset, colour = 0.6 * (index + 0.5) / len(rivals) - 0.3, styles[name]["color"]
        for row, pair in enumerate(result.paired(name).values()):
            ratio = pair.ratio_of_means
            axes.plot((ratio.low, ratio.high), (row + offset,) * 2, color=colour, linewidth=2.2, alpha=0.55)
            axes.plot(ratio.estimate, row + offset, "o", color=colour, markersize=4)
    axes.axvline(1, color=GREY, linewidth=0.8, zorder=1)
    logarithmic(axes, (1, 2, 5))
    axes.set_yticks(range(len(COMPARED)), [name.replace("_", " ") for name in COMPARED])
    axes.set(
        ylim=(len(COMPARED) - 0.5, -0.5),
        xlabel=f"over {plain(reference)}; smaller is better",
        title=f"ratio of means with {100 * CONFIDENCE:g} % interval",
    )
