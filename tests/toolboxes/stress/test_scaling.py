from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.toolboxes.stress.imperfections import ScaledEnsemble, amount_of, between, imperfections, union
from tests.toolboxes.stress.ensembles import DRUMS, bare, of, rig, sea


def scaling_of(base: Ensemble, ensemble: Ensemble, count: int = 3, seed: int = 5) -> ScaledEnsemble:
    together = union(base, ensemble)
    return ScaledEnsemble(base, together, imperfections(base, together), count, seed)


def own(ensemble: Ensemble) -> Ensemble:
    return replace(ensemble, experiment=replace(ensemble.experiment, controller=paper_controller()))


@pytest.mark.parametrize("index", [0, 2])
def test_all_at_size_1_is_the_ensemble_and_nothing_is_the_base(index: int) -> None:
    """Not to a tolerance: the same experiment, and the same plant that its controller was designed for."""
    scaling = scaling_of(sea(), rig())
    whole = scaling.scenario(index, paper_controller(), dict.fromkeys(scaling.keys, 1.0))
    expected = own(rig()).scenario(index, 5)
    assert whole.experiment == expected.experiment
    assert whole.nominal == expected.nominal
    nothing = leaves(scaling.scenario(index, paper_controller(), {}).experiment)
    base = own(sea()).scenario(index, 5)
    shape_parameters = {key for key, leaf in describe(Experiment).items() if Mark.SHAPE_PARAMETER in leaf.marks}
    assert {key for key, value in leaves(base.experiment).items() if nothing[key] != value} <= shape_parameters
    assert base.nominal.vehicle == scaling.scenario(index, paper_controller(), {}).nominal.vehicle


@settings(max_examples=30)
@given(size=st.floats(1e-3, 100), index=st.integers(0, 2))
def test_departures_from_the_base_grow_with_the_size(size: float, index: int) -> None:
    scaling = SCALING
    key = "plant.winch_2.drum_radius"
    at = {s: scaling.values(index, {key: s})[key] for s in (0.0, 1.0, size)}
    assert at[0.0] == 0.8
    assert 0 < abs(at[1.0] - 0.8) <= 0.0016
    assert at[size] - 0.8 == pytest.approx(size * (at[1.0] - 0.8), rel=1e-9, abs=1e-15)
    assert scaling.values(index, {key: size})["plant.winch_1.drum_radius"] == 0.8


SCALING = scaling_of(bare(), of(DRUMS, bare()))


@pytest.mark.parametrize(("size", "words"), [(1.0, "100 to 1000 N s/m"), (0.5, "550 to 1000 N s/m")])
def test_draws_to_one_side_of_the_nominal_value_are_said_as_values(size: float, words: str) -> None:
    damping = 'plant.rope_1.damping = { kind = "log-uniform", low = 100, high = 1000 }'
    scaling = scaling_of(bare(), of(f"[distributions]\n{damping}\n", bare()))
    assert str(amount_of(scaling, scaling.single[0], size)) == words


@pytest.mark.parametrize(("size", "words"), [(1.0, "96 to 144 kg m²"), (0.5, "48.9 to 72.9 kg m²")])
def test_shares_of_another_nominal_value_are_said_as_values(size: float, words: str) -> None:
    drawn = '{ uniform = [0.8, 1.2], of = "nominal" }'
    text = f"[plant.winch_1]\ninertia = 120\n[distributions]\nplant.winch_1.inertia = {drawn}\n"
    scaling = scaling_of(bare(), of(text, bare()))
    assert str(amount_of(scaling, scaling.single[0], size)) == words


def test_a_drawn_radius_is_unknown_to_the_controller_and_a_set_one_is_not() -> None:
    drawn = SCALING.scenario(0, paper_controller(), {"plant.winch_1.drum_radius": 10.0})
    assert drawn.nominal.winch_1.drum_radius == 0.8
    assert drawn.experiment.plant.winch_1.drum_radius != 0.8
    fixed = scaling_of(bare(), of("[plant.winch_1]\ndrum_radius = 0.81\n", bare()))
    known = fixed.scenario(0, paper_controller(), {"plant.winch_1.drum_radius": 2.0})
    assert known.nominal.winch_1.drum_radius == known.experiment.plant.winch_1.drum_radius == pytest.approx(0.82)


def test_whole_numbers_are_rounded_counts_become_fewer_and_switches_are_thrown() -> None:
    text = "[simulation]\ndelay_samples = 3\n[sensors]\nencoder_counts = 1000\n[disturbance]\nvortex = true\n"
    known = scaling_of(bare(), of(text, bare())).known
    delay, counts, vortex = (
        known[key] for key in ("simulation.delay_samples", "sensors.encoder_counts", "disturbance.vortex")
    )
    assert [between(delay, 1, 3, size) for size in (0, 0.2, 0.3, 1, 2)] == [1, 1, 2, 3, 5]
    assert [between(counts, 0, 1000, size) for size in (0, 0.1, 1, 10, 1e9)] == [0, 10000, 1000, 100, 1]
    assert between(counts, 4000, 2000, 3) == 1000  # steps of 1/4000, 1/2000, then 1/1000
    off, on = False, True
    assert [between(vortex, off, on, size) for size in (0, 0.99, 1, 10)] == [off, off, on, on]


def test_a_part_of_another_kind_is_there_from_size_1_on() -> None:
    scaling = scaling_of(bare(), of('[actuator]\nkind = "motor"\nmotor.time_constant = 2e-3\n', bare()))
    (motor,) = scaling.single
    assert scaling.switched(motor)
    made = [
        leaves(scaling.scenario(0, paper_controller(), dict.fromkeys(motor.keys, size)).experiment)
        for size in (0.9, 1.0, 10.0)
    ]
    assert [values["actuator.kind"] for values in made] == ["ideal", "motor", "motor"]
    assert [values.get("actuator.motor.time_constant") for values in made] == [None, 2e-3, 2e-3]


def test_an_obstacle_names_key_and_range() -> None:
    wide = of('[distributions]\nplant.vehicle.mass = { uniform = [0.5, 1.5], of = "nominal" }\n', bare())
    scaling = scaling_of(bare(), wide, count=20)
    assert scaling.obstacle({"plant.vehicle.mass": 1.0}) == ""
    assert scaling.obstacle({"plant.vehicle.mass": 4.0}).startswith("plant.vehicle.mass: must be a finite number > 0")
    late = scaling_of(bare(), of("[simulation]\njitter = 1e-4\n", bare()))
    assert "simulation.jitter = 0.0006: must be < 0.0005 s" in late.obstacle({"simulation.jitter": 6.0})
