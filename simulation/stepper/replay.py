"""A lane's run again, from its recorded commands: every row of it, at the price of one run."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.stepping import Stepping
from dualwinch.model.plant import Plant
from dualwinch.simulation.check import check_memory
from dualwinch.simulation.loop.closed_loop import ClosedLoop
from dualwinch.simulation.metrics.metrics import metrics_of
from dualwinch.simulation.results.outcomes import WORDS
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.stepper.lanes import Lanes
from dualwinch.simulation.stepper.pages import LONGEST, first_page
from dualwinch.simulation.stepper.scenarios import Lane


def replay(
    code: Stepping,
    loop: ClosedLoop,
    lane: Lane,
    samples: int,
    commands: Iterable[NDArray[np.float64]],
    hold: int,
    stride: int,
    nominal: Plant | None,
) -> Result:
    """The first samples of a lane's run.

    Args:
        code: what moves lanes on; the same lane gives the same bits in it, wherever it stands.
        loop: names everything.
        lane: what the run starts from.
        samples: how many.
        commands: of each step.
        hold: samples of a step.
        stride: every how many samples a row is kept.
        nominal: for the result.

    Raises:
        ConfigurationError: the rows do not fit into memory.
    """
    check_memory(samples, 1, len(loop.columns))
    again = Lanes(code, 1, lane.experiment.samples, shared=True)
    again.start(np.zeros(1, np.int64), [lane], [first_page(lane.experiment, LONGEST)])
    rows = np.empty((samples, len(loop.columns)))
    for start, given in zip(range(0, samples, hold), commands, strict=False):
        again.runs.commands[:] = given
        again.step(hold, row=rows[start:].ctypes.data)
    outcome, kept = Outcome(again.runs.outcomes[0]), rows[::stride] if stride else rows[:0]
    final = dict(zip(loop.states, again.runs.states(np.zeros(1, np.int64))[0].tolist(), strict=True))
    return Result(
        columns={name: column.copy() for name, column in zip(loop.columns, kept.T, strict=True)},
        metrics=metrics_of(final, completed=outcome == Outcome.COMPLETED, own=lane.experiment.metrics),
        outcome=WORDS[outcome],
        end_time=samples * lane.experiment.simulation.sample_time,
        final_state=final,
        experiment=lane.experiment,
        quantities=loop.quantities,
        nominal=nominal,
    )
