"""Checks that all peers give the same answer, then times them in turn."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median

import numpy as np

from benchmarks.peers import OURS
from benchmarks.peers.batch import prepare_with as prepare_batch
from benchmarks.peers.peer import Answer, Peer, Run, UnavailableError

TOLERANCE = 1e-6
"""Largest difference in m between two peers' positions, anywhere in the run."""

SLOW = 0.3
"""Time in s of a call from which a peer takes part in fewer rounds."""


class DisagreementError(Exception):
    """A peer computes something else; its time would mean nothing."""


@dataclass
class Timing:
    """One row's result.

    Attributes:
        peer: who.
        seconds: the times of its rollouts.
        missing: why there are none.
        deviation: largest difference in m between its positions and those it is checked against.
    """

    peer: Peer
    seconds: list[float] = field(default_factory=list)
    missing: str | None = None
    deviation: float = 0.0

    @property
    def middle(self) -> float:
        """Median time of a rollout in s."""
        return median(self.seconds)


def difference(answer: Answer, expected: Answer) -> float:
    """Largest difference in m between the positions of two rollouts.

    Raises:
        DisagreementError: it is above `TOLERANCE`, or the mean square errors differ by more than that allows.
    """
    if answer.positions is None or expected.positions is None:
        raise DisagreementError("the positions were not kept")
    if len(answer.positions) != len(expected.positions):
        raise DisagreementError(f"{len(answer.positions)} samples instead of {len(expected.positions)}")
    apart = float(np.abs(answer.positions - expected.positions).max())
    apart = max(apart, abs(answer.x - expected.x))
    if not apart <= TOLERANCE:
        raise DisagreementError(f"positions differ by {apart:.2e} m, allowed are {TOLERANCE:g} m")
    allowed = _allowed(expected)
    if not abs(answer.metrics.mse - expected.metrics.mse) <= allowed:
        found, right = answer.metrics.mse, expected.metrics.mse
        raise DisagreementError(f"mean square error {found:.6g} instead of {right:.6g} m^2")
    return apart


def _allowed(expected: Answer) -> float:
    """How much the mean square error in m² may differ where positions differ by `TOLERANCE`."""
    return TOLERANCE * (2 * expected.metrics.mae + TOLERANCE)


def check_candidates(answer: Answer, expected: Answer) -> None:
    """Check a batch's other rollouts by their mean square errors.

    Raises:
        DisagreementError: one differs.
    """
    if answer.errors is None or expected.errors is None:
        return
    apart = float(np.abs(answer.errors - expected.errors).max())
    if not apart <= _allowed(expected):
        raise DisagreementError(f"mean square errors of the candidates differ by {apart:.2e} m^2")


def _timed(run: Run) -> float:
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin


def measure(
    peers: list[Peer], rounds: int, slow_rounds: int, say: Callable[[str], None] = lambda _: None
) -> list[Timing]:
    """Check every peer once, then time them in rounds (A B C A B C …).

    Args:
        peers: who takes part; one of them is dualwinch.
        rounds: how many rounds.
        slow_rounds: in how many of them a slow peer takes part, evenly spaced.
        say: told what is being done.

    Raises:
        DisagreementError: a peer's answer differs; the message names it.
    """
    timings, runs, slow = [], {}, set()
    ours = next(peer for peer in peers if peer.key == OURS)
    expected = ours.prepare(ours.case)(keep=True)
    batch = prepare_batch(1)(ours.case)(keep=True) if any(peer.rollouts > 1 for peer in peers) else expected
    for peer in peers:
        say(f"checking {peer.title}")
        timing = Timing(peer)
        timings.append(timing)
        try:
            run = peer.prepare(peer.case)
            answer = run(keep=True)
            timing.deviation = difference(answer, peer.expected(peer.case) if peer.expected else expected)
            check_candidates(answer, batch)
        except UnavailableError as error:
            timing.missing = str(error)
            continue
        except DisagreementError as error:
            raise DisagreementError(f"{peer.title}: {error}") from error
        if _timed(run) > SLOW:
            slow.add(peer.key)
        runs[peer.key] = run
    with_slow = {round(number) for number in np.linspace(0, rounds - 1, min(slow_rounds, rounds))}
    for number in range(rounds):
        say(f"round {number + 1} of {rounds}")
        for timing in timings:
            key = timing.peer.key
            if key in runs and (key not in slow or number in with_slow):
                timing.seconds.append(_timed(runs[key]) / timing.peer.rollouts)
    return timings
