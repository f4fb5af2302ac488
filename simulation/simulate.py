"""Run one experiment."""

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.model.arguments import whole_number
from dualwinch.model.plant import Plant
from dualwinch.simulation.exogenous.signals import exogenous_pieces
from dualwinch.simulation.experiment import EngineName, Experiment
from dualwinch.simulation.loop.closed_loop import ClosedLoop
from dualwinch.simulation.loop.engine import engine_of
from dualwinch.simulation.metrics.metrics import metrics_of
from dualwinch.simulation.prepare import check_memory, prepare
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.results.outcomes import WORDS
from dualwinch.simulation.results.result import Result

PIECE = 1_000_000
"""Samples between two progress reports and checks for an interrupt."""


def simulate(
    experiment: Experiment,
    *,
    nominal: Plant | None = None,
    stride: int = 1,
    engine: EngineName | None = None,
    progress: Progress = no_progress,
) -> Result:
    """Run one experiment.

    Args:
        experiment: plant, controller, reference, disturbances, sensors, simulation.
        nominal: the plant the controller was designed for; default: the simulated one.
        stride: keep every `stride`-th sample as a row; 0 keeps none (the metrics still count every sample).
        engine: ``compiled`` (C by our emitter), ``casadi`` (C as CasADi's code generator writes it) or ``interpreter``
            (CasADi's, about a hundred times slower); results differ only by rounding. Default: the experiment's
            (``simulation.engine``).
        progress: called from time to time in a long run with the completed fraction.

    Returns:
        The result, also of a run that diverges or leaves the track: its outcome, its rows until then, and NaN for
        figures of merit.

    Raises:
        ConfigurationError: the experiment's values are inconsistent, or its rows do not fit into memory.
        DualwinchError: no compiler or no usable cache folder.

    Example:
        >>> import dualwinch as dw
        >>> result = dw.simulate(dw.override(dw.case(2), {"simulation.duration": 1.0}))
        >>> f"{1e3 * result['x'][-1]:.1f} mm, {result['F1'].max():.0f} N"
        '49.9 mm, 1749 N'
    """
    whole_number("stride", stride)
    prepared = prepare(experiment, nominal)
    loop = prepared.loop
    check_memory(experiment.samples, stride, len(loop.columns))
    run = engine_of(loop, experiment.simulation.engine if engine is None else engine)
    parameters, state = loop.vector(prepared.parameters), prepared.state
    blocks: list[NDArray[np.float64]] = []
    outcome, count = Outcome.COMPLETED, 0
    for piece in exogenous_pieces(experiment, max(PIECE // max(stride, 1), 1) * max(stride, 1)):
        outcome, stepped, rows = run(parameters, piece, state, stride)
        blocks.append(rows)
        count += stepped
        progress(count / experiment.samples)
        if outcome != Outcome.COMPLETED:
            break
    rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    return result_of(loop, experiment, nominal, rows, state, outcome, count)


def result_of(
    loop: ClosedLoop,
    experiment: Experiment,
    nominal: Plant | None,
    rows: NDArray[np.float64],
    state: NDArray[np.float64],
    outcome: Outcome,
    samples: int,
) -> Result:
    """The result of a run, or of a part of it: its rows (rows, columns), last state (states,) and number of samples."""
    final = dict(zip(loop.states, state.tolist(), strict=True))
    return Result(
        columns={name: column.copy() for name, column in zip(loop.columns, rows.T, strict=True)},
        metrics=metrics_of(final, completed=outcome == Outcome.COMPLETED, own=experiment.metrics),
        outcome=WORDS[outcome],
        end_time=samples * experiment.simulation.sample_time,
        final_state=final,
        experiment=experiment,
        quantities=loop.quantities,
        nominal=nominal,
    )
