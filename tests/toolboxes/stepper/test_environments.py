"""Environments by Gymnasium's own checkers, lane against single environment, and against runs."""

import cProfile
import pstats
import subprocess
import sys
from copy import copy
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import dualwinch as dw
from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.toolboxes.stepper.environments.environment import Environment, VectorEnvironment
from dualwinch.toolboxes.stepper.environments.registration import ENVIRONMENT_NAMES, register
from dualwinch.toolboxes.stepper.environments.task import Reward, Task

FORMS: list[dict[str, Any]] = [
    {},
    {"command": "torques"},
    {"normalised": True},
    {"command": "torques", "normalised": True},
]


def short(duration: float = 0.2, **keys: Any) -> dw.Experiment:
    return dw.override(dw.case(4), {"simulation.duration": duration} | keys)


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("name", ["dualwinch/Case4-v0", "dualwinch/Sea-v0"])
def test_gymnasiums_checker_has_nothing_to_say(name: str, form: dict) -> None:
    """Warnings are errors here."""
    env = gymnasium.make(name, **form)
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("name", ENVIRONMENT_NAMES)
def test_every_name_makes_an_environment(name: str) -> None:
    register()  # once more is no error
    envs = gymnasium.make_vec(name, num_envs=2)
    assert isinstance(envs.unwrapped, VectorEnvironment)
    assert isinstance(gymnasium.make(name).unwrapped, Environment)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_a_name_with_its_module_needs_no_import() -> None:
    program = "import gymnasium; print(gymnasium.make('dualwinch.toolboxes.stepper.environments:dualwinch/Case4-v0'))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "dualwinch/Case4-v0" in run.stdout


@pytest.mark.parametrize("make", [Environment, VectorEnvironment])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"experiment": "case-5"}, "case-5"),
        ({"hold": 0}, "hold = 0: must be a whole number >= 1"),
        ({"command": "speed"}, 'command = "speed": must be "torques" or "force"'),
        ({"reward": 5}, "reward: must be a Reward, or weights by name, not int"),
        ({"reward": {"slack": "a"}}, "reward.slack = a: must be a finite number >= 0"),
        ({"reward": {"slack": -1.0}}, "reward.slack = -1.0: must be a finite number >= 0"),
        ({"reward": {"slak": 1.0}}, "reward: unknown weight 'slak'; did you mean 'slack'"),
        ({"normalised": "a"}, "normalised = 'a': must be True or False"),
        ({"render_mode": "human"}, "render_mode = 'human': must be None"),
    ],
)
def test_what_makes_no_environment_is_named(make: Any, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        make(**arguments)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda envs: envs.reset(seed=[1]), "seed: has 1 numbers: must have 2, one a lane"),
        (lambda _: VectorEnvironment(2, command="torques").step(np.zeros(2)), "action: must be of Dict"),
        (lambda envs: envs.step(np.zeros(3)), "action: must be of Box"),
        (lambda envs: envs.step(np.array([0.0, np.nan])), r"force\[1\] = nan: must be finite"),
    ],
)
def test_wrong_seeds_and_actions_are_named(call: Any, message: str) -> None:
    envs = VectorEnvironment(2, short())
    envs.reset(seed=0)
    with pytest.raises(ConfigurationError, match=message):
        call(envs)


def test_seeds_are_whole_numbers_and_copies_go_on_by_themselves() -> None:
    one, two = Environment(short()), VectorEnvironment(2, short())
    for seed in (1.5, [1, 1.5], -1, [None, -1], "a"):
        with pytest.raises(ConfigurationError, match=r"seed.*: must be a whole number"):
            two.reset(seed=seed)  # pyright: ignore[reportArgumentType]
    for env in (one, two):
        env.reset(seed=1)
        action = env.action_space.sample()
        env.step(action)
        copied = copy(env)
        assert np.array_equal(copied.step(action)[0], env.step(action)[0])


def plain(infos: dict[str, Any]) -> dict[str, Any]:
    """Lists in place of arrays, also of arrays of arrays."""
    return {
        key: plain(value) if isinstance(value, dict) else [np.asarray(each).tolist() for each in value]
        for key, value in infos.items()
    }


