"""How a run ended, or where it stands: the same numbers in the C drivers, in every engine and in results."""

from enum import IntEnum


class Outcome(IntEnum):
    """How a run of a sampled system ended; the enum of driver.h.

    Only `COMPLETED` runs have figures of merit.
    """

    COMPLETED = 0
    """It has run all its samples."""
    DIVERGED = 1
    """A state is not finite."""
    LEFT = 2
    """The system's margin went negative: it left the range that it is a model of."""
    GIVEN_UP = 3
    """The state that is watched exceeded its bound, so that the rest of the run was left out."""
    RUNNING = 4
    """It is under way."""
    NOT_RUN = 5
    """It was not begun, as an interrupt came first."""
