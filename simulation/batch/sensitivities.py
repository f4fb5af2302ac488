"""Sensitivities of runs: exact derivatives of error, other columns and figures of merit with respect to parameters."""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.sensitivity import Sensitivity, Varied, compile_sensitivity
from dualwinch.codegen.drivers.unit import kept_rows
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import Setpoint
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark, Quantity, unknown
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.batch.rollout import ParameterScenarioGrid, fill
from dualwinch.simulation.batch.scenarios import Scenarios, by_structure, check_shape, experiment_of
from dualwinch.simulation.batch.workers import Workers, portion_of, run_all, threads_of
from dualwinch.simulation.exogenous.signals import check_shaped, exogenous_signals, shaped_by, signal_slope
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LATENESS, closed_loop, start_slopes
from dualwinch.simulation.loop.structure import LoopStructure, parameters_of, structure_of
from dualwinch.simulation.metrics.metric import Metric, slopes_of
from dualwinch.simulation.metrics.metrics import metric_quantities, metrics_of
from dualwinch.simulation.plots.page import new_page, scenario
from dualwinch.simulation.plots.style import GREY, PALETTE, law_label, looks
from dualwinch.simulation.plots.traces import thin
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.results.outcomes import WORDS, RunOutcomes, not_run
from dualwinch.simulation.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_differentiable(names: Iterable[str], experiment: Experiment) -> None:
    """Raise `ConfigurationError` for names without derivatives; unknown names are ignored."""
    parameters = structure_of(experiment).parameters
    descriptions, values = described(experiment), leaves(experiment)
    for name in names:
        if name not in descriptions:
            continue
        reason = _reason(descriptions[name])
        if not reason and name not in parameters and not shaped_by(name):
            reason = "it has no value" if values[name] is None else "it affects no run by itself"
        if reason:
            raise ConfigurationError(f"no sensitivity to '{name}': {reason}")


def differentiable_numbers(experiment: Experiment) -> dict[str, float]:
    """Key → value of every number of an experiment with derivatives."""
    ahead = {key: value for key, value in leaves(experiment).items() if shaped_by(key)}
    numbers = {}
    for key, value in (parameters_of(experiment) | ahead).items():
        try:
            check_differentiable([key], experiment)
            check_shaped(experiment, key)
        except ConfigurationError:
            continue
        if value or Mark.SCALES_DRAWS not in described(experiment)[key].marks:
            numbers[key] = float(value)
    return numbers


def described(experiment: Experiment) -> dict[str, Leaf]:
    """Metadata of every key of an experiment and of the controller's nominal plant."""
    return {**describe_parts(experiment), **structure_of(experiment).parameters}


BY_MARK = {
    Mark.READS_IN_STEPS: "it quantises a reading",
    Mark.TIMING: "it sets the instants of the samples",
    Mark.SHAPES_CODE: "it is written into the compiled code",
}
"""Why a number with a mark has no derivative."""

BY_TYPE = {int: "it is a whole number", bool: "it is a switch", str: "it is a choice or a text", tuple: "it is a list"}
"""The same, by the type of a value."""

OVERLOADS = ("push", "payload", "dropout_1", "dropout_2")

BY_PREFIX = {
    "metrics.": "it affects no run, only a figure of merit",
    "reference.": "the reference is computed before a run",
    "sensors.outage": "outages begin and end with samples",
    "sensors.fault_": "faults begin and end with samples",
    **dict.fromkeys(
        [f"disturbance.{load}.{time}" for load in OVERLOADS for time in ("start", "duration")],
        "overloads begin and end with samples",
    ),
    "controller.nominal.": "it sets the controller's nominal plant; use nominal.*",
}
"""The same, by what a key begins with."""


def _reason(leaf: Leaf) -> str:
    """Why a number has no derivative, by its metadata; empty: it may have one."""
    by_mark = (reason for mark, reason in BY_MARK.items() if mark in leaf.marks)
    by_kind = (reason for kind, reason in BY_TYPE.items() if leaf.kind is kind)
    by_group = (reason for beginning, reason in BY_PREFIX.items() if leaf.key.startswith(beginning))
    return next(chain(by_mark, by_kind, by_group), "")


Floats = NDArray[np.float64]


