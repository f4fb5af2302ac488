"""The result of a run: named columns with units, figures of merit, outcome; resampling, conversions, its figure."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.controllers.estimators.kalman import KalmanGains
from dualwinch.model.errors import ConfigurationError, MissingExtraError, UnknownNameError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity, unknown
from dualwinch.model.quantities.tables import page, readable, readable_unit, section, table
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import is_automatic, solver_of
from dualwinch.simulation.metrics.metrics import BUILT_IN, Metrics
from dualwinch.simulation.plots.page import GivenAxes, new_page, scenario
from dualwinch.simulation.plots.style import (
    GREY,
    INK,
    LIMIT,
    ROPE_COLOURS,
    SKY,
    Look,
    draw_limits,
    law_label,
    law_look,
    plain,
    prefixed_unit,
    tension_unit,
    zero_line,
)
from dualwinch.simulation.plots.traces import largest, thin
from dualwinch.simulation.prepare import LONGEST
from dualwinch.simulation.rows import CONTINUOUS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import LineStyleType


Floats = NDArray[np.float64]

SHOWN_METRICS = ("mse", "max_abs_error", "chatter")
"""Built-in figures of merit in the text of a result, which also shows all user-defined ones."""

TIME = "t"
"""The column that becomes index or coordinate in pandas and xarray."""


@dataclass(frozen=True, eq=False, repr=False)
class Result(Mapping[str, NDArray[np.float64]]):
    """The result of one run, a mapping of its columns: ``result["F1"]``, ``"F1" in result``, ``dict(result)``.

    Two results are equal if all their contents are, number for number.

    Attributes:
        columns: name → (rows,) float64, one row at the beginning of each kept control sample: the columns of every run
            (`simulation.rows.COLUMNS`), and the signals of the controller's parts.
        metrics: figures of merit over every sample, kept or not; NaN if the run was not completed.
        outcome: ``completed``, ``diverged`` or ``left_track``.
        end_time: time in s at which the run ended.
        final_state: name → value of every state after the last sample.
        experiment: the experiment.
        quantities: name → unit and meaning of every column.
        nominal: the plant the controller was designed for, if it is not the simulated one.
    """

    columns: dict[str, NDArray[np.float64]]
    metrics: Metrics
    outcome: str
    end_time: float
    final_state: dict[str, float]
    experiment: Experiment
    quantities: Mapping[str, Quantity]
    nominal: Plant | None = None

    @property
    def units(self) -> dict[str, str]:
        """Column name → unit."""
        return {name: quantity.unit for name, quantity in self.quantities.items()}

    @property
    def interpolation(self) -> dict[str, str]:
        """Column name → interpolation between two rows by `resample`: ``linear`` or ``held``.

        Continuous signals are interpolated linearly, signals set at a sample are held.
        """
        return {name: "linear" if name in CONTINUOUS else "held" for name in self.columns}

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        """One column by name.

        Raises:
            UnknownNameError: no such column; the message suggests the nearest name.
        """
        try:
            return self.columns[column]
        except (KeyError, TypeError):
            raise UnknownNameError(unknown("column", column, self.columns)) from None

    def __iter__(self) -> Iterator[str]:
        """Names of the columns."""
        return iter(self.columns)

    def __len__(self) -> int:
        """Number of the columns."""
        return len(self.columns)

    @property
    def integrator(self) -> str:
        """The integrator used: the configured one, or the one its ropes require (`loop.structure.solver_of`)."""
        return solver_of(self.experiment).integrator

    def resample(self, rate: float | None = None, *, times: ArrayLike | None = None) -> "Result":
        """Resample the rows at other instants, without filtering, so that fewer rows may alias.

        Continuous signals (motion, tensions, disturbance, reference position and speed) are interpolated linearly;
        signals set at a sample and held until the next (commands, reference acceleration, all signals of the
        controller's parts) keep the value of the latest row (`interpolation`).

        Args:
            rate: rows per second, from the first row on; or
            times: (n,) ascending times of the rows in s, none before the first row or after the last.

        Returns:
            A result with these rows; everything else, including figures of merit, is unchanged.

        Raises:
            ConfigurationError: neither or both are given, the run kept no rows, or a time is outside their range.
        """
        t = self["t"]
        instants = _instants(t, rate, times)
        latest = np.maximum(np.searchsorted(t, instants + _rounding(t), side="right") - 1, 0)
        columns = {
            name: np.interp(instants, t, self[name]) if kind == "linear" else self[name][latest]
            for name, kind in self.interpolation.items()
        }
        return replace(self, columns=columns | {"t": instants})

    def plot(self, *, ax: "Axes | Sequence[Axes] | None" = None) -> "Figure":
        """Plot an overview of the run: trajectory, error, tensions, force and estimate.

        Args:
            ax: axes for these; default: a figure of its own.

        Raises:
            ConfigurationError: the run kept no rows.
        """
        return overview(self, ax=ax)

    def to_pandas(self) -> "pd.DataFrame":
        """The rows as a `pandas.DataFrame` with index ``t``.

        Its ``attrs`` contain ``units`` and ``meanings`` by column, outcome, end time and figures of merit.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        pandas = _extra("pandas")
        index = pandas.Index(self[TIME], name=TIME)
        frame = pandas.DataFrame({name: self[name] for name in self if name != TIME}, index=index)
        meanings = {name: quantity.meaning for name, quantity in self.quantities.items()}
        frame.attrs = {"units": self.units, "meanings": meanings, **self._facts}
        return frame

    def to_xarray(self) -> "xr.Dataset":
        """The rows as an `xarray.Dataset` with a variable over ``t`` for each column.

        The ``attrs`` of a variable contain ``units``, ``long_name`` and ``interpolation``, those of the dataset
        outcome, end time and figures of merit.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        xarray = _extra("xarray")
        arrays = {}
        for name, quantity in self.quantities.items():
            # names of the climate and forecast conventions, which xarray uses for axis labels
            attributes = {"units": quantity.unit, "long_name": quantity.meaning}
            attributes["interpolation"] = self.interpolation[name]
            arrays[name] = xarray.Variable(TIME, self[name], attributes)
        time = arrays.pop(TIME)
        return xarray.Dataset(arrays, {TIME: time}, self._facts)

    @property
    def _facts(self) -> dict[str, Any]:
        return {"outcome": self.outcome, "end_time": self.end_time, **self.metrics}

    @property
    def _words(self) -> str:
        """Outcome and number of rows and columns; with the solver, if the ropes determine it."""
        ending, rows = self.outcome.replace("_", " "), len(next(iter(self.columns.values())))
        solver = f", {solver_of(self.experiment)}" if is_automatic(self.experiment) else ""
        return f"{ending} at {self.end_time:g} s, {rows} rows of {len(self)} columns{solver}"

    def __repr__(self) -> str:
        """Law, outcome and main figures of merit in one line."""
        quantities = self.metrics.quantities
        merits = [
            f"{name} {self.metrics[name]:.4g} {readable_unit(quantities[name].unit)}".rstrip()
            for name in (*SHOWN_METRICS, *(name for name in quantities if name not in BUILT_IN))
            if not math.isnan(self.metrics[name])
        ]
        return f"Result({law_label(self.experiment)}: {'; '.join([self._words, *merits])})"

    def _repr_html_(self) -> str:
        """Outcome, figures of merit and columns, for notebooks."""
        rows = []
        for name, quantity in self.quantities.items():
            ends = np.fmin.reduce(self[name], initial=np.inf), np.fmax.reduce(self[name], initial=-np.inf)
            texts = [f"{end:.4g}" if np.isfinite(end) else "–" for end in ends]
            rows.append([name, *texts, readable_unit(quantity.unit), readable(quantity.meaning)])
        columns = table(["column", "lowest", "highest", "unit", "meaning"], rows, numbers=(1, 2))
        return page(
            law_label(self.experiment),
            self._words,
            section("figures of merit", self.metrics._repr_html_(), is_open=True),
            section(f"{len(rows)} columns", columns),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Result):
            return NotImplemented
        plain = ("outcome", "end_time", "experiment", "nominal", "quantities")
        return (
            all(getattr(self, name) == getattr(other, name) for name in plain)
            and _same(self.columns, other.columns)
            and self.metrics.quantities == other.metrics.quantities
            and _same(vars(self.metrics), vars(other.metrics))
            and _same(self.final_state, other.final_state)
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]  # its columns are mutable


def _same(ours: Mapping[str, ArrayLike], theirs: Mapping[str, ArrayLike]) -> bool:
    """Whether names, their order and their numbers are equal; NaN equals NaN."""
    return list(ours) == list(theirs) and all(np.array_equal(ours[name], theirs[name], equal_nan=True) for name in ours)


def _instants(t: Floats, rate: float | None, times: ArrayLike | None) -> Floats:
    """Checked instants of a time grid; arguments as in `Result.resample`."""
    if (rate is None) == (times is None):
        raise ConfigurationError("resample: give either rate or times")
    if not len(t):
        raise ConfigurationError("resample: the run kept no rows (stride = 0)")
    begin, end = float(t[0]), float(t[-1])
    slip = _rounding(t)
    if rate is not None:
        if not (math.isfinite(rate) and rate > 0 and (end - begin) * rate < LONGEST):
            raise ConfigurationError(
                f"rate = {rate:g}: must be a finite number > 0 1/s, of at most {LONGEST:g} instants"
            )
        count = math.floor((end - begin + slip) * rate) + 1
        return np.minimum(begin + np.arange(count) / rate, end)
    instants = np.array(times, float)
    if instants.ndim != 1 or not instants.size:
        raise ConfigurationError(f"times: shape {instants.shape} must be (n,), with at least one time")
    outside = ~((instants >= begin - slip) & (instants <= end + slip))
    if outside.any():
        index = int(outside.argmax())
        raise ConfigurationError(
            f"times[{index}] = {instants[index]:g}: must be {begin:g} to {end:g} s, where rows are"
        )
    if (np.diff(instants) <= 0).any():
        index = int((np.diff(instants) <= 0).argmax()) + 1
        raise ConfigurationError(f"times[{index}] = {instants[index]:g}: must be > times[{index - 1}]")
    return instants


def _rounding(t: Floats) -> float:
    """Time in s by which an instant may miss a row due to the rounding of both."""
    return 8 * float(np.spacing(np.abs(t).max()))


def _extra(name: str) -> ModuleType:
    """Import an optional library.

    Raises:
        MissingExtraError: it is not installed.
    """
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        raise MissingExtraError(name, name) from None


@dataclass(frozen=True)
class Curve:
    """A run with its label and line style, the same in every panel."""

    label: str
    result: Result
    colour: str
    dashes: "LineStyleType"

    @property
    def experiment(self) -> Experiment:
        """The experiment of the run."""
        return self.result.experiment

    @property
    def title(self) -> str:
        """Its name in legends, with outcome and time if it ended early."""
        if self.result.outcome == "completed":
            return self.label
        return f"{self.label} ({self.result.outcome.replace('_', ' ')} at {self.result.end_time:.3g} s)"

    def draw(self, axes: "Axes", column: str, unit: float = 1.0, rows: slice = slice(None), **style: Any) -> None:
        """Draw a column over time, divided by `unit`."""
        self.line(axes, self.result["t"][rows], self.result[column][rows] / unit, **style)

    def line(self, axes: "Axes", t: Floats, values: Floats, **style: Any) -> None:
        """Draw a line of the run: times and values (rows,)."""
        axes.plot(*thin(t, values), **{"color": self.colour, "linestyle": self.dashes, "label": self.title} | style)


def curve_of(result: Result, look: Look, label: str) -> Curve:
    """The curve of a run, with colour, line style and label.

    Raises:
        ConfigurationError: the run kept no rows.
    """
    if not len(result["t"]):
        raise ConfigurationError(f"the result of {label} keeps no rows: simulate with stride >= 1")
    return Curve(plain(label), result, *look)


REFERENCE = {"color": INK, "linestyle": ":", "linewidth": 1.0, "label": "reference"}
"""Line style of a reference."""

FORCE_REACH = 1.25
"""Range of the force panel over the limits; commands beyond are stated in words."""


def overview(result: Result, *, ax: GivenAxes = None) -> "Figure":
    """Overview of a run.

    Panels: trajectory, error, tensions with commands, force and, if estimated, disturbance.

    Raises:
        ConfigurationError: the run kept no rows.
    """
    run = curve_of(result, (law_look(result.experiment)[0], "-"), law_label(result.experiment))
    draw = [
        _trajectory_panel,
        _error_panel,
        _tensions_panel,
        _force_panel,
        *([_disturbance_panel] if _disturbance_estimates(run) else []),
    ]
    placement = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
    with new_page(ax, 0.75 + 1.45 * len(draw), run.title, scenario(run.experiment).capitalize()) as page:
        panels = page.panels(len(draw), sharex=True)
        for axes, panel in zip(panels, draw, strict=True):
            panel(axes, run)
            axes.locator_params(axis="y", nbins=5)
            axes.legend(**placement, ncols=4, handlelength=1.8, columnspacing=1.2)
        page.time_axes(panels, run.experiment)
    return page.figure


def _trajectory_panel(axes: "Axes", run: Curve) -> None:
    run.draw(axes, "x", label="vehicle")
    run.draw(axes, "x_ref", **REFERENCE)
    axes.set(ylabel="position $x$ (m)", title="trajectory")


def _error_panel(axes: "Axes", run: Curve) -> None:
    unit, name = prefixed_unit("m", largest(run.result["e"]))
    run.draw(axes, "e", unit, label=r"$x - x_\mathrm{ref}$")
    zero_line(axes)
    axes.set(ylabel=f"error $e$ ({name})", title="tracking error")
    steady = run.result.metrics.steady_mae
    if np.isfinite(steady):
        unit, name = prefixed_unit("m", steady)
        axes.set_title(f"tracking error · mean |e| in the steady state (shaded): {steady / unit:.3g} {name}")


def _tensions_panel(axes: "Axes", run: Curve) -> None:
    lowest, highest = run.result.metrics.min_tension, run.result.metrics.peak_tension
    size, name = unit = tension_unit(run.experiment, highest)
    for rope, colour in enumerate(ROPE_COLOURS, start=1):
        run.draw(axes, f"F{rope}_cmd", size, color=colour, alpha=0.25, linewidth=4, label=f"command {rope}")
        run.draw(axes, f"F{rope}", size, color=colour, linewidth=1.0, label=f"rope {rope}")
    draw_limits(axes, run.experiment, unit, label=None)
    words = f" · {lowest / size:.3g} to {highest / size:.3g} {name}" if np.isfinite(highest) else ""
    axes.set(ylabel=f"tension ({name})", title=f"rope tensions{words}")


def _force_panel(axes: "Axes", run: Curve) -> None:
    limit = float(run.experiment.controller.limits.force)
    size, name = prefixed_unit("N", limit, largest(run.result["u_sat"]))
    run.draw(axes, "u", size, color=GREY, linestyle="--", linewidth=1.0, label="asked for, $u$")
    run.draw(axes, "u_sat", size, label="given, sat $u$")
    words = "force"
    if largest(run.result["u"]) > limit:
        limit /= size
        share = 100 * run.result.metrics.saturated_share
        words += f" · beyond ±{limit:g} {name}" + (f" in {share:.3g} % of the run" if np.isfinite(share) else "")
        for edge in (-limit, limit):
            axes.axhline(edge, **LIMIT)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, -FORCE_REACH * limit), min(top, FORCE_REACH * limit))
    axes.set(ylabel=f"force ({name})", title=words)


def _disturbance_estimates(run: Curve) -> dict[str, Floats]:
    """Name → estimate of the disturbance in m/s² that the controller compensates: the whole, then a part of it.

    The position law compensates the share of the Kalman filter's estimate that the filter passes on, and its own
    estimate of the rest.
    """
    result, law = run.result, r"law's $\hat{d}$"
    gains = getattr(run.experiment.controller.estimator, "kalman", None)
    share = gains.compensation if isinstance(gains, KalmanGains) and "d_est" in result else 0.0
    if not share:
        return {"estimate": result["d_hat"]} if "d_hat" in result else {}
    estimate = share * result["d_est"]
    if "d_hat" not in result:
        return {"estimate of the filter, compensated": estimate}
    return {f"whole estimate: filter's share and {law}": estimate + result["d_hat"], f"{law} alone": result["d_hat"]}


def _disturbance_panel(axes: "Axes", run: Curve) -> None:
    estimates = _disturbance_estimates(run)
    above = {"zorder": 2.2} if len(estimates) > 1 else {}
    styles = above, {"color": SKY, "linewidth": 0.8, "zorder": 1.9}
    for (name, values), style in zip(estimates.items(), styles, strict=False):
        run.line(axes, run.result["t"], values * 1e3, label=name, **style)
    run.draw(axes, "d_true", 1e-3, color=INK, linestyle=":", linewidth=1.0, label="true")
    axes.set(ylabel="$d$ (mm/s²)", title="disturbance acceleration")
