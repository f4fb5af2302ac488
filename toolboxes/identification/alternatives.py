"""Named alternatives to the experiment as described, which logs may show to be likelier."""

from collections.abc import Sequence
from dataclasses import dataclass

from dualwinch.toolbox import ConfigurationError, quantities


@dataclass(frozen=True)
class Alternative:
    """What an experiment may lack, or describe otherwise.

    Attributes:
        name: by which it is excluded.
        meaning: in a line.
    """

    name: str
    meaning: str


RECORDER_CLOCK = Alternative("recorder-clock", "the recorder samples between the controller's samples")
INTERPOLATED_ROWS = Alternative("interpolated-rows", "rows were interpolated between the controller's samples")
TORQUE_DELAY = Alternative("torque-delay", "torques act more or fewer samples late")
TORQUES_BETWEEN_ROWS = Alternative("torques-between-rows", "torques changed more often than they were logged")
LOAD_CELL_LAG = Alternative("load-cell-lag", "load cells lag behind the tensions")
WINCHES_AND_ROPES = Alternative("winches-and-ropes", "friction and inertia of the winches, and damping of the ropes")
SEA = Alternative("sea", "a current, changes of the rail load and vortices")
VORTEX_PHASE = Alternative("vortex-phase", "the phase of the vortices is integrated, or not, unlike the described one")
START_UNDER_WAY = Alternative("start-under-way", "the log begins during a run")

ALTERNATIVES = (
    RECORDER_CLOCK,
    INTERPOLATED_ROWS,
    TORQUE_DELAY,
    TORQUES_BETWEEN_ROWS,
    LOAD_CELL_LAG,
    WINCHES_AND_ROPES,
    SEA,
    VORTEX_PHASE,
    START_UNDER_WAY,
)
"""All alternatives, in the order in which they are tried."""


def without(names: Sequence[str]) -> frozenset[Alternative]:
    """All alternatives but some.

    >>> len(without(["sea", "load-cell-lag"]))
    7

    Raises:
        ConfigurationError: a name of none.
    """
    by_name = {each.name: each for each in ALTERNATIVES}
    for name in names:
        if name not in by_name:
            hint = quantities.suggestion(name, by_name)
            raise ConfigurationError(f"--without {name}: no alternative; must be of {', '.join(by_name)}; {hint}")
    return frozenset(ALTERNATIVES) - {by_name[name] for name in names}
