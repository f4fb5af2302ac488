from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.plugins import register
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import Choice, Drawn, Ensemble, Uniform
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.own_metrics import Room

SEA = load_ensemble("sea")
MASS = "plant.vehicle.mass"


def test_draws_have_the_moments_of_their_distributions_and_do_not_depend_on_each_other() -> None:
    count = 1500
    drawn = [scenario.draws for scenario in SEA.scenarios(count, seed=3)]
    for key, entry in SEA.distributions.items():
        values = np.array([draws[key] for draws in drawn], dtype=float)
        low, high = map(float, entry.ends(getattr_path(key)))
        sigma = (high - low) / np.sqrt(12)
        assert low <= values.min() < values.max() <= high
        assert values.mean() == pytest.approx((low + high) / 2, abs=4 * sigma / np.sqrt(count))
        assert values.std() == pytest.approx(sigma, rel=0.06)
    table = np.array([[draws[key] for key in SEA.distributions] for draws in drawn], dtype=float)
    correlations = np.corrcoef(table.T) - np.eye(table.shape[1])
    assert np.abs(correlations).max() < 4.5 / np.sqrt(count)
    assert len({draws["simulation.seed"] for draws in drawn}) == count


def getattr_path(key: str) -> float:
    value: object = SEA.experiment
    for name in key.split("."):
        value = getattr(value, name)
    assert isinstance(value, float)
    return value


def test_the_same_seed_gives_the_same_bits_and_another_gives_others() -> None:
    assert SEA.scenario(5, 7) == SEA.scenario(5, 7)
    assert SEA.scenario(5, 7).draws[MASS] != SEA.scenario(5, 8).draws[MASS]
    assert SEA.scenario(5, 7).draws[MASS] != SEA.scenario(6, 7).draws[MASS]
    # pinned: the draws of a seed are part of what a stored result means
    assert SEA.scenario(3, 7).draws[MASS] == pytest.approx(9974.428872183355, rel=1e-15)
    assert SEA.scenario(3, 7).draws["simulation.seed"] == 6579466253948726


def test_a_scenario_does_not_depend_on_how_many_are_drawn() -> None:
    assert list(SEA.scenarios(3, 7)) == list(SEA.scenarios(9, 7))[:3]


def test_a_further_distribution_leaves_the_other_draws_as_they_are() -> None:
    more = replace(SEA, distributions={"plant.vehicle.height": Drawn(Uniform(2.0, 3.0)), **SEA.distributions})
    before, after = SEA.scenario(2, 7).draws, more.scenario(2, 7).draws
    assert {key: after[key] for key in before} == before


def test_a_group_rises_and_falls_together() -> None:
    first, second = "plant.rope_1.modulus", "plant.rope_2.modulus"
    ropes = {first: Uniform(0.9, 1.1), second: Uniform(0.8, 1.2)}
    together = {key: Drawn(shape, relative=True, together="ropes") for key, shape in ropes.items()}
    for scenario in Ensemble("ropes", "", case(2), together).scenarios(5, 0):
        factors = [float(scenario.draws[key]) / 80e9 - 1 for key in (first, second)]
        assert factors[1] == pytest.approx(2 * factors[0])


def test_the_seed_of_a_scenario_can_be_fixed() -> None:
    fixed = replace(SEA, distributions={"simulation.seed": Drawn(Choice((7,)))})
    assert {scenario.experiment.simulation.seed for scenario in fixed.scenarios(4, 0)} == {7}


def test_every_key_that_shapes_the_compiled_code_is_known_as_one() -> None:
    register(Room)
    others = {
        "controller.kind": "nftsm",
        "controller.estimator": "kalman",
        "controller.coordination.kind": "master-slave",
        "plant.rope_slack": False,
        "simulation.integrator": "rk4",
        "simulation.substeps": 3,
        "simulation.delay_samples": 4,
        "simulation.readings": True,
        "sensors.speed": "none",
        "sensors.tension": "none",
        "metrics": ["room"],
        "actuator.kind": "motor",
        "plant.rope_1.segments": 3,
        "plant.rope_2.segments": 3,
    }
    alone = {"plant.rope_1.kind", "plant.rope_2.kind", "sensors.outage", "sensors.memory", "simulation.engine"}
    shaping = {key for key, leaf in describe_parts(SEA.experiment).items() if leaf.shapes_code}
    assert set(others) | alone == shaping
    for key, value in others.items():
        assert structure_of(override(SEA.experiment, {key: value})) != structure_of(SEA.experiment), key


def test_every_scenario_has_the_structure_of_the_ensemble() -> None:
    assert {structure_of(scenario.experiment) for scenario in SEA.scenarios(20, 0)} == {structure_of(SEA.experiment)}


def test_the_controller_keeps_the_nominal_values() -> None:
    scenario = SEA.scenario(0, 7)
    values = parameters_of(scenario.experiment, scenario.nominal)
    nominal = parameters_of(SEA.experiment)
    for key in SEA.distributions:
        if key.startswith("plant."):
            assert values[key] == scenario.draws[key] != nominal[key]
            name = "nominal." + key.removeprefix("plant.")
            assert values[name] == nominal[name]


def test_a_scenario_runs_like_an_experiment_whose_controller_is_told_the_nominal_values() -> None:
    keys = ("mass", "drag_coefficient", "friction_coefficient")
    base = override(case(4), {"simulation.duration": 2.0})
    only = Ensemble("", "", base, {f"plant.vehicle.{key}": SEA.distributions[f"plant.vehicle.{key}"] for key in keys})
    scenario = only.scenario(1, 7)
    designed = {f"controller.nominal.{key}": getattr(base.plant.vehicle, key) for key in keys}
    told = simulate(override(scenario.experiment, designed))
    assert simulate(scenario.experiment, nominal=scenario.nominal).final_state == told.final_state
    assert simulate(scenario.experiment).final_state != told.final_state


@pytest.mark.parametrize(
    ("distributions", "message"),
    [
        ({"plant.vehicle.mas": Drawn(Uniform(1, 2))}, "plant.vehicle.mas: is drawn, and no key of this experiment"),
        ({"plant.vehicle.mass": Uniform(1, 2)}, "plant.vehicle.mass: must be Drawn(distribution), not Uniform"),
        (
            {"controller.nominal.mass": Drawn(Uniform(1, 2), relative=True)},
            "controller.nominal.mass: has no nominal value of its own that a draw could be a factor on",
        ),
        ({"controller.adrc.control_bandwidth": Drawn(Uniform(1, 2))}, "and no key of this experiment"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(distributions: Any, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        replace(SEA, distributions=distributions)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_scenarios_drawn_together_are_those_drawn_alone() -> None:
    indices = [5, 0, 2**64 - 1, 5]
    for vertex in (False, True):
        together = SEA.chosen(indices, 7, vertex=vertex)
        assert together == [SEA.scenario(index, 7, vertex=vertex) for index in indices]
    assert SEA.chosen([], 7) == []
    largest = 2**64 - 1
    with pytest.raises(ConfigurationError, match=rf"^scenario {2**64}: must be a whole number from 0 to {largest}$"):
        SEA.scenario(2**64, 7)


def test_an_experiment_is_made_where_it_is_asked_for() -> None:
    scenario = SEA.scenario(3, 7)
    assert scenario.base is SEA.experiment
    assert {key: leaves(scenario.experiment)[key] for key in scenario.draws} == scenario.draws
    assert scenario.experiment is scenario.experiment
