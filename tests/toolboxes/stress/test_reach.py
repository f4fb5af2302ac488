from functools import cache

from dualwinch.toolboxes.stress.imperfections import ScaledEnsemble, imperfections, union
from dualwinch.toolboxes.stress.sizes import HIGHEST, LOWEST, STEPS, SizeRange, joint_range, size, size_range, sizes_at
from tests.toolboxes.stress.ensembles import bare, of

TEXT = """
[distributions]
plant.vehicle.mass = { uniform = [0.5, 1.5], of = "nominal" }
[simulation]
delay_samples = 1
jitter = 1e-4
[sensors]
position_bias = 0.02
[actuator]
kind = "motor"
[plant.vehicle]
added_mass = 100
"""


@cache
def reaches() -> tuple[ScaledEnsemble, dict[str, SizeRange]]:
    base = bare()
    together = union(base, of(TEXT, base))
    scaling = ScaledEnsemble(base, together, imperfections(base, together), 20, 0)
    return scaling, {imperfection.label: size_range(scaling, imperfection) for imperfection in scaling.single}


def test_ranges_end_where_values_do() -> None:
    _, found = reaches()
    assert found["vehicle added mass"] == SizeRange(LOWEST, HIGHEST)
    assert found["delay samples"] == SizeRange(LOWEST, STEPS)
    assert found["actuator"] == SizeRange(0, 0)
    assert found["jitter"].top == 5  # 4.2 times 0.1 ms are less than half a sample
    assert "simulation.jitter = 0.000562341: must be < 0.0005 s" in found["jitter"].obstacle
    assert found["position bias"].top == 5
    assert found["position bias"].obstacle.startswith(
        "sensors.position_bias: must be a finite number >= -0.1 and <= 0.1"
    )
    assert 1.7 < size(found["vehicle mass"].top) < 2.5  # at 2 the least mass of the distribution is 0


def test_together_each_stays_where_its_range_ends() -> None:
    scaling, ranges = reaches()
    single = {imperfection: ranges[imperfection.label] for imperfection in scaling.single}
    assert joint_range(scaling, single) == SizeRange(LOWEST, HIGHEST)
    at_most, small = sizes_at(HIGHEST, single), sizes_at(-STEPS, single)
    assert at_most["plant.vehicle.added_mass"] == 100.0
    assert at_most["simulation.delay_samples"] == 10.0
    assert at_most["simulation.jitter"] == size(5)
    assert at_most["actuator.kind"] == 1.0
    assert small["actuator.kind"] == small["simulation.jitter"] == 0.1


def test_what_cannot_be_scaled_at_all_has_no_rungs() -> None:
    assert SizeRange(LOWEST, LOWEST - 1, "out of range").steps == []
    assert SizeRange(0, 0).steps == [0]
    scaling, _ = reaches()
    (mass,) = [imperfection for imperfection in scaling.single if imperfection.label == "vehicle mass"]
    assert sizes_at(0, {mass: SizeRange(LOWEST, LOWEST - 1, "out of range")}) == {"plant.vehicle.mass": 0.0}