@pytest.mark.parametrize("form", [*FORMS, {"autoreset_mode": AutoresetMode.SAME_STEP}], ids=str)
def test_lanes_are_what_gymnasium_makes_of_single_environments(form: dict) -> None:
    """Seeds, episodes and autoreset: bit for bit its own vector environment of single ones."""
    sea = dw.load_ensemble("sea")
    experiment = dw.override(sea.experiment, {"simulation.duration": 0.2})
    ensemble = dw.Ensemble("short", "", experiment, sea.distributions)
    arguments = {"experiment": ensemble, "hold": 7, "num_envs": 3, **form}
    ours = gymnasium.make_vec("dualwinch/Sea-v0", **arguments)
    mode = {"vector_kwargs": {"autoreset_mode": arguments.pop("autoreset_mode", AutoresetMode.NEXT_STEP)}}
    theirs = gymnasium.make_vec("dualwinch/Sea-v0", vectorization_mode="sync", **mode, **arguments)
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    for seed in (3, None, [5, None, 7]):
        first, second = ours.reset(seed=seed), theirs.reset(seed=seed)  # pyright: ignore[reportArgumentType]
        np.testing.assert_array_equal(first[0], second[0])
        ours.action_space.seed(1)
        for _ in range(65):  # 29 steps an episode, and one to begin the next
            actions = ours.action_space.sample()
            mine, other = ours.step(actions), theirs.step(actions)
            for given, expected in zip(mine[:4], other[:4], strict=True):
                np.testing.assert_array_equal(given, expected, strict=True)
            assert mine[4].keys() == other[4].keys()
            assert plain(mine[4]) == plain(other[4])
            assert mine[0] in ours.observation_space


def test_an_episode_is_a_run() -> None:
    """With the force of a run, held for a sample each: the run's errors make the rewards, its end truncates it."""
    experiment = short()
    run = dw.simulate(experiment)
    env = Environment(experiment, hold=1, exact=True)
    observation, _ = env.reset(seed=0)
    assert observation[env.observed.index("F1_sensed")] == run["F1"][0]
    total, truncated, info = 0.0, False, {}
    for force in run["u"]:
        assert not truncated
        observation, reward, terminated, truncated, info = env.step(np.float64(force))
        total += reward
        assert not terminated
    assert truncated
    assert info["outcome"] == "completed"
    assert info["mse"] == pytest.approx(run.metrics.mse, rel=1e-9)
    ends = np.append(run["e"][1:], run.final_state["motion.plant.x"] - observation[env.observed.index("x_ref")])
    assert total == pytest.approx(-np.sum(ends**2), rel=1e-9)


def test_who_leaves_the_track_pays_for_every_missing_step() -> None:
    experiment = short(40.0)
    env = Environment(experiment, command="torques", hold=10, reward={"lost": 3.0})
    observation, info = env.reset(seed=0)
    rewards, terminated = [], False
    while not terminated:
        observation, reward, terminated, truncated, info = env.step({"tau_1": 4.5, "tau_2": 130.0})
        rewards.append(reward)
        assert not truncated
    assert info == {"outcome": "left_track"}
    error = observation[env.observed.index("e_sensed")]
    assert rewards[-1] == pytest.approx(-(error**2) - 9.0 * (4000 - len(rewards)))
    with pytest.raises(ConfigurationError, match="all lanes have ended"):
        env._task.stepper.step([[20.0, 20.0]])


def test_a_lane_that_has_ended_begins_anew_with_the_next_step() -> None:
    envs = VectorEnvironment(2, short(40.0), command="torques", hold=10)
    observation, _ = envs.reset(seed=0)
    pulled = {"tau_1": np.array([22.0, 4.5]), "tau_2": np.array([22.0, 130.0])}
    _, _, terminated, truncated, infos = envs.step(pulled)
    while not terminated.any():
        _, _, terminated, truncated, infos = envs.step(pulled)
    assert (terminated.tolist(), truncated.tolist()) == ([False, True], [False, False])
    assert infos["outcome"].tolist() == [None, "left_track"]
    assert infos["_outcome"].tolist() == [False, True]
    anew, rewards, terminated, _, infos = envs.step(pulled)
    np.testing.assert_array_equal(anew[1], observation[1])
    assert rewards[1] == 0.0
    assert rewards[0] < 0.0
    assert not terminated.any()
    assert not infos


