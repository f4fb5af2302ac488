"""Gymnasium environments of one run, or of many side by side, which one call of compiled code steps together."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from dualwinch.toolbox import ConfigurationError, Ensemble, Experiment, arguments, external_commands
from dualwinch.toolboxes.stepper.environments.task import Floats, Reward, Task
from dualwinch.toolboxes.stepper.stepper import SENSED

Flags = NDArray[np.bool_]

HOLD = 20
"""Samples for which an action is held: 50 actions a second at 1 kHz."""


class Environment(gymnasium.Env[Floats, Any]):
    """A Gymnasium environment of single runs; for its arguments see `VectorEnvironment`.

    ``reset(seed=s)`` begins scenario 0 of seed s, each further ``reset()`` the next one. An episode is terminated if
    the vehicle leaves the track or the run diverges, and truncated at the run's end; then ``info`` holds ``outcome``
    and, for a completed run, its mean square error over all samples, ``mse`` in m².

    Attributes:
        observed: names of the elements of an observation.
        units: name → unit of each.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        experiment: Experiment | Ensemble | str = "case-4",
        *,
        command: external_commands.CommandName = "force",
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
        self._task = task = Task(
            experiment,
            1,
            command=command,
            hold=hold,
            reward=reward,
            exact=exact,
            normalised=normalised,
            render_mode=render_mode,
        )
        self.render_mode = render_mode
        self.action_space: gymnasium.Space[Any] = task.action_space
        self.observation_space: gymnasium.Space[Any] = task.observation_space
        self.observed, self.units = SENSED, task.units
        self._seed, self._episode = -1, 0

    def __copy__(self) -> "Environment":
        """A copy that goes on by itself."""
        return deepcopy(self)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin the next episode, or the first one of a given seed; there are no options."""
        super().reset(seed=seed, options=options)
        self._episode += 1
        if seed is not None:
            self._seed, self._episode = seed, 0
        elif self._seed < 0:
            self._seed, self._episode = int(self.np_random.integers(2**31)), 0
        self._task.start(np.zeros(1, np.int64), [self._seed], [self._episode])
        return self._task.observation[0], {}

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Apply an action for `hold` samples; an action beyond the space is limited to it."""
        rewards, lost, ended = self._task.step(self._task.commands(action))
        terminated, truncated = bool(lost[0]), bool(ended[0])
        info = self._task.infos([0])[0] if terminated or truncated else {}
        return self._task.observation[0], float(rewards[0]), terminated, truncated, info


