"""What a step is worth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Reward:
    """Minus the squared tracking error at a step's end in m², and minus what is weighted beside it.

    With the default weights the rewards of a run that is completed add up to minus its steps times its mean square
    error at their ends.

    Attributes:
        torque_change: weight of the squared change of both motor torques from step to step, in m²/(N m)².
        slack: of each rope that is slack at a step's end, in m².
        lost: error in m that counts in every step that is missing where the vehicle left the track, or the run
            diverged; at least what the run could have brought, so that nobody leaves early to be spared the rest.
    """

    torque_change: float = 0.0
    slack: float = 0.0
    lost: float = 50.0

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` where a weight is negative or not finite."""
        for name, value in vars(self).items():
            if not 0 <= value < np.inf:
                raise ConfigurationError(f"reward.{name} = {value}: must be a finite number >= 0")

    def of(
        self, error: Floats, tensions: tuple[Floats, Floats], torque_changes: tuple[Floats, Floats], missing: Floats
    ) -> Floats:
        """The rewards of a step, (batch,) in m².

        Args:
            error: x − x_ref in m at its end.
            tensions: F1 and F2 in N, likewise.
            torque_changes: of both motors since the last step, in N m.
            missing: steps that a run that has been lost still had to go; 0 of all others.
        """
        total = error**2 + self.lost**2 * missing
        if self.torque_change:
            total += self.torque_change * (torque_changes[0] ** 2 + torque_changes[1] ** 2)
        if self.slack:
            total += self.slack * ((tensions[0] <= 0).astype(float) + (tensions[1] <= 0))
        return -total
