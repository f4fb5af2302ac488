"""How runs change with their gains: exact derivatives of the tracking error and of the figures of merit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.drivers.rollout import COMPLETED
from dualwinch.codegen.drivers.sensitivity import Sensitivity, compile_sensitivity
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions.setpoint import Setpoint, later
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Mark
from dualwinch.simulation.batch.groups import NOT_RUN, Progress, Scenarios, run_in_groups
from dualwinch.simulation.batch.jobs import run_all
from dualwinch.simulation.batch.pairs import Pairs
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LATENESS, closed_loop
from dualwinch.simulation.loop.start import start_slopes
from dualwinch.simulation.loop.structure import Structure, described_parameters
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.metrics.metrics import metrics_of, metrics_with
from dualwinch.simulation.metrics.own import slopes_of
from dualwinch.simulation.simulate import OUTCOMES

Floats = NDArray[np.float64]

GAINS = ("controller.", "nominal.", "actuator.")
"""What runs can be differentiated by: everything that acts at the samples, not between them."""

TINY = 1e-100
"""Step of the complex-step derivative: exact, as nothing is subtracted."""


@dataclass(frozen=True)
class Sensitivities:
    """Runs and their derivatives by p gains, for n sets of gains in m scenarios.

    Attributes:
        names: the gains.
        outcomes: (n, m) words, as in `simulation.batch.rollout.BatchResult`.
        metrics: figure of merit → (n, m); NaN where a pair was not completed.
        gradients: figure of merit → (n, m, p); NaN where the figure of merit is.
        errors: (n, m, kept) tracking error e in m; NaN after an early end.
        slopes: (n, m, kept, p) derivatives of e.
        interrupted: whether an interrupt ended the call; what is left out is ``not_run`` and NaN.
    """

    names: tuple[str, ...]
    outcomes: NDArray[np.str_]
    metrics: dict[str, Floats]
    gradients: dict[str, Floats]
    errors: Floats
    slopes: Floats
    interrupted: bool = False


def sensitivities(
    names: Sequence[str],
    parameters: ArrayLike,
    scenarios: Sequence[Experiment | Scenario],
    *,
    stride: int = 1,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Sensitivities:
    """Run every set of gains in every scenario, with exact forward sensitivities.

    The derivatives are those of the compiled steps themselves (no differences are taken): exact where the run is
    smooth in the gains. Where a limit, a slack rope or a dry friction switches they are one-sided.

    Args:
        names: keys of the gains, as for `simulation.batch.rollout.rollout`: ``controller.*`` or ``nominal.*``.
        parameters: (n, p), a value for each name.
        scenarios: m experiments or draws of one structure and length.
        stride: every how many samples error and slopes are kept; 0 keeps none. A set in a scenario takes
            8 (p + 1) bytes a sample.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Raises:
        ConfigurationError, DualwinchError: as `simulation.batch.rollout.rollout`.
    """

    def run(together: Scenarios, report: Progress) -> Sensitivities:
        return _sensitivities(Pairs(names, parameters, together), stride, threads, report)

    return run_in_groups(run, scenarios, progress)


def _sensitivities(pairs: Pairs, stride: int, threads: int | None, progress: Progress) -> Sensitivities:
    _check_names(pairs.names)
    smooth = closed_loop(pairs.structure, pairs.zeros | steps(pairs.structure))
    run = compile_sensitivity(pairs.loop, smooth, tuple(pairs.columns))
    shape, p = pairs.shape, len(pairs.names)
    kept = -(-pairs.samples // stride) if stride else 0
    merits = describe(metrics_with(pairs.structure.metrics))
    result = Sensitivities(
        names=pairs.names,
        outcomes=np.full(shape, NOT_RUN, dtype="U10"),
        metrics={name: np.full(shape, np.nan) for name in merits},
        gradients={name: np.full((*shape, p), np.nan) for name in merits},
        errors=np.full((*shape, kept), np.nan),
        slopes=np.full((*shape, kept, p), np.nan),
    )

    def one(i: int, j: int) -> None:
        own = pairs.experiment(j).metrics
        outside = pairs.signals(j)
        for first in range(0, p, run.directions):
            gains = range(first, min(first + run.directions, p))
            outcome, final, tangent, x, slopes = _run(run, pairs, i, j, outside, gains, stride)
            result.slopes[i, j, : len(x), first : first + len(gains)] = slopes[:, : len(gains)]
            completed = outcome == COMPLETED
            gradients = _gradients(pairs.loop.states, final, tangent, own, completed=completed)
            for name, gradient in gradients.items():
                result.gradients[name][i, j, list(gains)] = gradient[: len(gains)]
            wanted = _wanted(outside, pairs.loop.exogenous, pairs.experiment(j))[:: max(stride, 1)]
            result.errors[i, j, : len(x)] = x - wanted[: len(x)]
            reached = dict(zip(pairs.loop.states, final.tolist(), strict=True))
            metrics = metrics_of(reached, completed=completed, own=own)
            for name, table in result.metrics.items():
                table[i, j] = metrics[name]
            result.outcomes[i, j] = OUTCOMES[outcome]

    whole = run_all([lambda i=i, j=j: one(i, j) for i, j in pairs.indices.tolist()], threads, progress)
    return replace(result, interrupted=not whole)


def _wanted(outside: Floats, names: Sequence[str], experiment: Experiment) -> Floats:
    """Where the vehicle should be at every sample, (samples,): in the track's frame, and at the sample's true time."""
    columns = dict(zip(names, outside.T, strict=True))
    late = experiment.simulation.jitter * np.append(0.0, columns[LATENESS][:-1])
    asked = Setpoint(*(columns[f"reference.{name}"] for name in ("x", "v", "a")))
    return later(asked, late).x - experiment.sensors.position_bias


def steps(structure: Structure) -> frozenset[str]:
    """Parameters of sensors that read in steps.

    Their derivative is zero almost everywhere, which says nothing: derivatives are those of sensors without steps,
    along the run with them.
    """
    known = described_parameters(structure)
    return frozenset(key for key, leaf in known.items() if Mark.READS_IN_STEPS in leaf.marks)


def _check_names(names: tuple[str, ...]) -> None:
    if not names:
        raise ConfigurationError("names: must be at least one gain")
    for name in names:
        if not name.startswith(GAINS):
            raise ConfigurationError(f"no sensitivity to '{name}': must be a gain, {' or '.join(GAINS)}*")


def _run(
    run: Sensitivity, pairs: Pairs, i: int, j: int, outside: Floats, gains: range, stride: int
) -> tuple[int, Floats, Floats, Floats, Floats]:
    """Outcome, final state, its tangents (states, directions), and positions with their tangents."""
    directions = np.zeros((len(pairs.names), run.directions))
    directions[list(gains), range(len(gains))] = 1.0
    vectors = pairs.vectors(np.array([[i, j]]))
    (vector,), (state,) = vectors, pairs.starts(vectors)
    by_parameters = np.array(start_slopes(pairs.structure)(vector))[:, pairs.columns]
    tangent = np.ascontiguousarray(by_parameters @ directions)
    outcome, _, x, slopes = run(vector, directions, outside, state, tangent, stride)
    return outcome, state, tangent, x, slopes


def _gradients(
    names: tuple[str, ...], final: Floats, tangents: Floats, own: Sequence[Metric], *, completed: bool
) -> dict[str, Floats]:
    """Derivatives of the metrics along tangents of the final state (states, directions), by a complex step.

    Own metrics need not take complex numbers: theirs are by differences of what they make of the final state.
    """
    moved = np.empty(tangents.shape, complex)
    moved.real, moved.imag = final[:, np.newaxis], TINY * tangents
    with np.errstate(invalid="ignore"):  # a run that diverged
        metrics = metrics_of(dict(zip(names, moved, strict=True)), completed=completed)
    built_in = {
        name: np.where(np.isnan(np.real(value)), np.nan, np.imag(value) / TINY) for name, value in vars(metrics).items()
    }
    samples = final[names.index("sample")] * completed
    reached = dict(zip(names, final.tolist(), strict=True))
    return built_in | slopes_of(own, reached, dict(zip(names, tangents, strict=True)), samples)