class VectorEnvironment(gymnasium.vector.VectorEnv[Floats, Any, Any]):
    """A Gymnasium vector environment; each lane is an `Environment`, all are stepped together.

    A lane whose episode has ended begins the next one with the next step, which ignores its action and has reward 0.
    With ``autoreset_mode="SameStep"`` it begins at once: the observation is the next episode's first, and the infos
    hold the last one as ``final_obs``, beside ``final_info``. ``reset(seed=s)`` gives lane k the seed s + k, as
    Gymnasium's own vector environments do; a list gives each lane its own.

    Attributes:
        observed: names of the elements of an observation.
        units: name → unit of each.
    """

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        experiment: Experiment | Ensemble | str = "case-4",
        *,
        command: external_commands.CommandName = "force",
        hold: int = HOLD,
        normalised: bool = False,
        reward: Reward | Mapping[str, float] | None = None,
        exact: bool = False,
        render_mode: None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Make the environment.

        Args:
            num_envs: number of lanes.
            experiment: an experiment; an ensemble, with a scenario per episode; ``case-1`` to ``case-4``; or the name
                of an ensemble, such as ``sea``, or its file.
            command: ``force``: net force of the ropes in N; ``torques``: of both motors in N m.
            hold: samples for which an action is held.
            normalised: actions are vectors of numbers between −1 and 1, the limits of the command. Otherwise a force
                is a number in N, torques are a dictionary of ``tau_1`` and ``tau_2`` in N m.
            reward: its weights (`environments.task.Reward`).
            exact: with the operations of `simulate`, at a quarter of the speed; see `Stepper`.
            render_mode: must be None; results have figures.
            autoreset_mode: when a lane begins its next episode, ``NextStep`` or ``SameStep``.

        Raises:
            ConfigurationError: an unknown experiment, or a number out of range.
        """
        allowed = {mode.value: mode for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)}
        autoreset = str(getattr(autoreset_mode, "value", autoreset_mode))
        if autoreset not in allowed:
            raise ConfigurationError(
                f'autoreset_mode = "{autoreset}": must be "NextStep" or "SameStep"; for others make separate '
                'environments: gymnasium.make_vec(..., vectorization_mode="sync")'
            )
        self._same_step = allowed[autoreset] == AutoresetMode.SAME_STEP
        vars(self)["metadata"] = self.metadata | {"autoreset_mode": allowed[autoreset]}
        self.num_envs, self.render_mode = num_envs, render_mode
        self._task = task = Task(
            experiment,
            num_envs,
            command=command,
            hold=hold,
            reward=reward,
            exact=exact,
            normalised=normalised,
            render_mode=render_mode,
        )
        self.single_action_space, self.single_observation_space = task.action_space, task.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.observed, self.units = SENSED, task.units
        self._seeds: list[int] = []
        self._episodes = np.zeros(num_envs, np.int64)

    def __copy__(self) -> "VectorEnvironment":
        """A copy that goes on by itself."""
        return deepcopy(self)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin the next episode in every lane, or the first one of a given seed; there are no options.

        Raises:
            ConfigurationError: not as many seeds as lanes.
        """
        if isinstance(seed, int | np.integer):
            arguments.whole_number("seed", seed)
        seeds = [seed + lane for lane in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        if seeds is not None and not isinstance(seeds, Sequence | np.ndarray):
            raise ConfigurationError(f"seed = {seeds!r}: must be a whole number, or one a lane")
        for number in () if seeds is None else seeds:
            if number is not None:
                arguments.whole_number("seed", number)
        if seeds is not None and len(seeds) != self.num_envs:
            raise ConfigurationError(f"seed: has {len(seeds)} numbers: must have {self.num_envs}, one a lane")
        any_seed = next((number for number in (() if seeds is None else seeds) if number is not None), None)
        super().reset(seed=any_seed, options=options)
        self._episodes += 1
        if not self._seeds:
            drawn_seed = int(self.np_random.integers(2**31))
            self._seeds = [drawn_seed + lane for lane in range(self.num_envs)]
            self._episodes[:] = 0
        for lane, number in enumerate(() if seeds is None else seeds):
            if number is not None:
                self._seeds[lane], self._episodes[lane] = int(number), 0
        self._start(np.arange(self.num_envs))
        return self._task.observation, {}

    def step(self, actions: Any) -> tuple[Floats, Floats, Flags, Flags, dict[str, Any]]:
        """Apply an action in every lane for `hold` samples; actions beyond the space are limited to it."""
        stepper, infos = self._task.stepper, {}
        begin = np.flatnonzero(~stepper.running) if stepper.under_way < stepper.batch else np.zeros(0, np.int64)
        rewards, lost, ended = self._task.step(self._task.commands(actions))
        if stepper.under_way < stepper.batch:
            over, last_seen = np.flatnonzero(lost | ended), self._task.observation
            for lane, info in zip(over.tolist(), self._task.infos(over.tolist()), strict=True):
                last = {"final_obs": last_seen[lane], "final_info": info}
                infos = self._add_info(infos, last if self._same_step else info, lane)
            if self._same_step:
                begin = over
        if begin.size:
            self._episodes[begin] += 1
            self._start(begin)
        return self._task.observation, rewards, lost, ended, infos

    def _start(self, lanes: NDArray[np.int64]) -> None:
        self._task.start(lanes, [self._seeds[lane] for lane in lanes.tolist()], self._episodes[lanes].tolist())
