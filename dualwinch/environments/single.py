"""One vehicle between two winches as an environment."""

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np

from dualwinch.environments.actions import Actions
from dualwinch.environments.reward import Reward
from dualwinch.environments.task import Floats, Task
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.stepper.commands import CommandName
from dualwinch.simulation.stepper.stepper import SENSED

HOLD = 20
"""Samples that an action is held: 50 actions a second at 1 kHz."""


class Environment(gymnasium.Env[Floats, Any]):
    """A single run after the other; see `environments.vector.VectorEnvironment` for its arguments.

    ``reset(seed=s)`` begins scenario 0 of the seed s, each further ``reset()`` the next one. An episode is terminated
    where the vehicle left the track or the run diverged, truncated at the run's end; then ``info`` holds ``outcome``
    and, of a completed run, its mean square error over all samples, ``mse`` in m².

    Attributes:
        observed: names of the elements of an observation.
        units: name → unit of each.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        experiment: Experiment | Ensemble | str = "case-4",
        *,
        command: CommandName = "force",
        hold: int = HOLD,
        normalised: bool = False,
        reward: Reward | Mapping[str, float] | None = None,
        exact: bool = False,
        render_mode: None = None,
    ) -> None:
        """Make the environment.

        Raises:
            ConfigurationError: an unknown experiment, or a number out of range.
        """
        self._task = Task(experiment, 1, command=command, hold=hold, reward=reward, exact=exact)
        self._actions = Actions(self._task.limits, normalised=normalised)
        self.render_mode = render_mode
        self.action_space: gymnasium.Space[Any] = self._actions.space
        self.observation_space: gymnasium.Space[Any] = observation_space(self._task)
        self.observed, self.units = SENSED, self._task.units
        self._seed, self._episode = -1, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin the next episode, of a seed the first; there are no options."""
        super().reset(seed=seed, options=options)
        self._episode += 1
        if seed is not None:
            self._seed, self._episode = seed, 0
        elif self._seed < 0:
            self._seed, self._episode = int(self.np_random.integers(2**31)), 0
        self._task.start(np.zeros(1, np.int64), [self._seed], [self._episode])
        return self._task.observation[0], {}

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Hold an action; an action beyond the space is limited to it."""
        rewards, lost, ended = self._task.step(self._actions.commands(action, 1))
        terminated, truncated = bool(lost[0]), bool(ended[0])
        info = self._task.infos([0])[0] if terminated or truncated else {}
        return self._task.observation[0], float(rewards[0]), terminated, truncated, info


def observation_space(task: Task) -> gymnasium.spaces.Box:
    """Of one lane."""
    low, high = np.array(list(task.bounds.values())).T
    return gymnasium.spaces.Box(low, high, dtype=np.float64)
