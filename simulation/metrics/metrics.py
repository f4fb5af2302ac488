"""Built-in figures of merit of a run, accumulated sample by sample by the symbolic code that simulates it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, make_dataclass, replace
from functools import cache
from typing import Annotated, Any

import casadi as ca
import numpy as np

from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Quantity, unknown
from dualwinch.model.quantities.tables import readable, readable_unit, table
from dualwinch.model.scalar import Scalar, absolute, maximum, minimum, sqrt, where
from dualwinch.simulation.metrics.metric import Metric, MetricQuantity, states_before, values_of
from dualwinch.simulation.rows import Sample


def _error(
    meaning: str, formula: str, label: str = "", *, steady: bool = False, abbreviated: bool = False
) -> MetricQuantity:
    """Metadata of a measure of the tracking error, displayed in mm or mm²."""
    unit, display = ("m^2", ("mm²", 1e6, ".3g")) if "^2" in meaning else ("m", ("mm", 1e3, ".3g"))
    label, window = label or readable(meaning), "steady state" if steady else "whole run"
    label = f"steady {label}" if steady else label
    about = f"{meaning}, {window}"
    return MetricQuantity(unit, about, "", label, formula, display, abbreviated=abbreviated, lower=0.0)


def _share(meaning: str, label: str, formula: str) -> MetricQuantity:
    """Metadata of a share of the samples, displayed in percent."""
    about, display = f"share of samples with {meaning}", ("%", 1e2, ".4g")
    return MetricQuantity("1", about, "", label, formula, display, lower=0.0, upper=1.0)


@dataclass(frozen=True, repr=False)
class Metrics(Mapping[str, float]):
    """Figures of merit of a run; NaN if it was not completed, or where there was nothing to measure.

    Also a mapping: ``metrics["mse"]``, ``"mse" in metrics``, ``dict(metrics)``. User-defined ones (`Metric`) follow the
    built-in ones, and are attributes as well.

    Chatter is the effect of switching control on the ropes: their tensions alternate from sample to sample. Energy,
    torque rate and continuous load refer to the torques that reach the plant, after delay and actuator; the share of
    saturated torques refers to the commands.
    """

    mae: Annotated[float, _error("mean |e|", r"\frac{1}{N}\sum_k \lvert e_k\rvert", abbreviated=True)]
    max_abs_error: Annotated[float, _error("largest |e|", r"\max_k \lvert e_k\rvert", "max |e|")]
    mse: Annotated[float, _error("mean e^2", r"\frac{1}{N}\sum_k e_k^2", abbreviated=True)]
    steady_mae: Annotated[float, _error("mean |e|", r"\frac{1}{N_s}\sum_{k\in S} \lvert e_k\rvert", steady=True)]
    steady_max_abs_error: Annotated[
        float, _error("largest |e|", r"\max_{k\in S} \lvert e_k\rvert", "max |e|", steady=True)
    ]
    steady_mse: Annotated[float, _error("mean e^2", r"\frac{1}{N_s}\sum_{k\in S} e_k^2", steady=True)]
    saturated_share: Annotated[
        float,
        _share(
            "the force command beyond its limit",
            "saturated",
            r"\frac{1}{N}\sum_k [u_k \ne u_{\mathrm{sat},k}]",
        ),
    ]
    torque_saturated_share: Annotated[
        float,
        _share(
            "a motor torque at its limit",
            "torque saturated",
            r"\frac{1}{N}\sum_k [\tau_{1,k}\ \mathrm{or}\ \tau_{2,k}\ \mathrm{at\ a\ limit}]",
        ),
    ]
    slack_share: Annotated[
        float,
        _share("a rope at zero tension", "slack", r"\frac{1}{N}\sum_k [\min(F_{1,k}, F_{2,k}) \le 0]"),
    ]
    peak_tension: Annotated[
        float,
        MetricQuantity(
            "N",
            "largest tension of both ropes, at the samples",
            label="peak tension",
            formula=r"\max_k \max(F_{1,k}, F_{2,k})",
            lower=0.0,
        ),
    ]
    min_tension: Annotated[
        float,
        MetricQuantity(
            "N",
            "smallest tension of both ropes at the drums, at the samples; negative where drag holds back a slack rope "
            "that moves away from its drum",
            label="least tension",
            formula=r"\min_k \min(F_{1,k}, F_{2,k})",
            small_is_bad=True,
        ),
    ]
    chatter: Annotated[
        float,
        MetricQuantity(
            "N",
            "mean absolute change of tension from sample to sample, of both ropes",
            label="chatter",
            formula=r"\frac{1}{2(N-1)}\sum_{k\ge 1}\sum_i \lvert F_{i,k}-F_{i,k-1}\rvert",
            lower=0.0,
        ),
    ]
    energy: Annotated[
        float,
        MetricQuantity(
            "J",
            "work of both motors, braking counted like driving",
            label="energy",
            formula=r"T_s\sum_k \sum_i \lvert G_i\,\tau_{i,k}\,\omega_{i,k}\rvert",
            display=("kJ", 1e-3, ".4g"),
            lower=0.0,
        ),
    ]
    torque_rate: Annotated[
        float,
        MetricQuantity(
            "N m/s",
            "mean absolute change of motor torque a second, of both winches",
            label="torque rate",
            formula=r"\frac{1}{2(N-1)\,T_s}\sum_{k\ge 1}\sum_i \lvert \tau_{i,k}-\tau_{i,k-1}\rvert",
            lower=0.0,
        ),
    ]
    continuous_load: Annotated[
        float,
        MetricQuantity(
            "N m",
            "root mean square of the motor torques, of both winches",
            label="continuous load",
            formula=r"\sqrt{\frac{1}{2N}\sum_k \sum_i \tau_{i,k}^2}",
            lower=0.0,
        ),
    ]

    @property
    def quantities(self) -> dict[str, MetricQuantity]:
        """Metadata of every figure of merit, by name."""
        return _quantities_of(type(self))

    def __getitem__(self, name: str) -> float:
        """One figure of merit by name.

        Raises:
            UnknownNameError: no such figure of merit; the message suggests the nearest name.
        """
        if name not in vars(self):
            raise UnknownNameError(unknown("metric", name, vars(self)))
        return vars(self)[name]

    def __iter__(self) -> Iterator[str]:
        """Names of the figures of merit."""
        return iter(vars(self))

    def __len__(self) -> int:
        """Number of the figures of merit."""
        return len(vars(self))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (tuple(self.quantities.items())[len(BUILT_IN) :], tuple(vars(self).values()))

    def __repr__(self) -> str:
        """Every value in its display unit."""
        words = []
        for name, quantity in self.quantities.items():
            value = f"{np.shape(self[name])} values" if np.ndim(self[name]) else quantity.text(self[name])
            words.append(f"{name} = {value} {quantity.shown_unit}".rstrip())
        return f"{type(self).__name__}({', '.join(words)})"

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        rows = []
        for name, quantity in self.quantities.items():
            value, unit = self[name], readable_unit(quantity.unit)
            rows.append([name, "–" if np.isnan(value) else f"{value:.5g}", unit, readable(quantity.meaning)])
        return table(["figure of merit", "value", "unit", "meaning"], rows, numbers=(1,))


BUILT_IN = tuple(describe(Metrics))
"""Names of the built-in figures of merit."""


def metric_quantities(own: Sequence[Metric] = ()) -> dict[str, MetricQuantity]:
    """Metadata of the built-in figures of merit and of an experiment's user-defined ones, by name."""
    return _quantities_of(metrics_with(own))