def test_weights_are_taken_off_the_reward() -> None:
    experiment = short()
    plain = Environment(experiment, command="torques", hold=1)
    weighted = Environment(experiment, command="torques", hold=1, reward=Reward(torque_change=0.5, slack=2.0))
    held = 22.0, 22.0
    for env in (plain, weighted):
        env.reset(seed=0)
    for torques in (held, held, (20.0, 25.0)):
        action = dict(zip(("tau_1", "tau_2"), torques, strict=True))
        (_, first, *_), (_, second, *_) = plain.step(action), weighted.step(action)
    assert first - second == pytest.approx(0.5 * (2.0**2 + 3.0**2))
    slack = {"tau_1": 4.5, "tau_2": 4.5}
    observation, first, *_ = plain.step(slack)
    weighted.step(slack)
    for _ in range(150):
        observation, first, *_ = plain.step(slack)
        _, second, *_ = weighted.step(slack)
    tensions = [observation[plain.observed.index(name)] for name in ("F1_sensed", "F2_sensed")]
    assert first - second == pytest.approx(2.0 * sum(tension <= 0 for tension in tensions))


def test_actions_beyond_the_space_are_limited_to_it() -> None:
    experiment = short()
    ours, theirs = Environment(experiment), Environment(experiment, normalised=True)
    limit = float(ours.action_space.high)  # pyright: ignore[reportAttributeAccessIssue]
    for env in (ours, theirs):
        env.reset(seed=0)
    for force, share in ((1e9, 1.0), (limit, 7.0), (-limit / 2, -0.5), (-1e9, -1.0)):
        np.testing.assert_allclose(ours.step(force)[0], theirs.step(np.array([share]))[0], rtol=1e-12, atol=1e-12)


def test_observations_stay_within_their_bounds() -> None:
    env = Environment(short(40.0), command="torques", hold=200)
    env.reset(seed=1)
    terminated = False
    while not terminated:
        observation, _, terminated, *_ = env.step({"tau_1": 133.0, "tau_2": 4.5})
        assert observation in env.observation_space
    assert env.units["e_sensed"] == "m"
    assert tuple(env.units) == env.observed


def test_random_signals_are_new_in_every_episode() -> None:
    noisy, calm = Environment(short(**{"sensors.speed_noise": 1e-3})), Environment(short())
    first, second, again = noisy.reset(seed=1)[0], noisy.reset()[0], noisy.reset(seed=1)[0]
    assert (first != second).any()
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(calm.reset(seed=1)[0], calm.reset()[0])


def test_the_first_episodes_of_a_seed_are_scenarios_of_the_ensemble() -> None:
    sea = dw.load_ensemble("sea")
    task = Task(sea, 2, command="force", hold=1, reward=None, exact=False)
    task.start(np.arange(2), [7, 8], [0, 3])
    drawn = [scenario.draws for scenario in task.stepper.scenarios]
    assert drawn == [sea.scenario(0, 7).draws, sea.scenario(3, 8).draws]


def test_without_gymnasium_the_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium.envs", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dualwinch\[gymnasium\]'"):
        register()
    program = (
        "import sys; sys.modules['gymnasium'] = None\n"
        "import dualwinch; dualwinch.Stepper\n"
        "try: dualwinch.VectorEnvironment\n"
        "except dualwinch.DualwinchError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == (
        "gymnasium is not installed; install it with: pip install 'dualwinch[gymnasium]', "
        "or uv run --extra gymnasium ..."
    )


def test_the_mode_of_starting_anew_may_be_given() -> None:
    register()
    for mode in (AutoresetMode.NEXT_STEP, "NextStep", "SameStep"):
        gymnasium.make_vec("dualwinch/Case1-v0", num_envs=1, autoreset_mode=mode)
    with pytest.raises(ConfigurationError, match='autoreset_mode = "Disabled": must be "NextStep" or "SameStep"'):
        gymnasium.make_vec("dualwinch/Case1-v0", num_envs=1, autoreset_mode=AutoresetMode.DISABLED)


def test_many_lanes_begin_anew_at_once() -> None:
    """Drawing scenario by scenario takes thousands of calls a lane."""
    lanes = VectorEnvironment(1024, "sea")
    lanes.reset(seed=0)
    with cProfile.Profile() as profile:
        lanes.reset(seed=1)
    assert 10 < pstats.Stats(profile).total_calls / 1024 < 400  # pyright: ignore[reportAttributeAccessIssue]
