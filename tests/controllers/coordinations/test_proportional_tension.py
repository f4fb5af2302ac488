from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.coordinations.differential_tension import DifferentialTension
from dualwinch.controllers.coordinations.proportional_tension import ProportionalTension
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Coordination, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint

SAMPLE_TIME = 1e-3


def commands(part: Coordination, forces: Iterable[float], preload: float = 3800.0) -> np.ndarray:
    """Tension commands at rest, (samples, 2)."""
    estimate = Estimate(0.0, 0.0, preload / 2, preload / 2, 0.0, 0.0, 0.0, 0.0)
    context = Context(Plant(), Limits(preload=preload), SAMPLE_TIME)
    state, found = part.initial_state(), []
    for force in forces:
        state, output = part.step(state, force, estimate, Setpoint(0.0, 0.0, 0.0), context)
        found.append((output.F1_cmd, output.F2_cmd))
    return np.array(found)


@given(st.lists(st.floats(-5700, 5700), min_size=1, max_size=50))
def test_the_net_force_is_the_command_at_once(forces: list[float]) -> None:
    found = commands(ProportionalTension(), forces)
    assert found[:, 0] - found[:, 1] == pytest.approx(forces, abs=1e-9)
    assert found.min() >= 200
    assert found.max() <= 6000


@given(st.floats(-5700, 5700))
def test_a_lasting_force_is_shared_as_the_paper_does(force: float) -> None:
    last = commands(ProportionalTension(), [force] * 6000)[-1]
    assert last == pytest.approx(commands(DifferentialTension(), [force])[0], abs=0.01)


@pytest.mark.parametrize("force", [-2600.0, 0.0, 1800.0])
def test_both_ropes_change_by_the_same_percentage(force: float) -> None:
    """A tremor at 200 rad/s, of which the low-pass of 0.3 s lets a sixtieth through."""
    tremor = 100 * np.sin(200 * np.arange(4000) * SAMPLE_TIME)
    late = commands(ProportionalTension(), force + tremor)[3000:]
    percentages = np.ptp(late, axis=0) / late.mean(axis=0)
    assert percentages[0] == pytest.approx(percentages[1], rel=0.05)
    assert np.ptp(late.sum(axis=1)) == pytest.approx(200 * abs(force) / 3800, abs=2)
