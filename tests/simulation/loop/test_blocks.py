import numpy as np
import pytest

from dualwinch.codegen.block import Block
from dualwinch.controllers.controller import Controller, controller_step, initial_controller_state, own_signals
from dualwinch.controllers.parts import Measurement
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from tests.tiers import each_choice


def names(variables) -> list[str]:
    return [variable.name for variable in variables]


def values(variables) -> list[float]:
    return [variable.start for variable in variables]


def flat(column) -> np.ndarray:
    return np.array(column).ravel()


@pytest.mark.parametrize("number", [1, 4])
def test_plant_and_controller_connected_give_the_run_of_simulate(number: int) -> None:
    experiment, samples = case(number), 400
    controller, plant = block("controller", experiment), block("plant", experiment)
    gains, constants = values(controller.parameters), values(plant.parameters)
    motion, memory = plant.initial(constants), controller.initial(gains)
    assert plant.output is not None
    seen = dict(zip(names(plant.outputs), flat(plant.output(motion, constants)), strict=True))
    rows = []
    for x_ref, v_ref, a_ref in exogenous_signals(experiment)[:samples, :3]:
        given = seen | {"x_ref": x_ref, "v_ref": v_ref, "a_ref": a_ref}
        memory, told = controller.step(memory, [given[name] for name in names(controller.inputs)], gains)
        tau_1, tau_2 = flat(told)[:2]
        rows.append([seen["x"], seen["F1"], seen["F2"], tau_1, tau_2])
        motion, output = plant.step(motion, [tau_1, tau_2, 0, 0, 0], constants)
        seen = dict(zip(names(plant.outputs), flat(output), strict=True))
    columns = simulate(experiment).columns
    expected = np.column_stack([columns[name][:samples] for name in ("x", "F1", "F2", "tau_1", "tau_2")])
    np.testing.assert_allclose(rows, expected, rtol=1e-8, atol=1e-9)


def test_closed_loop_block_is_the_closed_loop_without_its_sums() -> None:
    experiment = case(4)
    loop, exported = closed_loop(structure_of(experiment)), block("closed-loop", experiment)
    outside = dict(zip(loop.exogenous, exogenous_signals(experiment)[7], strict=True))
    start = initial_state_of(experiment)
    following, row, _ = loop.step(list(start.values()), list(outside.values()), [*parameters_of(experiment).values()])
    given = [outside[name] for name in names(exported.inputs)]
    assert values(exported.states) == [start[name] for name in names(exported.states)]
    next_state, output = exported.step(values(exported.states), given, values(exported.parameters))
    expected = dict(zip(loop.states, flat(following), strict=True))
    np.testing.assert_array_equal(flat(next_state), [expected[name] for name in names(exported.states)])
    np.testing.assert_array_equal(flat(output), flat(row))
    assert not [name for name in names(exported.states) if name.startswith("metrics.")]


def test_derivative_is_the_slope_of_the_plant_that_steps() -> None:
    experiment = case(4)
    plant = block("plant", experiment)
    assert plant.derivative is not None
    constants = dict(zip(names(plant.parameters), values(plant.parameters), strict=True))
    constants["simulation.sample_time"] = 1e-7
    numbers = list(constants.values())
    state = np.add(values(plant.states), [20, 1.5, 25, 1.875, -25, -1.875, 0.3, 2e8, 0])
    given = [60.0, 20.0, 5.0, 0.1, 30.0]
    slope, output = plant.derivative(state, given, numbers)
    moved, _ = plant.step(state, given, numbers)
    assert names(plant.states)[len(plant.continuous) :] == ["slow"]  # the integrator's memory
    change = (flat(moved) - state)[: len(plant.continuous)] / 1e-7
    np.testing.assert_allclose(change, flat(slope), rtol=1e-3, atol=1e-6)
    assert plant.output is not None
    np.testing.assert_array_equal(flat(output), flat(plant.output(state, numbers)))


def test_variables_know_unit_range_and_source() -> None:
    gains = {variable.name: variable for variable in block("controller", case(4)).parameters}
    beta = gains["controller.nftsm.beta"]
    assert (beta.start, beta.lower, beta.upper, beta.source) == (0.05, 0.0, np.inf, "paper 4.1")
    assert gains["nominal.vehicle.mass"].unit == "kg"
    assert "controller.adrc.bandwidth" not in gains
    vortex = {variable.name: variable for variable in block("plant", case(4)).parameters}["disturbance.vortex"]
    assert (vortex.start, vortex.lower, vortex.upper, vortex.source) == (1.0, 0.0, 1.0, "configuration")


@pytest.mark.parametrize(("estimator", "coordination"), each_choice(ESTIMATORS, COORDINATIONS))
def test_every_estimator_and_coordination_becomes_a_block(estimator: str, coordination: str) -> None:
    """Its step is that of the controller, state by state; what the estimator knows is among the outputs."""
    controller = Controller(ESTIMATORS[estimator](), coordination=COORDINATIONS[coordination]())
    made, start = block("controller", Experiment(controller=controller)), initial_controller_state(controller)
    assert names(made.states) == list(leaves(start))
    assert flat(made.initial(values(made.parameters))).tolist() == list(leaves(start).values())
    sensed = dict.fromkeys(describe(Measurement), 0.1) | {"F1": 1500.0, "F2": 900.0}
    wanted = {"x_ref": 0.2, "v_ref": 0.3, "a_ref": 0.1}
    point = Setpoint(*wanted.values())
    state, output = controller_step(start, Measurement(**sensed), point, controller, Plant(), 1e-3)
    given = [(sensed | wanted)[name] for name in names(made.inputs)]
    following, told = made.step(values(made.states), given, values(made.parameters))
    assert flat(following) == pytest.approx(np.array(list(leaves(state).values()), float), rel=1e-9, abs=1e-12)
    found = dict(zip(names(made.outputs), flat(told), strict=True))
    expected = leaves(output.winches) | {name: value for name, (value, _) in own_signals(output).items()}
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_every_law_becomes_a_block_with_the_inputs_it_uses(kind: str) -> None:
    made: Block = block("controller", Experiment(controller=Controller(law=POSITION_LAWS[kind]())))
    assert {"x", "v", "F1", "F2", "x_ref"} <= set(names(made.inputs)) | {"x_ref"}
    assert "theta_1" not in names(made.inputs)
    assert len(made.initial(values(made.parameters)).full()) == len(made.states)