def _quantities_of(metrics: type[Metrics]) -> dict[str, MetricQuantity]:
    quantities = {name: leaf.quantity for name, leaf in describe(metrics).items()}
    return {name: quantity for name, quantity in quantities.items() if isinstance(quantity, MetricQuantity)}


def in_words(name: str) -> str:
    """The name of a figure of merit or statistic in words: ``mean.steady_mse`` is mean steady MSE."""
    quantities = metric_quantities()
    words = name.replace(".", " ").replace("_", " ").split()
    return " ".join(word.upper() if word in quantities and quantities[word].abbreviated else word for word in words)


def metrics_with(own: Sequence[Metric]) -> type[Metrics]:
    """`Metrics` with an additional field for each user-defined figure of merit."""
    return _metrics_with(tuple((metric.table(), _quantity_of(metric)) for metric in own))


def _quantity_of(metric: Metric) -> MetricQuantity:
    """Metadata of a user-defined figure of merit."""
    label = metric.kind.replace("-", " ")
    if isinstance(metric.quantity, MetricQuantity):
        return replace(metric.quantity, label=metric.quantity.label or label, small_is_bad=metric.small_is_bad)
    return MetricQuantity(**vars(metric.quantity), label=label, small_is_bad=metric.small_is_bad)


@cache
def _metrics_with(own: tuple[tuple[str, MetricQuantity], ...]) -> type[Metrics]:
    if not own:
        return Metrics
    added = [(name, Annotated[float, quantity]) for name, quantity in own]
    return make_dataclass(
        Metrics.__name__, added, bases=(Metrics,), namespace={"__doc__": Metrics.__doc__}, repr=False, frozen=True
    )


