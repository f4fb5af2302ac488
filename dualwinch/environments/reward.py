"""What a step is worth."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import unknown
from dualwinch.simulation.stepper.stepper import Observation

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

    def of(self, now: Observation, before: Observation) -> Floats:
        """The rewards (batch,) in m² of a step, where no run was lost.

        Args:
            now: what is observed at its end: e, F1, F2, tau_1 and tau_2.
            before: likewise, at its beginning.
        """
        total = now["e"] ** 2
        if self.torque_change:
            for name in ("tau_1", "tau_2"):
                total += self.torque_change * (now[name] - before[name]) ** 2
        if self.slack:
            for name in ("F1", "F2"):
                total += self.slack * (now[name] <= 0)
        return -total


def weighted(weights: Mapping[str, float]) -> Reward:
    """A reward by the names of its weights.

    Raises:
        ConfigurationError: there is no such weight, or one is out of range.
    """
    known = [field.name for field in fields(Reward)]
    for name in weights:
        if name not in known:
            raise ConfigurationError(f"reward: {unknown('weight', name, known)}")
    return Reward(**weights)
