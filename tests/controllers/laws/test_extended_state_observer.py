"""The observer that active disturbance rejection and equivalent input disturbance share, in either law."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.equivalent_input_disturbance import Eid
from dualwinch.controllers.laws.extended_state_observer import ExtendedState
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from tests.conftest import PaperRun
from tests.controllers.laws.samples import T, step
from tests.tolerances import close

both_laws = pytest.mark.parametrize("law", [Adrc(), Eid()])


@both_laws
def test_the_first_sample_takes_the_measured_motion(law: Adrc | Eid) -> None:
    state, output = step(law, ExtendedState(), 12.0, 0.3)
    assert output.u == pytest.approx(1e4 * (-16 * 12 - 8 * 0.3))
    assert output.d_hat == 0
    assert state.x == pytest.approx(12.0, abs=1e-3)


@both_laws
def test_the_expectation_follows_the_saturated_command(law: Adrc | Eid) -> None:
    state, output = step(law, ExtendedState(x=-3.0, primed=1.0), -3.0)
    assert (output.u, output.u_sat) == (pytest.approx(4.8e5), 5800)
    assert state.v == pytest.approx(T * 0.58)


@pytest.mark.parametrize(
    ("law", "disturbance", "share", "error"),
    [(Adrc(), 0.05, 1e-6, 1e-9), (Eid(), 0.05, 1e-9, 1e-11), (Eid(), -0.2, 1e-9, 1e-11)],
)
def test_a_constant_disturbance_is_estimated_and_taken_off(
    law: Adrc | Eid, disturbance: float, share: float, error: float
) -> None:
    x, v, state, output = 0.0, 0.0, ExtendedState(), None
    for _ in range(8000):
        state, output = step(law, state, x, v)
        acceleration = output.u_sat / 1e4 + disturbance
        x, v = x + T * v + T**2 / 2 * acceleration, v + T * acceleration
    assert output is not None
    assert output.d_hat == pytest.approx(disturbance, rel=share)
    assert abs(x) < error


@both_laws
def test_no_speed_sensor_is_needed(law: Adrc | Eid, paper_run: PaperRun) -> None:
    experiment = case(4, law.kind)
    blind = simulate(replace(experiment, sensors=replace(experiment.sensors, speed_noise=0.5)))
    assert close(blind["x"], paper_run(4, law.kind)["x"], abs=0.05)


@pytest.mark.parametrize(("kind", "correlation"), [("adrc", 0.9), ("eid", 0.95)])
def test_the_estimate_follows_vortices(kind: str, correlation: float, paper_run: PaperRun) -> None:
    result = paper_run(4, kind)
    window = (result["t"] > 18.5) & (result["t"] < 28.5)
    assert np.corrcoef(result["d_hat"][window], result["d_true"][window])[0, 1] > correlation
