import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.toolboxes.stress.imperfections import ALL, Imperfection, all_together, imperfections, union
from tests.toolboxes.stress.ensembles import DRUMS, bare, of, rig, sea


def names(base, ensemble) -> list[str]:
    return [imperfection.name for imperfection in imperfections(base, union(base, ensemble))]


def test_keys_that_differ_only_in_a_number_are_one() -> None:
    base = bare()
    (found,) = imperfections(base, union(base, of(DRUMS, base)))
    assert found == Imperfection("plant.winch.drum_radius", ("plant.winch_1.drum_radius", "plant.winch_2.drum_radius"))
    assert found.label == "winch drum radius"
    text = "[sensors]\nencoder_zero_1 = 1e-3\nencoder_zero_2 = 2e-3\n[plant.creep_2]\nelongation = 1e-3\n"
    assert names(base, of(text, base)) == ["plant.creep.elongation", "sensors.encoder_zero"]


def test_the_rig_has_what_the_sea_lacks_and_nothing_else() -> None:
    found = names(sea(), rig())
    assert {"plant.winch.radius_error", "sensors.outage_length", "simulation.jitter", "actuator.kind"} <= set(found)
    assert not {"plant.vehicle.mass", "disturbance.vortex", "sensors.speed_noise"} & set(found)


def test_how_something_comes_and_goes_is_no_imperfection() -> None:
    """Neither where it is set nor where it is drawn; nor are motion, gains and method."""
    base = bare()
    text = """
    [distributions]
    plant.winch_1.eccentricity_angle = { uniform = [0, 3] }
    sensors.outage_period = { uniform = [5, 9] }
    [disturbance]
    current_time = 10.0
    [reference]
    speed = 1.5
    [controller.observer]
    l0 = 7.0
    [simulation]
    substeps = 7
    seed = 3
    """
    with pytest.raises(ConfigurationError, match="ensemble 'ensemble': has no imperfection that its base 'bare' lacks"):
        names(base, of(text, base))


def test_another_distribution_of_the_same_key_is_an_imperfection_and_the_same_is_none() -> None:
    text = '[distributions]\nplant.vehicle.mass = { uniform = [0.9, 1.1], of = "nominal" }\n'
    base = of(text, bare())
    wider = of(text.replace("0.9", "0.8"), base)
    with pytest.raises(ConfigurationError, match="no imperfection"):
        names(base, base)
    assert names(base, wider) == ["plant.vehicle.mass"]
    assert names(base, of(text + "[plant.vehicle]\nmass = 1.2e4\n", base)) == ["plant.vehicle.mass"]


def test_a_part_of_another_kind_comes_with_its_numbers() -> None:
    base = bare()
    text = '[actuator]\nkind = "motor"\n[distributions]\nactuator.motor.time_constant = { uniform = [1e-3, 2e-3] }\n'
    (found,) = imperfections(base, union(base, of(text, base)))
    assert found.label == "actuator"
    assert {"actuator.kind", "actuator.motor.time_constant"} <= set(found.keys)


def test_what_the_base_draws_is_drawn_on() -> None:
    together = union(sea(), of(DRUMS, sea()))
    assert {"plant.vehicle.mass", "plant.winch_1.drum_radius"} <= set(together.distributions)


def test_all_together_have_all_keys() -> None:
    single = imperfections(sea(), union(sea(), rig()))
    every = all_together(single)
    assert every.name == every.label == ALL
    assert len(every.keys) == len(set(every.keys)) == sum(len(imperfection.keys) for imperfection in single)


def test_drawn_gains_are_refused() -> None:
    drawn = of("[distributions]\ncontroller.observer.l0 = { uniform = [3, 5] }\n", bare())
    with pytest.raises(ConfigurationError, match=r"controller\.observer\.l0: is drawn in an ensemble"):
        union(bare(), drawn)
