"""Task of a policy: observations, commands and rewards, in physical units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import (
    ConfigurationError,
    Ensemble,
    Experiment,
    ensemble_file,
    external_commands,
    paper,
    quantities,
)
from dualwinch.toolboxes.stepper.stepper import SENSED, Observation, Stepper

Floats = NDArray[np.float64]

BEHIND = ("e", "F1", "F2", "tau_1", "tau_2")
"""Columns for the reward, which a policy does not observe."""

FASTEST, STRONGEST, SPIN, TURNS, JOLT = 100.0, 1e7, 1e4, 1e5, 1e4
"""Bounds of observations, far beyond the plant's range: m/s, N, rad/s, rad, m/s²."""


@dataclass(frozen=True)
class Reward:
    """Minus the squared tracking error at a step's end in m², minus weighted penalties.

    With the default weights the rewards of a completed run add up to minus its steps times its mean square error at
    their ends.

    Attributes:
        torque_change: weight of the squared change of both motor torques from step to step, in m²/(N m)².
        slack: penalty for each rope that is slack at a step's end, in m².
        lost: error in m for every step that is missing after the vehicle left the track or the run diverged; large
            enough that an early end never pays.
    """

    torque_change: float = 0.0
    slack: float = 0.0
    lost: float = 50.0

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` where a weight is negative or not finite."""
        for name, value in vars(self).items():
            if not (isinstance(value, int | float | np.number) and 0 <= value < np.inf):
                raise ConfigurationError(f"reward.{name} = {value}: must be a finite number >= 0")

    def of(self, now: Observation, before: Observation) -> Floats:
        """The rewards (batch,) in m² of a step, without `lost`.

        Args:
            now: observation at its end: e, F1, F2, tau_1 and tau_2.
            before: observation at its beginning.
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
    """The reward with given weights, by name.

    Raises:
        ConfigurationError: an unknown weight, or one out of range.
    """
    if not isinstance(weights, Mapping):
        raise ConfigurationError(f"reward: must be a Reward, or weights by name, not {type(weights).__name__}")
    names = [field.name for field in fields(Reward)]
    for name in weights:
        if name not in names:
            raise ConfigurationError(f"reward: {quantities.unknown('weight', name, names)}")
    return Reward(**weights)


class Task:
    """Spaces, rewards and stepping of the environments, for runs of an experiment or ensemble in several lanes.

    Attributes:
        stepper: simulates the lanes.
        bounds: name → lowest and highest value of each element of an observation, which is limited to them.
        limits: name → lowest and highest value of each number of a command, which is limited to them.
        action_space, observation_space: of one lane. An action is a number in the command's unit, a dictionary of
            such, or, normalised, a vector of numbers between −1 and 1.
        units: name → unit of each element of an observation.
    """

    def __init__(
        self,
        experiment: Experiment | Ensemble | str,
        lanes: int,
        *,
        command: external_commands.CommandName,
        hold: int,
        reward: Reward | Mapping[str, float] | None,
        exact: bool,
        normalised: bool = False,
        render_mode: str | None = None,
    ) -> None:
        """Make the stepper; arguments as in `VectorEnvironment`.

        Raises:
            ConfigurationError: an unknown experiment, or a number out of range.
        """
        for name, value in (("normalised", normalised), ("exact", exact)):
            if not isinstance(value, bool):
                raise ConfigurationError(f"{name} = {value!r}: must be True or False")
        if render_mode is not None:
            raise ConfigurationError(f"render_mode = {render_mode!r}: must be None; results have figures")
        source = named(experiment) if isinstance(experiment, str) else experiment
        self._reward = reward if isinstance(reward, Reward) else weighted({} if reward is None else reward)
        self.stepper = Stepper(
            with_fresh_noise(source),
            lanes,
            command=command,
            hold=hold,
            signals=(*SENSED, *BEHIND),
            exact=exact,
            record=False,
        )
        nominal = self.stepper.experiment
        self.bounds = _bounds(nominal)
        self.limits = _limits(nominal, command)
        self.units = {name: self.stepper.observation.units[name] for name in SENSED}
        self._low, self._high = np.array(list(self.bounds.values())).T[..., np.newaxis]
        self._lower, self._upper = np.array(list(self.limits.values())).T
        self._last = self.stepper.observation
        self._normalised = normalised
        self.observation_space = gymnasium.spaces.Box(self._low[:, 0], self._high[:, 0], dtype=np.float64)
        boxes: dict[str, gymnasium.Space[Any]] = {
            name: gymnasium.spaces.Box(*ends, (), np.float64) for name, ends in self.limits.items()
        }
        self.action_space: gymnasium.Space[Any] = gymnasium.spaces.Dict(boxes)
        if normalised:
            self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(boxes),), np.float64)
        elif len(boxes) == 1:
            (self.action_space,) = boxes.values()

    def commands(self, actions: Any) -> Floats:
        """Convert the actions of all lanes into commands (lanes, numbers), in physical units.

        Raises:
            ConfigurationError: not one action per lane.
        """
        lanes = self.stepper.batch
        try:
            if not self._normalised and len(self.limits) > 1:
                actions = np.stack([np.asarray(actions[name], dtype=np.float64) for name in self.limits], axis=-1)
            commands = np.asarray(actions, dtype=np.float64).reshape(lanes, len(self.limits))
        except (TypeError, ValueError, KeyError, IndexError) as error:
            raise ConfigurationError(f"action: must be of {self.action_space}, for each of {lanes} lanes") from error
        return self._lower + (commands + 1) / 2 * (self._upper - self._lower) if self._normalised else commands

    def start(self, lanes: NDArray[np.int64], seeds: Sequence[int], episodes: Sequence[int]) -> None:
        """Begin episodes: each lane runs the scenario with the number of its episode, drawn with its seed."""
        source = self.stepper.source.ensemble
        scenarios = source.chosen(episodes, seeds) if source else [0] * len(episodes)
        self._last = self.stepper.reset(lanes=lanes, scenarios=scenarios)

    def step(self, commands: Floats) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        """Step all running lanes.

        Args:
            commands: (lanes, numbers of a command), limited here.

        Returns:
            Rewards, whether each lane was lost, whether each was completed, all (lanes,); 0, false and false for a
            lane that was not running.
        """
        stepper, before, running = self.stepper, self._last, self.stepper.running
        limited = np.minimum(np.maximum(commands, self._lower), self._upper)
        if stepper.under_way:
            self._last = stepper.step(limited if stepper.command == "torques" else limited[:, 0])
        rewards = self._reward.of(self._last, before)
        if stepper.under_way == stepper.batch:
            return rewards, np.zeros(stepper.batch, bool), np.zeros(stepper.batch, bool)
        just_ended = running & ~stepper.running
        ended = just_ended & (stepper.outcomes == "completed")
        lost = just_ended & ~ended
        steps = -(-np.append(stepper.experiment.samples, stepper.samples) // stepper.hold)
        rewards[lost] -= self._reward.lost**2 * (steps[0] - steps[1:][lost])
        return np.where(running, rewards, 0.0), lost, ended

    @property
    def observation(self) -> Floats:
        """The last observation (lanes, elements), within its bounds."""
        sensed = self._last.array[: len(SENSED)]
        return np.ascontiguousarray(np.minimum(np.maximum(sensed, self._low), self._high).T)

    def infos(self, lanes: Sequence[int]) -> list[dict[str, Any]]:
        """Infos at the end of lanes' episodes: outcome and, for completed runs, the MSE in m²."""
        outcomes, errors = self.stepper.outcomes, self.stepper.metrics["mse"]
        infos: list[dict[str, Any]] = [{"outcome": str(outcomes[lane])} for lane in lanes]
        return [
            info | {"mse": float(errors[lane])} if info["outcome"] == "completed" else info
            for info, lane in zip(infos, lanes, strict=True)
        ]


def named(name: str) -> Experiment | Ensemble:
    """The experiment ``case-1`` to ``case-4``, or an ensemble by its name or file.

    Raises:
        ConfigurationError: no such case, ensemble or file.
    """
    cases = {f"case-{number}": number for number in paper.CASES}
    return paper.case(cases[name]) if name in cases else ensemble_file.load_ensemble(name)


def with_fresh_noise(given: Experiment | Ensemble) -> Experiment | Ensemble:
    """An ensemble that draws the seed of an experiment's random signals, if it has any, so that episodes differ."""
    if isinstance(given, Ensemble):
        return given
    sensors, sea = given.sensors, given.disturbance
    random = sensors.position_noise, sensors.speed_noise, sensors.tension_noise, sea.current_sigma
    return Ensemble("noise", "", given, {}) if any((*random, sea.normal_force_sigma)) else given


def _bounds(experiment: Experiment) -> dict[str, tuple[float, float]]:
    length = experiment.plant.track.length
    end = (experiment.samples + 1) * experiment.simulation.sample_time
    by_name = {
        "e_sensed": (-2 * length, 2 * length),
        "t": (0.0, end),
        "x_ref": (-length, 2 * length),
        "v_ref": (-FASTEST, FASTEST),
        "a_ref": (-JOLT, JOLT),
        "x_sensed": (-length, 2 * length),
        "v_sensed": (-FASTEST, FASTEST),
        "d_sensed": (-JOLT, JOLT),
    }
    for name, bound in (("F1", STRONGEST), ("F2", STRONGEST), ("omega_1", SPIN), ("omega_2", SPIN)):
        by_name[f"{name}_sensed"] = (-bound, bound)
    by_name |= {f"{name}_sensed": (-TURNS, TURNS) for name in ("theta_1", "theta_2")}
    return {name: by_name[name] for name in SENSED}


def _limits(experiment: Experiment, command: external_commands.CommandName) -> dict[str, tuple[float, float]]:
    limits, plant = experiment.controller.limits, experiment.plant
    if command == "force":
        return {"u": (-limits.force, limits.force)}
    ends = {}
    for name, winch in (("tau_1", plant.winch_1), ("tau_2", plant.winch_2)):
        to_torque = winch.drum_radius / winch.gear_ratio
        ends[name] = to_torque * limits.tension_min, to_torque * limits.tension_max
    return ends
