"""Motions to choose from: through way-points, within limits, over in time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.reference import own_duration, setpoint
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.prepare import prepare
from dualwinch.toolboxes.identification.experiment_design import (
    MotionLimits,
    motion_dimensions,
    motion_limits,
    motion_of,
)

ROOM = MotionLimits(farthest=40.0, speed=1.5, acceleration=0.25, jerk=0.5, tension=6000.0)


@given(seed=st.integers(0, 2**32 - 1), duration=st.floats(15, 120))
@settings(max_examples=50)
def test_motions_keep_to_their_limits_and_are_over_in_time(seed: int, duration: float) -> None:
    shares = np.random.default_rng(seed).random(motion_dimensions(duration))
    reference = motion_of(shares, ROOM, duration)
    if reference is None:
        return
    t = np.linspace(0, duration, 2000)
    there = setpoint(t, reference)
    assert own_duration(reference) <= duration
    assert there.x.min() >= 0
    assert there.x.max() <= ROOM.farthest
    assert np.abs(there.v).max() <= ROOM.speed * (1 + 1e-9)
    assert np.abs(there.a).max() <= ROOM.acceleration * (1 + 1e-9)
    prepare(replace(case(4), reference=reference))


def test_where_nothing_moves_there_is_no_motion() -> None:
    slow = np.zeros(motion_dimensions(0.1))
    slow[2::2] = 1.0
    assert motion_of(slow, ROOM, 0.1) is None


def test_limits_are_the_experiments_unless_they_are_tightened() -> None:
    room = motion_limits(Experiment())
    assert (room.farthest, room.speed) == (49, 1.8)
    assert room.tension == 6000
    assert motion_limits(Experiment(), track=40, speed=1.0).farthest == 40


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"track": 51.0}, "track = 51: must be > 0 and <= plant.track.length = 50 m"),
        ({"track": 0.0}, "track = 0: must be > 0"),
        ({"speed": 0.0}, "speed = 0: must be > 0"),
        ({"torque": -1.0}, "torque = -1: must be > 0"),
    ],
)
def test_limits_out_of_range_are_refused(limits: dict, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        motion_limits(Experiment(), **limits)
