"""The result of an ensemble: outcomes, figures of merit, statistics such as ``mean.mse``, and files."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.files import write_whole
from dualwinch.controllers.controller import Controller
from dualwinch.model.arguments import suffix_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Quantity, unknown
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.metrics.metric import Metric, MetricQuantity
from dualwinch.simulation.metrics.metrics import BUILT_IN, in_words, metric_quantities
from dualwinch.simulation.plots.page import GivenAxes, new_page, steady_patch
from dualwinch.simulation.plots.style import (
    INK,
    aside,
    draw_limits,
    law_label,
    law_look,
    plain,
    prefixed_unit,
    tension_unit,
    zero_line,
)
from dualwinch.simulation.results.file_formats import FORMATS, MIXED, FileContent
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.simulation.settings import known_keys

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STATISTIC_KINDS = ("mean", "geomean", "median", "p95", "worst")
"""Kinds of statistics; ``geomean``: the exponential of the mean logarithm, 0 if a value is 0, NaN if one is negative;
``p95``: 95 % of the scenarios are no worse; ``worst``: the worst scenario."""


@dataclass(frozen=True)
class Statistic:
    """One statistic of one figure of merit.

    Attributes:
        kind: one of `STATISTIC_KINDS`.
        metric: name of the figure of merit.
        part: the user's metric, unless it is a built-in one.
    """

    kind: str
    metric: str
    part: Metric | None = None

    @property
    def name(self) -> str:
        """Its name, such as ``mean.mse``."""
        return f"{self.kind}.{self.metric}"

    @property
    def words(self) -> str:
        """Its label, such as ``mean MSE``."""
        return in_words(self.name)

    @property
    def quantity(self) -> MetricQuantity:
        """Metadata of the figure of merit."""
        return metric_quantities([self.part] if self.part else [])[self.metric]

    @property
    def unit(self) -> str:
        """Unit of the figure of merit."""
        return self.quantity.unit

    @property
    def small_is_bad(self) -> bool:
        """Whether small values of the figure of merit are bad."""
        return self.quantity.small_is_bad

    def over(self, values: NDArray[np.float64]) -> float:
        """The statistic over values (n,) of the figure of merit, ignoring values that are not finite; NaN without any.

        Pass values of completed scenarios only, as values of runs that ended early are not comparable.
        """
        values = values[np.isfinite(values)]
        if not len(values):
            return np.nan
        match self.kind:
            case "mean":
                return float(values.mean())
            case "geomean":
                with np.errstate(divide="ignore", invalid="ignore"):
                    return float(np.exp(np.log(values).mean()))
            case "median":
                return float(np.median(values))
            case "p95":
                return float(np.quantile(values, 0.05 if self.small_is_bad else 0.95))
            case _:
                return float(values.min() if self.small_is_bad else values.max())


def statistic_from(text: str, own: Sequence[Metric] = ()) -> Statistic:
    """Parse the name of a statistic; a figure of merit, also one of the experiment's `own` ones, alone means its mean.

    Raises:
        ConfigurationError: an unknown statistic or figure of merit.
    """
    kind, dot, metric = text.strip().rpartition(".")
    if not dot:
        kind = "mean"
    if kind not in STATISTIC_KINDS:
        raise ConfigurationError(f"'{text.strip()}': {unknown('statistic', kind, STATISTIC_KINDS)}")
    parts = {part.table(): part for part in own}
    names = (*BUILT_IN, *parts)
    if metric not in names:
        raise ConfigurationError(f"'{text.strip()}': {unknown('metric', metric, names)}")
    return Statistic(kind, metric, parts.get(metric))


@dataclass(frozen=True)
class Traces:
    """Signals of the completed scenarios at the same instants.

    Attributes:
        t: (points,) time in s.
        sampled: column → (scenarios, points) float32, of the first scenarios up to a fixed number: an unbiased sample,
            as scenarios are independent.
        lowest, highest: column → (points,) float32, over all scenarios.
    """

    t: NDArray[np.float64]
    sampled: dict[str, NDArray[np.float32]]
    lowest: dict[str, NDArray[np.float32]]
    highest: dict[str, NDArray[np.float32]]

    def quantiles(self, column: str, shares: tuple[float, ...]) -> NDArray[np.float64]:
        """(shares, points) quantiles of a column over the sampled scenarios, at each instant."""
        return np.quantile(self.sampled[column].astype(float), shares, axis=0)


SUMMARY = {
    "mean_mse": "mean.mse",
    "median_mse": "median.mse",
    "p95_mse": "p95.mse",
    "mean_chatter": "mean.chatter",
    "mean_continuous_load": "mean.continuous_load",
    "max_tension": "worst.peak_tension",
    "min_tension": "worst.min_tension",
    "slack_share": "mean.slack_share",
    "saturated_share": "mean.saturated_share",
}
"""Summary statistics of a controller: name in tables and files → statistic."""


@dataclass(frozen=True, eq=False, repr=False)
class EnsembleResult(RunOutcomes):
    """Results of the scenarios of an ensemble; arrays of outcomes are (scenarios,).

    Attributes:
        ensemble: ensemble of the scenarios.
        seed: seed of the draws.
        asked: number of scenarios requested; fewer were run if interrupted.
        draws: key → (scenarios,) drawn values.
        traces: signals of the completed scenarios; ``None`` if none were kept or none completed.
    """

    ensemble: Ensemble
    seed: int
    asked: int
    draws: dict[str, NDArray[Any]]
    traces: Traces | None

    def __len__(self) -> int:
        """Number of scenarios run."""
        return len(self.outcomes)

    def __repr__(self) -> str:
        ends = ", ".join(f"{count} {word}" for word, count in self.outcome_counts.items())
        texts = []
        for name in ("mean.mse", "worst.max_abs_error", "worst.peak_tension"):
            statistic = statistic_from(name)
            value = statistic.quantity.text(self.statistic(name))
            texts.append(f"{name} = {value} {statistic.quantity.shown_unit}")
        count_text = f"{len(self)} of {self.asked}" if self.partial else str(len(self))
        about = f"{self.ensemble.name}: {count_text} scenarios of seed {self.seed}"
        return f"{type(self).__name__}({'; '.join([about, ends, ', '.join(texts)])})"

    @property
    def partial(self) -> bool:
        """Whether the run was interrupted; the result covers ``len(self)`` scenarios."""
        return len(self) < self.asked

    def statistic(self, name: str) -> float:
        """A statistic by name, such as ``worst.mse``, over the completed scenarios; NaN without any.

        Values of runs that ended early are not comparable: they are counted in `outcome_counts` and left out here.

        Raises:
            ConfigurationError: an unknown statistic or figure of merit.
        """
        statistic = statistic_from(name, self.ensemble.experiment.metrics)
        return statistic.over(self.of_completed(statistic.metric))

    @property
    def statistics(self) -> dict[str, dict[str, float]]:
        """Figure of merit → kind of statistic (`STATISTIC_KINDS`) → value."""
        return {
            metric: {kind: self.statistic(f"{kind}.{metric}") for kind in STATISTIC_KINDS} for metric in self.metrics
        }

    def plot(self, *, ax: "Axes | Sequence[Axes] | None" = None) -> "Figure":
        """Plot errors and tensions of the scenarios over time, as a fan chart.

        Args:
            ax: axes for the error and for the tensions of rope 1 and rope 2; default: a figure of its own.

        Raises:
            ConfigurationError: no traces were kept (``traces=True``), or no scenario completed.
        """
        return fan_chart(self, ax=ax)

    @property
    def controller(self) -> Controller:
        """Laws and gains of all scenarios."""
        return self.ensemble.experiment.controller

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the user-defined figures of merit."""
        return tuple(name for name in self.metrics if name not in BUILT_IN)

    def summary(self) -> dict[str, float | int | dict[str, int]]:
        """Summary statistics over the completed scenarios.

        Returns:
            The statistics of `SUMMARY` by name, each in the unit of its figure of merit and NaN if no scenario
            completed; likewise ``mean_*`` of user-defined metrics; ``slack_scenarios``, the number of scenarios with
            any slack sample; ``outcomes``, counts over all scenarios.
        """
        names = SUMMARY | {f"mean_{name}": f"mean.{name}" for name in self.own}
        slack = self.of_completed("slack_share") > 0
        return {name: self.statistic(statistic) for name, statistic in names.items()} | {
            "slack_scenarios": int(slack.sum()),
            "outcomes": self.outcome_counts,
        }