def _restored(own: tuple[tuple[str, MetricQuantity], ...], values: tuple[float, ...]) -> Metrics:
    return _metrics_with(own)(*values)


@dataclass(frozen=True)
class Accumulators:
    """Running sums and extremes behind `Metrics`."""

    sum_abs: Annotated[Scalar, Quantity("m", "sum of |e|")] = 0.0
    max_abs: Annotated[Scalar, Quantity("m", "largest |e|")] = 0.0
    sum_square: Annotated[Scalar, Quantity("m^2", "sum of e^2")] = 0.0
    steady_samples: Annotated[Scalar, Quantity("1", "samples in the steady state")] = 0.0
    steady_sum_abs: Annotated[Scalar, Quantity("m", "sum of |e| in the steady state")] = 0.0
    steady_max_abs: Annotated[Scalar, Quantity("m", "largest |e| in the steady state")] = 0.0
    steady_sum_square: Annotated[Scalar, Quantity("m^2", "sum of e^2 in the steady state")] = 0.0
    saturated: Annotated[Scalar, Quantity("1", "samples with the force command beyond its limit")] = 0.0
    torque_saturated: Annotated[Scalar, Quantity("1", "samples with a motor torque at its limit")] = 0.0
    slack: Annotated[Scalar, Quantity("1", "samples with a rope at zero tension")] = 0.0
    peak: Annotated[Scalar, Quantity("N", "largest tension")] = 0.0
    lowest: Annotated[Scalar, Quantity("N", "smallest tension")] = 1e300
    sum_change: Annotated[Scalar, Quantity("N", "sum of |change of tension| of both ropes")] = 0.0
    F1_previous: Annotated[Scalar, Quantity("N", "tension 1 of the last sample")] = 0.0
    F2_previous: Annotated[Scalar, Quantity("N", "tension 2 of the last sample")] = 0.0
    work: Annotated[Scalar, Quantity("J", "work of both motors")] = 0.0
    sum_torque_rate: Annotated[Scalar, Quantity("N m/s", "sum of |change of torque| a second, of both motors")] = 0.0
    sum_torque_square: Annotated[Scalar, Quantity("N^2 m^2", "sum of torque^2 of both motors")] = 0.0
    tau_1_previous: Annotated[Scalar, Quantity("N m", "torque 1 of the last sample")] = 0.0
    tau_2_previous: Annotated[Scalar, Quantity("N m", "torque 2 of the last sample")] = 0.0


def accumulate(so_far: Accumulators, sample: Sample, sample_time: Scalar) -> Accumulators:
    """The accumulators after one more sample; `sample_time` in s."""
    size, square = absolute(sample.e), sample.e**2
    has_previous = sample.number > 0
    smaller_tension = minimum(sample.F1, sample.F2)
    change = absolute(sample.F1 - so_far.F1_previous) + absolute(sample.F2 - so_far.F2_previous)
    change_1, change_2 = sample.torque_1 - so_far.tau_1_previous, sample.torque_2 - so_far.tau_2_previous
    torque_change = absolute(change_1) + absolute(change_2)
    return Accumulators(
        sum_abs=so_far.sum_abs + size,
        max_abs=maximum(so_far.max_abs, size),
        sum_square=so_far.sum_square + square,
        steady_samples=so_far.steady_samples + sample.steady,
        steady_sum_abs=so_far.steady_sum_abs + sample.steady * size,
        steady_max_abs=maximum(so_far.steady_max_abs, sample.steady * size),
        steady_sum_square=so_far.steady_sum_square + sample.steady * square,
        saturated=so_far.saturated + sample.saturated,
        torque_saturated=so_far.torque_saturated + sample.torque_saturated,
        slack=so_far.slack + (smaller_tension <= 0),
        peak=maximum(so_far.peak, maximum(sample.F1, sample.F2)),
        lowest=minimum(so_far.lowest, smaller_tension),
        sum_change=so_far.sum_change + where(has_previous, change, 0.0),
        F1_previous=sample.F1,
        F2_previous=sample.F2,
        work=so_far.work + sample_time * sample.power,
        sum_torque_rate=so_far.sum_torque_rate + where(has_previous, torque_change, 0.0) / sample_time,
        sum_torque_square=so_far.sum_torque_square + sample.torque_1**2 + sample.torque_2**2,
        tau_1_previous=sample.torque_1,
        tau_2_previous=sample.torque_2,
    )