class TangentSeeds:
    """The varied numbers of n sets in m scenarios: parameters of the loop, and numbers that shape its signals.

    Attributes:
        names: keys of the p numbers.
        pairs: the grid of sets and scenarios, with those numbers that are parameters of the loop.
        signals: names of the signals that some of the numbers shape.
    """

    def __init__(
        self, names: Sequence[str], parameters: ArrayLike, scenarios: Scenarios, zeros: frozenset[str] | None = None
    ) -> None:
        """Check the arguments, which are those of `ParameterScenarioGrid`.

        Raises:
            ConfigurationError: as in `ParameterScenarioGrid`, or a number without derivatives.
        """
        self.names, self._values = tuple(names), np.asarray(parameters, float)
        if not names:
            raise ConfigurationError("names: must be at least one number to differentiate by")
        check_shape(self.names, self._values)
        loop_names = names
        if scenarios:
            experiment = experiment_of(scenarios[0])
            check_differentiable(names, experiment)
            loop = structure_of(experiment).parameters
            loop_names = [name for name in names if name in loop or not shaped_by(name)]
        self.pairs = ParameterScenarioGrid(
            loop_names, self._values[:, [self.names.index(name) for name in loop_names]], scenarios, zeros
        )
        self._shaped = {name: signals for name in self.names if (signals := shaped_by(name))}
        self.signals = tuple(dict.fromkeys(signal for signals in self._shaped.values() for signal in signals))
        if self._shaped:
            for i, j in self.pairs.indices.tolist():
                self._check(i, j)

    def _check(self, i: int, j: int) -> None:
        try:
            prepare(experiment := self._receiving(i, j))
            for name in self._shaped:
                check_shaped(experiment, name)
        except ConfigurationError as error:
            raise ConfigurationError(f"parameters[{i}]: {error}") from error

    def _receiving(self, i: int, j: int) -> Experiment:
        """The experiment that determines the signals of a pair."""
        values = dict(zip(self.names, self._values[i].tolist(), strict=True))
        return with_leaves(self.pairs.experiment(j), {name: values[name] for name in self._shaped})

    def portions(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Split into parts of some scenarios with all sets: indices of sets and of scenarios."""
        sets, count = self.pairs.shape
        size = portion_of(count, least=1)
        for start in range(0, count, size):
            yield np.arange(sets), np.arange(start, min(start + size, count))

    def part(
        self, sets: NDArray[np.int64], scenarios: NDArray[np.int64]
    ) -> tuple[tuple[str, ...], Floats, Scenarios, frozenset[str]]:
        """The arguments for some of the sets and scenarios."""
        _, _, some, zeros = self.pairs.part(sets, scenarios)
        return self.names, self._values[sets], some, zeros

    def outside(self, i: int, j: int) -> Floats:
        """Exogenous signals of a pair, (samples, exogenous)."""
        return exogenous_signals(self._receiving(i, j)) if self._shaped else self.pairs.signals(j)

    def directions(self, chosen: range, width: int) -> Floats:
        """Directions in the loop's varied parameters, (parameters, width): unit vectors of the chosen names, else 0."""
        directions = np.zeros((len(self.pairs.names), width))
        for column, number in enumerate(chosen):
            if self.names[number] in self.pairs.names:
                directions[self.pairs.names.index(self.names[number]), column] = 1.0
        return directions

    def tangents(self, i: int, j: int, chosen: range, width: int) -> Floats:
        """Derivatives of the signals with respect to the chosen names, (samples, signals, width)."""
        tangents = np.zeros((self.pairs.shared.samples, len(self.signals), width))
        for column, number in enumerate(chosen):
            for signal in self._shaped.get(self.names[number], ()):
                slope = signal_slope(self._receiving(i, j), signal, self.names[number])
                tangents[:, self.signals.index(signal), column] = slope
        return tangents


COMPLEX_STEP = sys.float_info.min**0.5
"""Step of the complex-step derivative, which is exact, as nothing is subtracted."""

FRAME = "simulation.jitter", "sensors.position_bias"
"""Numbers that affect the reference position."""


@dataclass(frozen=True, eq=False)
class Sensitivities(RunOutcomes):
    """Runs and their derivatives with respect to p numbers, for n sets in m scenarios; outcomes are (n, m).

    Attributes:
        names: keys of the numbers.
        gradients: figure of merit → (n, m, p); NaN where the figure of merit is NaN.
        errors: (n, m, kept) tracking error e in m; NaN after an early end.
        slopes: (n, m, kept, p) derivatives of e.
        columns: requested column → (n, m, kept), in its unit; NaN after an early end.
        column_slopes: column → (n, m, kept, p) derivatives.
        quantities: column → quantity.
        interrupted: whether an interrupt ended the call; unfinished runs are ``not_run`` and NaN.
    """

    names: tuple[str, ...]
    gradients: dict[str, Floats]
    errors: Floats
    slopes: Floats
    columns: dict[str, Floats] = field(default_factory=dict)
    column_slopes: dict[str, Floats] = field(default_factory=dict)
    quantities: dict[str, Quantity] = field(default_factory=dict)
    interrupted: bool = False

    @property
    def _arrays(self) -> Mapping[str, NDArray[Any] | Mapping[str, NDArray[Any]]]:
        tables = {"gradients": self.gradients, "columns": self.columns, "column_slopes": self.column_slopes}
        return {**super()._arrays, "errors": self.errors, "slopes": self.slopes, **tables}


def sensitivities(
    names: Sequence[str],
    parameters: ArrayLike,
    scenarios: Sequence[Experiment | Scenario],
    *,
    columns: Sequence[str] = (),
    stride: int = 1,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> Sensitivities:
    """Run every set of values in every scenario, with exact forward sensitivities.

    The compiled step itself is differentiated, without finite differences: derivatives are exact where the run is
    smooth in the numbers, and one-sided where a limit, a slack rope or dry friction switches. Random signals keep their
    draws; numbers that scale them scale these. Quantised sensors are differentiated as if they were not quantised, as
    the derivative of a step function, zero almost everywhere, is useless.

        found = dw.sensitivities(["plant.vehicle.mass"], [[1e4]], [dw.case(4)], columns=["F1", "tau_1"])
        found.column_slopes["F1"][0, 0]  # (samples, 1) in N/kg

    Args:
        names: keys of gains and of any other continuous number of plant, sensors, actuator and disturbance. As in
            `simulation.batch.rollout.rollout`, ``plant.*`` does not change the controller's nominal plant; for a
            change of both, add the derivatives with respect to ``plant.*`` and ``nominal.*``.
        parameters: (n, p), a value for each name.
        scenarios: m experiments or draws, of one structure and length.
        columns: columns of a result whose derivatives are kept, such as ``F1``; also sensor readings (``x_read``) if
            the experiment keeps them (``simulation.readings``).
        stride: keep error, columns and slopes of every `stride`-th sample; 0 keeps none. A pair takes 8 (p + 1) bytes
            per sample and column.
        workers: number of workers on this machine, or an executor; default: one thread per core.
        progress: called from time to time with the completed fraction.

    Raises:
        ConfigurationError: as in `simulation.batch.rollout.rollout`; a number without derivative (a count, a choice,
            an instant, a quantisation), or an unknown column.
        DualwinchError: as in `simulation.batch.rollout.rollout`.

    Example:
        >>> import dualwinch as dw
        >>> run = dw.override(dw.case(4), {"simulation.duration": 1.0})
        >>> slopes = dw.sensitivities(["plant.vehicle.mass"], [[1e4]], [run], columns=["F1"])
        >>> slopes.column_slopes["F1"].shape
        (1, 1, 1000, 1)
    """
    unique_columns = tuple(dict.fromkeys(columns))
    parts = [
        (TangentSeeds(names, parameters, together), places, report)
        for places, together, report in by_structure(scenarios, progress)
    ]
    result = _empty_result(parts[0][0], len(scenarios), unique_columns, stride)

    def run_here(seeds: TangentSeeds, places: NDArray[np.int64], report: Progress) -> bool:
        run = _compiled(seeds, unique_columns)
        jobs = [
            partial(_differentiate, run, seeds, (i, j), stride, result, (i, int(places[j])))
            for i, j in seeds.pairs.indices.tolist()
        ]
        return run_all(jobs, threads_of(workers), report)

    options = unique_columns, stride
    is_complete = fill(result, parts, run_here, sensitivities_portion, options, workers, progress)
    return replace(result, interrupted=not is_complete)


def sensitivities_portion(
    names: Sequence[str],
    parameters: Floats,
    scenarios: Scenarios,
    zeros: frozenset[str],
    columns: tuple[str, ...],
    stride: int,
) -> Sensitivities:
    """Every set of values in some scenarios, on one thread of a worker; arguments as in `sensitivities`."""
    seeds = TangentSeeds(names, parameters, scenarios, zeros)
    result = _empty_result(seeds, len(scenarios), columns, stride)
    for i, j in seeds.pairs.indices.tolist():
        _differentiate(_compiled(seeds, columns), seeds, (i, j), stride, result, (i, j))
    return result


def _compiled(seeds: TangentSeeds, columns: tuple[str, ...]) -> Sensitivity:
    """The compiled run with tangents of some columns."""
    pairs = seeds.pairs
    smooth = closed_loop(pairs.structure, pairs.zeros | steps(pairs.structure))
    return compile_sensitivity(
        pairs.loop,
        smooth,
        Varied(
            parameters=tuple(pairs.columns),
            signals=tuple(pairs.loop.exogenous.index(signal) for signal in seeds.signals),
            columns=tuple(pairs.loop.columns.index(column) for column in columns),
        ),
    )


def _empty_result(seeds: TangentSeeds, scenarios: int, columns: tuple[str, ...], stride: int) -> Sensitivities:
    """An empty result for all sets in a number of scenarios.

    Raises:
        ConfigurationError: an unknown column.
    """
    pairs, p = seeds.pairs, len(seeds.names)
    shape = pairs.shape[0], scenarios
    for column in columns:
        if column not in pairs.loop.columns:
            raise ConfigurationError(f"columns: {unknown('column', column, pairs.loop.columns)}")
    row_count = kept_rows(pairs.shared.samples, stride)
    none = not_run(shape, metric_quantities(pairs.structure.metrics))
    return Sensitivities(
        **vars(none),
        names=seeds.names,
        gradients={name: np.full((*shape, p), np.nan) for name in none.metrics},
        errors=np.full((*shape, row_count), np.nan),
        slopes=np.full((*shape, row_count, p), np.nan),
        columns={name: np.full((*shape, row_count), np.nan) for name in columns},
        column_slopes={name: np.full((*shape, row_count, p), np.nan) for name in columns},
        quantities={name: pairs.loop.quantities[name] for name in columns},
    )


def steps(structure: LoopStructure) -> frozenset[str]:
    """Parameters of quantised sensors.

    The derivative of a step function, zero almost everywhere, is useless: derivatives are those of sensors without
    quantisation, along the run with it.
    """
    return frozenset(key for key, leaf in structure.parameters.items() if Mark.READS_IN_STEPS in leaf.marks)


def _differentiate(
    run: Sensitivity,
    seeds: TangentSeeds,
    pair: tuple[int, int],
    stride: int,
    result: Sensitivities,
    at: tuple[int, int],
) -> None:
    """Run a pair, once for every few names, and fill in its result and its derivatives."""
    pairs, loop, width = seeds.pairs, seeds.pairs.loop, run.varied.directions
    outside, vectors = seeds.outside(*pair), pairs.vectors(np.array([pair]))
    (vector,), (start,) = vectors, pairs.starts(vectors, pair[1:])
    by_parameters = np.array(start_slopes(pairs.structure)(vector, pairs.beginnings[pair[1]]))[:, pairs.columns]
    numbers = dict(zip(loop.parameters, vector.tolist(), strict=True))
    reference = _reference_position(outside, loop.exogenous, numbers)
    metrics_here = pairs.experiment(pair[1]).metrics

    for begin in range(0, len(seeds.names), width):
        batch = range(begin, min(begin + width, len(seeds.names)))
        among, count, directions = slice(batch.start, batch.stop), len(batch), seeds.directions(batch, width)
        state, tangent = start.copy(), np.ascontiguousarray(by_parameters @ directions)
        into = result.slopes[at] if count == width == len(seeds.names) else None
        outputs = run(vector, directions, outside, state, tangent, stride, seeds.tangents(*pair, batch, width), into)
        completed, rows = outputs.outcome == Outcome.COMPLETED, len(outputs.state)
        samples = slice(0, rows * max(stride, 1), max(stride, 1))
        result.outcomes[at] = WORDS[outputs.outcome]
        result.end_times[at] = outputs.samples * pairs.shared.simulation.sample_time
        result.errors[at][:rows] = outputs.state - reference[samples]
        if into is None:
            result.slopes[at][:rows, among] = outputs.state_tangents[:, :count]
        for number in batch:
            if (name := seeds.names[number]) in FRAME:
                stepped = numbers | {name: numbers[name] + 1j * COMPLEX_STEP}
                shifted_reference = _reference_position(outside, loop.exogenous, stepped)
                result.slopes[at][:rows, number] -= np.imag(shifted_reference)[samples] / COMPLEX_STEP
        for number, name in enumerate(result.columns):
            result.columns[name][at][:rows] = outputs.rows[:, number]
            result.column_slopes[name][at][:rows, among] = outputs.row_tangents[:, number, :count]
        metrics = metrics_of(dict(zip(loop.states, state.tolist(), strict=True)), completed=completed, own=metrics_here)
        gradients = _gradients(loop.states, state, tangent, metrics_here, completed=completed)
        for name, table in result.metrics.items():
            table[at] = metrics[name]
            result.gradients[name][at][among] = gradients[name][:count]


def _reference_position(outside: Floats, names: Sequence[str], numbers: Mapping[str, complex]) -> NDArray[Any]:
    """Reference position at every sample, (samples,): in the frame of the track, at the sample's true time."""
    columns = dict(zip(names, outside.T, strict=True))
    jitter, bias = (numbers[name] for name in FRAME)
    delay = jitter * np.append(0.0, columns[LATENESS][:-1])
    point = Setpoint(*(columns[f"reference.{name}"] for name in ("x", "v", "a")))
    return point.ahead(delay).x - bias


def _gradients(
    names: tuple[str, ...], final: Floats, tangents: Floats, own: Sequence[Metric], *, completed: bool
) -> dict[str, Floats]:
    """Derivatives of the metrics along tangents of the final state (states, directions), by a complex step.

    Users' metrics need not accept complex numbers: they are differentiated by finite differences in the final state.
    """
    perturbed_state = np.empty(tangents.shape, complex)
    perturbed_state.real, perturbed_state.imag = final[:, np.newaxis], COMPLEX_STEP * tangents
    with np.errstate(invalid="ignore"):  # diverged runs
        metrics = metrics_of(dict(zip(names, perturbed_state, strict=True)), completed=completed)
    built_in = {
        name: np.where(np.isnan(np.real(value)), np.nan, np.imag(value) / COMPLEX_STEP)
        for name, value in vars(metrics).items()
    }
    samples = final[names.index("sample")] * completed
    reached = dict(zip(names, final.tolist(), strict=True))
    return built_in | slopes_of(own, reached, dict(zip(names, tangents, strict=True)), samples)


READABLE = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}
"""Unit of a column → unit of its changes in figures, and factor to it."""


def effects_figure(
    experiment: Experiment,
    changes: Mapping[str, Mapping[str, Floats]],
    quantities: Mapping[str, Quantity],
) -> "Figure":
    """First-order changes of columns of a run (column → label → (samples,)), one panel per column."""
    t: Floats = np.arange(experiment.samples, dtype=np.float64) * experiment.simulation.sample_time
    styles = looks(next(iter(changes.values())), PALETTE[::-1])
    height, words = 1.2 + 1.6 * len(changes) + 0.09 * len(styles), f"{law_label(experiment)}; {scenario(experiment)}"
    with new_page(None, height, "Changes to first order", words) as page:
        panels = page.panels(len(changes), sharex=True)
        for axes, (column, lines) in zip(panels, changes.items(), strict=True):
            axes.axhline(0.0, color=GREY, linewidth=0.7)
            unit, scale = READABLE.get(quantities[column].unit, (readable_unit(quantities[column].unit), 1.0))
            for label, values in lines.items():
                axes.plot(*thin(t, scale * values), **styles[label], label=label)
            axes.set(
                ylabel=f"change of {column} ({unit})" if unit else f"change of {column}",
                title=readable(quantities[column].meaning),
            )
        page.time_axes(panels, experiment, shaded=False)
        page.legend()
    return page.figure
