"""What a peer is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.case import Case
from dualwinch.simulation.metrics.metrics import Metrics, metrics_of


class UnavailableError(Exception):
    """This machine lacks what a peer needs; the message says what."""


@dataclass(frozen=True)
class Answer:
    """What a rollout ends with.

    Attributes:
        x: final position in m.
        metrics: figures of merit; NaN where a peer does not have them, save the mean square error.
        positions: position in m after each sample (samples,), or ``None`` where it was not kept.
        errors: mean square errors in m² of all candidates of a batch (`benchmarks.peers.candidates`), whose first is
            the rollout itself.
    """

    x: float
    metrics: Metrics
    positions: NDArray[np.float64] | None = None
    errors: NDArray[np.float64] | None = None


class Run(Protocol):
    """One rollout, ready to be timed."""

    def __call__(self, *, keep: bool = False) -> Answer:
        """Roll out, keeping the positions or not."""
        ...


@dataclass(frozen=True)
class Peer:
    """One row of the table.

    Attributes:
        key: short name.
        title: what it is, in the table's words.
        prepare: everything that is done once and not timed; raises `UnavailableError`.
        case: what it runs.
        rollouts: how many rollouts one timed call makes.
        expected: what its answer is checked against; ``None``: dualwinch's in the case all share.
    """

    key: str
    title: str
    prepare: Callable[[Case], Run]
    case: Case
    rollouts: int = 1
    expected: Callable[[Case], Answer] | None = None


def closed_loop_answer(case: Case, state: NDArray[np.float64], positions: NDArray[np.float64] | None = None) -> Answer:
    """The answer in a final state of the symbolic closed loop."""
    final = dict(zip(case.loop.states, state.tolist(), strict=True))
    return Answer(final["motion.plant.x"], metrics_of(final), positions)
