"""How a long computation reports how far it is: one protocol for everything that takes ``progress=``.

A computation calls ``progress(fraction)`` now and then; any callable of a number suits it. One that goes through
several phases, as a search does, also names the phase and sums up in a line of numbers where it stands:
``progress(0.4, "searching", "120 trials")``. What receives that suits every computation.
"""

from typing import Protocol


class Progress(Protocol):
    """Receives how far a computation is; called from the thread that computes, and expected to return at once."""

    def __call__(self, fraction: float, /) -> None:
        """Report the `fraction` of the whole computation that is done, from 0 to 1."""
        ...


class PhaseProgress(Progress, Protocol):
    """Receives how far a computation is that goes through several phases."""

    def __call__(self, fraction: float, phase: str = "", status: str = "") -> None:
        """Report progress.

        Args:
            fraction: of the whole computation that is done, from 0 to 1.
            phase: name of the current step; empty: as before.
            status: where the computation stands, as a line of numbers with units.
        """
        ...


def no_progress(fraction: float, phase: str = "", status: str = "") -> None:
    """The `Progress` that nothing receives; default of functions that take one."""


def part(progress: Progress, first: float, last: float) -> Progress:
    """Progress of a part of a computation, from 0 to 1, as that of the whole, from the fraction `first` to `last`."""
    return lambda fraction: progress(first + fraction * (last - first))
