"""What shapes the compiled code, what is a number it takes, and what of that is zero for good."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from dualwinch.codegen.errors import DualwinchError
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.heavy_ropes import sag_shortening
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.ropes import Rope, Track
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import (
    parameters_of,
    structure_of,
    zeros_of,
)
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from tests.tiers import pairwise

FILTER_TIME, NOISE = "controller.speed_filter_time", "sensors.speed_noise"


def test_every_part_there_is_has_code_of_its_own() -> None:
    controllers = [Controller(law=law()) for law in POSITION_LAWS.values()]
    controllers += [Controller(estimator=estimator()) for estimator in ESTIMATORS.values()]
    controllers += [Controller(coordination=coordination()) for coordination in COORDINATIONS.values()]
    structures = {structure_of(Experiment(controller=controller)) for controller in controllers}
    assert len(structures) == len(controllers) - 2, "the default is in all three lists"


@pytest.mark.parametrize(
    ("values", "shapes"),
    [
        ({"controller.nftsm.beta": 0.1, "plant.vehicle.mass": 9e3, "sensors.speed_noise": 1e-3}, False),
        ({"controller.nominal.mass": 9e3}, False),
        ({"disturbance.vortex": False, "disturbance.current_sigma": 0.1, "reference.kind": "uniform"}, False),
        ({"simulation.duration": 3, "simulation.sample_time": 5e-4}, False),
        ({"simulation.engine": "casadi"}, False),
        ({"plant.rope_slack": False}, True),
        ({"plant.rope_1.mass_per_length": 2.36}, True),
        ({"plant.rope_2.submerged_weight": 20.0, "plant.rope_2.added_mass_per_length": 3.0}, True),
        ({"plant.track.roller_spacing": 1.0}, True),
        ({"plant.winch_1.gear_stiffness": 1e6, "plant.winch_1.rotor_inertia": 0.02}, True),
        ({"plant.winch_1.rotor_inertia": 0.02, "plant.rope_1.spare_length": 7.0}, False),
        ({"plant.rope_1.hysteresis": 7.0}, True),
        ({"plant.vehicle.bristle_stiffness": 5e6}, True),
        ({"sensors.load_cell_time_constant": 1e-3}, True),
        ({"sensors.drum_speed_resolution": 1e-3}, True),
        ({"plant.vehicle.stiction": 0.5, "plant.track.tilt": 1e-3, "plant.track.waviness": 1e-3}, False),
        ({"simulation.delay_samples": 2}, True),
        ({"simulation.substeps": 7}, True),
        ({"simulation.integrator": "rk4"}, True),
        ({"controller.kind": "nftsm"}, True),
        ({"actuator.kind": "motor"}, True),
    ],
)
def test_what_shapes_the_code(values: dict[str, Any], shapes: bool) -> None:
    assert (structure_of(override(case(4), values)) != structure_of(case(4))) is shapes


def test_the_keys_that_shape_the_code_are_known_by_their_marks() -> None:
    assert {key for key, leaf in describe_parts(case(4)).items() if leaf.shapes_code} == {
        *("controller.kind", "controller.estimator", "controller.coordination.kind"),
        *("plant.rope_1.kind", "plant.rope_2.kind", "actuator.kind", "metrics"),
        *("plant.rope_1.segments", "plant.rope_2.segments"),
        *(
            "plant.rope_slack",
            "simulation.delay_samples",
            "simulation.substeps",
            "simulation.integrator",
            "simulation.engine",
            "simulation.readings",
            "sensors.outage",
            "sensors.memory",
            "sensors.speed",
            "sensors.tension",
        ),
    }


@pytest.mark.parametrize(("law", "estimator", "coordination"), pairwise(POSITION_LAWS, ESTIMATORS, COORDINATIONS))
def test_all_experiments_of_a_structure_have_its_parameters(law: str, estimator: str, coordination: str) -> None:
    controller = Controller(ESTIMATORS[estimator](), POSITION_LAWS[law](), coordination=COORDINATIONS[coordination]())
    experiment = override(Experiment(controller=controller), {"controller.nominal.mass": 9e3})
    structure = structure_of(experiment)
    assert list(structure.parameters) == list(parameters_of(experiment))
    assert not [key for key in parameters_of(experiment) if key.startswith("controller.nominal.")]


def test_what_the_controller_assumes_is_the_nominal_plant() -> None:
    designed = Plant(vehicle=Vehicle(mass=8e3, added_mass=1e3, drag_coefficient=0.5))
    values = parameters_of(override(case(4), {"controller.nominal.mass": 7e3}), designed)
    assert (values["nominal.vehicle.mass"], values["nominal.vehicle.added_mass"]) == (7e3, 0)
    assert (values["nominal.vehicle.drag_coefficient"], values["plant.vehicle.drag_coefficient"]) == (0.5, 0.3)


def test_numbers_of_another_structure_are_refused() -> None:
    loop = closed_loop(structure_of(case(4)))
    values = parameters_of(case(4))
    assert np.array_equal(loop.vector(values), list(values.values()))
    with pytest.raises(DualwinchError, match=r"not the parameters of this closed loop; what differs: .*observer\.kf"):
        loop.vector(parameters_of(case(4, "nftsm")))
    with pytest.raises(DualwinchError, match="what differs: their order"):
        loop.vector(dict(reversed(values.items())))


def test_zeros_are_those_that_all_have_and_that_are_often_zero() -> None:
    structure, calm = structure_of(case(4)), parameters_of(case(4))
    zeros = zeros_of(structure, calm)
    assert {FILTER_TIME, NOISE, "controller.winch_1.kd", "controller.winch_2.kd"} <= zeros
    assert "plant.vehicle.added_mass" in {key for key, value in calm.items() if not value}
    assert {key for key in zeros if calm[key]} == set()
    noisy = parameters_of(override(case(4), {NOISE: 1e-3}))
    assert zeros_of(structure, calm, noisy) == zeros - {NOISE}
    assert zeros_of(structure, calm, varying=[FILTER_TIME]) == zeros - {FILTER_TIME}
    without_observer = override(case(4), {"controller.observer.l0": 0, "controller.nftsm.eta": 0})
    assert zeros_of(structure, parameters_of(without_observer)) == zeros, "no mark, no code of their own"


def test_what_is_zero_for_good_is_not_looked_at() -> None:
    structure, values = structure_of(case(4)), parameters_of(case(4))
    lean, whole = closed_loop(structure, frozenset({FILTER_TIME})), closed_loop(structure)
    state, outside = np.linspace(0.1, 1, len(whole.states)), np.full(len(whole.exogenous), 0.3)

    def following(loop: Any, filter_time: float) -> np.ndarray:
        return np.array(loop.step(state, outside, loop.vector(values | {FILTER_TIME: filter_time}))[0]).ravel()

    assert np.array_equal(following(lean, 0.2), following(lean, 0.0))
    assert np.array_equal(following(lean, 0.2), following(whole, 0.0))
    assert not np.array_equal(following(whole, 0.2), following(whole, 0.0))


def test_what_a_controller_assumes_may_lack_what_the_machine_has() -> None:
    """Code is shaped by the machine; of a plant without sag or hysteresis, a controller of it assumes zeros."""
    heavy = {f"plant.rope_{side}.submerged_weight": 20.2 for side in (1, 2)}
    heavy |= {"plant.track.roller_spacing": 1.0, "plant.rope_1.hysteresis": 7.0}
    machine = override(case(4), heavy)
    known, nominal = parameters_of(machine), parameters_of(machine, Plant())
    assert list(nominal) == list(known)
    assert (known["nominal.track.roller_spacing"], nominal["nominal.track.roller_spacing"]) == (1.0, 0.0)
    weight: Any = ca.SX.sym("weight")
    spacing: Any = ca.SX.sym("spacing")
    sag = sag_shortening(Rope(submerged_weight=weight), 1000.0, 20.0, Track(roller_spacing=spacing))
    assert float(ca.Function("sag", [weight, spacing], [sag])(0, 0)) == 0