BANDS = {"all scenarios": (0.0, 1.0, 0.12), "90 %": (0.05, 0.95, 0.28), "50 %": (0.25, 0.75, 0.5)}
"""Band → its lower and upper quantile, and its opacity over those before it."""


def fan_chart(result: EnsembleResult, *, ax: GivenAxes = None) -> "Figure":
    """Error and rope tensions over time: median, central 50 % and 90 %, and range of all scenarios.

    Panels: the error, and the tensions of rope 1 and rope 2.

    Raises:
        ConfigurationError: no traces were kept, or no scenario completed.
    """
    if result.traces is None:
        raise ConfigurationError("a fan chart needs traces of scenarios that ran to their end: there are none")
    experiment = result.ensemble.experiment
    colour, _ = law_look(experiment)
    with new_page(ax, 6.4, *_headings(result)) as page:
        error, *ropes = panels = page.panels(3, sharex=True, height_ratios=(1.45, 1, 1))
        unit, name = prefixed_unit("m", result.statistic("worst.max_abs_error"))
        _fan(error, result.traces, "e", unit, colour)
        zero_line(error)
        error.set(ylabel=rf"error $e = x - x_\mathrm{{ref}}$ ({name})", title="tracking error")
        rms = np.sqrt(result.statistic("mean.mse")) / unit
        median, percentile, worst = (
            result.statistic(f"{kind}.max_abs_error") / unit for kind in ("median", "p95", "worst")
        )
        words = (
            f"RMS {rms:.3g} {name} · largest |e|: median {median:.3g}, 95 % {percentile:.3g}, worst {worst:.3g} {name}"
        )
        aside(error, words)
        force, name_of_force = tension_unit(experiment, result.statistic("worst.peak_tension"))
        for rope, axes in enumerate(ropes, start=1):
            _fan(axes, result.traces, f"F{rope}", force, colour)
            draw_limits(axes, experiment, (force, name_of_force))
            axes.set(ylabel=f"tension $F_{rope}$ ({name_of_force})", title=f"rope {rope}")
        median, highest = (result.statistic(f"{kind}.peak_tension") / force for kind in ("median", "worst"))
        mean, longest = (100 * result.statistic(f"{kind}.slack_share") for kind in ("mean", "worst"))
        words = f"both ropes: peak median {median:.3g}, worst {highest:.3g} {name_of_force}"
        aside(ropes[0], words + f" · slack in {mean:.2g} % of the time, worst {longest:.2g} %")
        page.time_axes(panels, experiment)
        page.legend(steady_patch())
    return page.figure


