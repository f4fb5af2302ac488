"""Outcomes of runs, with the same numbers in the C drivers, in every engine and in results."""

from enum import IntEnum


class Outcome(IntEnum):
    """Outcome of a run of a sampled system; the enum of driver.h.

    Only `COMPLETED` runs have figures of merit.
    """

    COMPLETED = 0
    """All samples were run."""
    DIVERGED = 1
    """A state is not finite."""
    LEFT = 2
    """The system's margin became negative: it left the range of validity of the model."""
    GIVEN_UP = 3
    """The watched state exceeded its bound, and the rest of the run was skipped."""
    RUNNING = 4
    """The run is in progress."""
    NOT_RUN = 5
    """The run was not started, owing to an interrupt."""
