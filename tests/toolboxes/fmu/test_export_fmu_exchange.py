"""The plant's model exchange: slopes, directional derivatives, solvers and CasADi's importer."""

import casadi as ca
import fmpy
import numpy as np
import pytest

from dualwinch.simulation.blocks import block
from dualwinch.simulation.paper import case
from tests.fmus import STEP, Exported, Instance
from tests.oracle.plant import Hold, Plant
from tests.oracle.values import DEFAULTS

TORQUES = ("tau_1", "tau_2")
STATE = ("x", "v", "theta_1", "omega_1", "theta_2", "omega_2")


@pytest.mark.parametrize("version", [2, 3])
def test_directional_derivatives_are_the_independent_plants_slopes(version: int, exported: Exported) -> None:
    plant = Plant(DEFAULTS | {"disturbance.vortex": True})
    at = np.array([20.0, 1.2, 25.3, 1.5, -24.7, -1.5, 30.0, 20.0])  # a moving state, both ropes taut

    def slopes(values: np.ndarray) -> np.ndarray:
        x, v, theta_1, omega_1, theta_2, omega_2, torque_1, torque_2 = values
        position, speed = (x, theta_1, theta_2), (v, omega_1, omega_2)
        assert plant.taut(position, speed) == (True, True)
        (a, alpha_1, alpha_2), _ = plant.motion(0.0, position, speed, Hold(torque_1, torque_2), (True, True))
        return np.array([v, a, omega_1, alpha_1, omega_2, alpha_2])

    fmu = Instance(exported("plant", version), exchange=True)
    names = [*(f"state.{name}" for name in STATE), *TORQUES]
    fmu.put(names, list(at))
    of = [f"der(state.{name})" for name in STATE]
    assert fmu.get(*of) == pytest.approx(slopes(at), rel=1e-9)
    direction = np.array([0.3, -0.2, 0.5, 0.1, -0.4, 0.2, 2.0, -1.0])
    h = 1e-5
    expected = (slopes(at + h * direction) - slopes(at - h * direction)) / (2 * h)
    assert fmu.directional(of, names, list(direction)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("version", [2, 3])
def test_casadis_importer_finds_the_same_plant(version: int, exported: Exported) -> None:
    made = block("plant", case(4))
    assert made.derivative is not None
    parameters = [parameter.start for parameter in made.parameters]
    state = np.array(made.initial(parameters)).ravel() + np.array([1.0, 0.5, 0.1, 0.2, -0.1, 0.1, 0.3, 100, 0.0])
    given, continuous = [signal.start for signal in made.inputs], len(made.continuous)
    imported = ca.DaeBuilder("plant", str(fmpy.extract(str(exported("plant", version))))).create(
        "imported", ["x", "u"], ["ode", "y"]
    )
    for found, expected in zip(
        imported(state[:continuous], given), made.derivative(state, given, parameters), strict=True
    ):
        assert np.array(found).ravel() == pytest.approx(np.array(expected).ravel(), rel=1e-12)
    found = imported.jacobian()(state[:continuous], given, 0, 0)[0]
    expected = made.derivative.jacobian()(state, given, parameters, 0, 0)[0][:, :continuous]
    assert np.array(found) == pytest.approx(np.array(ca.DM(expected).full()), rel=1e-12, abs=1e-9)


def test_model_exchange_and_co_simulation_agree(exported: Exported) -> None:
    stepped, flowing = Instance(exported("plant", 2)), Instance(exported("plant", 2), exchange=True)
    for instance in (stepped, flowing):
        instance.set(tau_1=60.0, tau_2=20.0)
    states = [f"state.{state.name}" for state in block("plant", case(4)).continuous]
    slopes = [f"der({name})" for name in states]

    def slope(at: np.ndarray) -> np.ndarray:
        flowing.put(states, list(at))
        return np.array(flowing.get(*slopes))

    at, h = np.array(flowing.get(*states)), 5e-5
    for _ in range(2000):
        k_1 = slope(at)
        k_2 = slope(at + h / 2 * k_1)
        k_3 = slope(at + h / 2 * k_2)
        at = at + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + slope(at + h * k_3))
    stepped.step(100)
    assert at[:6] == pytest.approx(stepped.get(*STATE), abs=1e-5)


@pytest.mark.parametrize("version", [2, 3])
def test_a_variable_step_solver_finds_its_way_by_what_the_description_proposes(
    version: int, exported: Exported
) -> None:
    path, torques = str(exported("plant", version)), {"tau_1": 100.0, "tau_2": 4.5}  # hard: rope 2 goes slack
    slopes = fmpy.simulate_fmu(path, fmi_type="ModelExchange", start_values=torques, stop_time=2.0, output=["x"])
    steps = fmpy.simulate_fmu(
        path, fmi_type="CoSimulation", start_values=torques, stop_time=2.0, step_size=STEP, output=["x"]
    )
    found = np.interp(slopes["time"], steps["time"], steps["x"])[-1]
    assert slopes["x"][-1] == pytest.approx(found, abs=1e-6)
    names = [variable.name for variable in fmpy.read_model_description(path).modelVariables]
    assert "der(state.sample)" in names
    assert "der(state.slow)" not in names