def _headings(result: EnsembleResult) -> tuple[str, str]:
    counts = result.outcome_counts
    incomplete = [f"{count} {outcome.replace('_', ' ')}" for outcome, count in counts.items() if outcome != "completed"]
    title = f"{plain(law_label(result.ensemble.experiment))} in the ensemble “{plain(result.ensemble.name)}”"
    words = f"{counts.get('completed', 0)} scenarios, seed {result.seed}"
    return title, words + (f"; not drawn: {', '.join(incomplete)}" if incomplete else "; every one ran to its end")


def _fan(axes: "Axes", traces: Traces, column: str, unit: float, colour: str) -> None:
    (median,) = traces.quantiles(column, (0.5,)) / unit
    axes.plot(traces.t, median, color=INK, linewidth=0.9, label="median")
    apparent = 1 - np.cumprod([1 - opacity for _, _, opacity in BANDS.values()])
    for label, opacity in zip(BANDS, apparent.tolist(), strict=True):
        axes.fill_between([], [], color=colour, alpha=opacity, linewidth=0, label=label)
    for low, high, opacity in BANDS.values():
        ends = traces.quantiles(column, (low, high)) if low > 0 else (traces.lowest[column], traces.highest[column])
        axes.fill_between(traces.t, ends[0] / unit, ends[1] / unit, color=colour, alpha=opacity, linewidth=0)