def finish(sums: Mapping[str, Any], samples: Any) -> Metrics:
    """The metrics from the final `Accumulators`, given by field name, and the number of samples.

    Values may be arrays over many runs, so that the metrics are arrays, or symbols.
    """
    steady, symbolic = sums["steady_samples"], isinstance(samples, ca.SX)
    root = sqrt if symbolic else np.sqrt

    def measured(value: Any, count: Any) -> Any:
        if symbolic:
            return where(count > 0, value, np.nan)
        if np.ndim(count):
            return np.where(np.real(count) > 0, value, np.nan)
        return value if np.real(count) > 0 else np.nan

    def mean(total: Any, count: Any) -> Any:
        return measured(total / (maximum(count, 1) if symbolic else np.maximum(np.real(count), 1)), count)

    return Metrics(
        mae=mean(sums["sum_abs"], samples),
        max_abs_error=measured(sums["max_abs"], samples),
        mse=mean(sums["sum_square"], samples),
        steady_mae=mean(sums["steady_sum_abs"], steady),
        steady_max_abs_error=measured(sums["steady_max_abs"], steady),
        steady_mse=mean(sums["steady_sum_square"], steady),
        saturated_share=mean(sums["saturated"], samples),
        torque_saturated_share=mean(sums["torque_saturated"], samples),
        slack_share=mean(sums["slack"], samples),
        peak_tension=measured(sums["peak"], samples),
        min_tension=measured(sums["lowest"], samples),
        chatter=mean(sums["sum_change"], 2 * (samples - 1)),
        energy=measured(sums["work"], samples),
        torque_rate=mean(sums["sum_torque_rate"], 2 * (samples - 1)),
        continuous_load=root(mean(sums["sum_torque_square"], 2 * samples)),
    )


KEYS = {field.name: f"metrics.{field.name}" for field in fields(Accumulators)}
"""Accumulator → name of its state in a closed loop."""


def final_states(own: Sequence[Metric] = ()) -> tuple[str, ...]:
    """Names of the states of a closed loop from which the metrics are computed."""
    return (*KEYS.values(), *states_before(own), "sample")


def metrics_of(final_state: Mapping[str, Any], *, completed: Any = True, own: Sequence[Metric] = ()) -> Metrics:
    """The metrics from the final state of a closed loop; NaN if the run was not completed.

    Accumulators are the states ``metrics.*``; `own` are the experiment's user-defined metrics. Values of states, and
    `completed`, may be arrays over many runs, so that the metrics are arrays.

    Raises:
        ConfigurationError: a user-defined metric does not return one number per run.
    """
    sums = {name: final_state[key] for name, key in KEYS.items()}
    sums["steady_samples"] = sums["steady_samples"] * completed
    samples = final_state["sample"] * completed
    built_in = finish(sums, samples)
    return metrics_with(own)(**vars(built_in), **values_of(own, final_state, samples)) if own else built_in


def checked_metrics(metrics: Any) -> tuple[Metric, ...]:
    """Check metrics and return them as a tuple.

    Raises:
        ConfigurationError: no list of metrics, a metric without quantity, or a name that is taken or given twice.
    """
    if isinstance(metrics, Metric) or not isinstance(metrics, (list, tuple)):
        raise ConfigurationError(f"metrics: must be a list of metrics, e.g. metrics=[{_name(metrics)}()]")
    names: list[str] = []
    for index, metric in enumerate(metrics):
        if not isinstance(metric, Metric):
            requirement = f"{metric.__name__}()" if isinstance(metric, type) else "a Metric"
            raise ConfigurationError(f"metrics[{index}]: must be {requirement}, not {_name(metric)}")
        if not isinstance(getattr(metric, "quantity", None), Quantity):
            raise ConfigurationError(
                f'metric \'{metric.kind}\': has no quantity; write e.g. quantity = Quantity("s", "what it means")'
            )
        name = metric.table()
        if name in BUILT_IN:
            raise ConfigurationError(f"metric '{metric.kind}': the name is taken by a built-in figure of merit")
        if name in names:
            raise ConfigurationError(f"metric '{metric.kind}': is given twice")
        names.append(name)
    return tuple(metrics)


def _name(thing: Any) -> str:
    return thing.__name__ if isinstance(thing, type) else type(thing).__name__
