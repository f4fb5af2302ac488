"""Progress reports of long computations: the protocol behind every ``progress=`` argument.

A computation calls ``progress(fraction)`` from time to time; any callable of a number will do. One with several
phases, such as a search, also passes the name of the phase and a line of numbers on its status:
``progress(0.4, "searching", "120 trials")``. A receiver of all three arguments works with every computation.
"""

from typing import Protocol


class Progress(Protocol):
    """Receiver of progress reports; called in the computing thread, so it must return at once."""

    def __call__(self, fraction: float, /) -> None:
        """Report the completed `fraction` of the whole computation, from 0 to 1."""
        ...


class PhaseProgress(Progress, Protocol):
    """Receiver of progress reports of a computation with several phases."""

    def __call__(self, fraction: float, phase: str = "", status: str = "") -> None:
        """Report the completed `fraction`, the current phase (empty: as before), and a line of numbers with units."""
        ...


def no_progress(fraction: float, phase: str = "", status: str = "") -> None:
    """Ignore progress reports; the default of ``progress=`` arguments."""


def part(progress: Progress, first: float, last: float) -> Progress:
    """A receiver for a part of a computation: maps its 0 to 1 to `first` to `last` of the whole."""
    return lambda fraction: progress(first + fraction * (last - first))