def content_of(result: EnsembleResult, notes: Mapping[str, str]) -> FileContent:
    """Content of a result file: per scenario number, drawn values, outcome, end, figures of merit; seed, statistics."""
    experiment = result.ensemble.experiment
    descriptions = {**known_keys(), **describe_parts(experiment)}
    merits = metric_quantities(experiment.metrics)
    columns: dict[str, tuple[NDArray[Any], Quantity]] = {
        "scenario": (np.arange(len(result)), Quantity("", "number of the scenario")),
        **{key: (values, descriptions[key].quantity) for key, values in result.draws.items()},
        "outcome": (result.outcomes, Quantity("", "how the run ended")),
        "end_time": (result.end_times, Quantity("s", "time at which the run ended")),
        **{name: (values, merits[name]) for name, values in result.metrics.items()},
    }
    return FileContent.of(columns, facts_of(result, notes))


def facts_of(result: Any, notes: Mapping[str, str]) -> dict[str, Any]:
    """Metadata of an ensemble's scenarios or of their statistics: provenance, outcomes, statistics."""
    return {
        **notes,
        "ensemble": result.ensemble.name,
        "ensemble_seed": result.seed,
        "scenarios_asked": result.asked,
        "outcomes": result.outcome_counts,
        "statistics": result.statistics,
        "experiment": leaves(result.ensemble.experiment),
        "distributions": {
            key: {"kind": distribution.distribution.kind, **asdict(distribution)}
            for key, distribution in result.ensemble.distributions.items()
        },
    }


def save_ensemble(result: EnsembleResult, path: str | PathLike[str], notes: Mapping[str, str] | None = None) -> None:
    """Write a result to a file; the file appears whole or not at all.

    As with a single run (`simulation.results.file_formats.save`), units of a CSV file go into ``FILE-metadata.json``;
    the other formats contain units, seed, statistics, the nominal experiment, distributions and notes.

    Args:
        result: result to write.
        path: file; its suffix selects the format: csv, parquet, npz, json.
        notes: further texts to save, such as the ensemble's TOML.

    Raises:
        ConfigurationError: an unknown suffix, or not the result of an ensemble.
        OSError: the file cannot be written.

    Example:
        >>> import dualwinch as dw
        >>> sea = dw.load_ensemble("sea", dw.override(dw.Experiment(), {"simulation.duration": 2.0}))
        >>> dw.save_ensemble(dw.run_ensemble(sea, scenarios=8, seed=0), "sea.json")
    """
    if not isinstance(result, EnsembleResult):
        raise ConfigurationError(
            f"result: is a {type(result).__name__}: must be an EnsembleResult (a run's Result is written by save)"
        )
    suffix, content = suffix_of(path := Path(path), SUFFIXES), content_of(result, notes or {})
    if suffix != ".json":
        FORMATS[suffix].write(content, path)
        return
    facts = {**content.facts, "units": content.units, "scenarios": content.rows}
    write_whole(path, json.dumps(facts, indent=1, allow_nan=False) + "\n")


SUFFIXES = (*MIXED, ".json")
"""Suffixes of ensemble files."""
