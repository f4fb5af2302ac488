"""Ropes that are not registered: whatever works with the paper's works with these."""

from dataclasses import fields, replace

import numpy as np
import pytest

from dualwinch.controllers.estimators.calibrating_kalman import CalibratingKalman
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.ropes import Rope, RopeLaw
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.batch.sensitivities import sensitivities
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.oracle.sampled import Scenario, run
from tests.own_ropes import Bedding, Fading, Root, Stiffening
from tests.plant_points import linearise, operating_point

EXPERIMENT = replace(case(4, rope=Stiffening()), simulation=Simulation(duration=1.0))
SOFT = "plant.rope_1.soft"


def stiffening(stretch: float, rate: float, length: float) -> float:
    """The law of `Stiffening`, once more."""
    return 4e6 * stretch / length + 8e9 * stretch * abs(stretch) / length**2 + 1000 * rate


@pytest.mark.parametrize(
    ("number", "slack", "substeps", "position", "force"),
    [
        (4, True, 5, 1e-8, 0.1),
        (1, False, 5, 2e-8, 0.1),
        (1, True, 5, 5e-6, 8.0),
        pytest.param(4, False, 5, 1e-8, 0.1, marks=pytest.mark.slow),
        pytest.param(1, True, 32, 1e-7, 0.5, marks=pytest.mark.slow),
    ],
)
def test_a_run_equals_that_of_the_independent_implementation(
    number: int, slack: bool, substeps: int, position: float, force: float
) -> None:
    """Position in m and rad, force in N. In Case 1 the speed step slackens rope 2, where rk4 is of first order."""
    values = {"simulation.duration": 1.5, "simulation.substeps": substeps, "plant.rope_slack": slack}
    ours = simulate(override(case(number, rope=Stiffening()), values))
    theirs = run(Scenario("fando-nftsm", number, {"plant.rope_slack": slack}, law=stiffening), 1500)
    assert ours.integrator == "rk4"
    for name in ("x", "theta_1", "theta_2"):
        assert np.abs(ours[name] - theirs[name]).max() < position, name
    for name in ("F1", "F2"):
        assert np.abs(ours[name] - theirs[name]).max() < force, name
    if number == 1:
        assert theirs["F1"].max() > 7000
        assert (theirs["F2"].min() >= 0) == slack


def own_numbers(experiment: Experiment, table: str) -> list[str]:
    """Numbers of a rope's law beside those of mass and sag that every rope has."""
    of_all = {field.name for field in fields(RopeLaw)}
    names = [key.removeprefix(table) for key in parameters_of(experiment) if key.startswith(table)]
    return [name for name in names if name not in of_all]


def test_each_rope_may_have_a_law_of_its_own() -> None:
    mixed = replace(EXPERIMENT, plant=replace(EXPERIMENT.plant, rope_1=Rope(), rope_2=Bedding()))
    result = simulate(mixed)
    assert (result.outcome, result.integrator) == ("completed", "rk4")
    assert own_numbers(mixed, "plant.rope_2.") == ["scale", "ends"]
    point = operating_point(25.0, 1.0, plant=mixed.plant)
    stretch = 0.8 * point.theta_2 + 25.0
    assert Bedding().tension(stretch, 0.8 * point.omega_2 + 1.0, 25.5) == pytest.approx(point.F2, rel=1e-9)


def test_a_law_that_has_no_value_where_the_rope_is_slack_runs_all_the_same() -> None:
    root = override(case(1, rope=Root()), {"simulation.duration": 1.0})
    result = simulate(root)
    assert (result.outcome, result["F2"].min()) == ("completed", 0.0)
    batch = rollout(["controller.nftsm.beta"], [[0.05]], [root], stride=1)
    assert np.abs(batch.columns["F1"][0, 0] - result["F1"]).max() < 1e-3
    found = sensitivities(["controller.nftsm.beta"], [[0.05]], [root], stride=0)
    assert np.isfinite(found.gradients["mse"]).all()


def test_a_run_begins_with_both_ropes_at_half_the_preload() -> None:
    for rope in (Stiffening(), Bedding()):
        result = simulate(override(case(2, rope=rope), {"simulation.duration": 0.01}))
        assert (result["F1"][0], result["F2"][0]) == (pytest.approx(1000), pytest.approx(1000))


def test_scenarios_of_a_batch_take_the_sub_steps_of_their_own() -> None:
    soft, stiff = EXPERIMENT, override(EXPERIMENT, {SOFT: 4e8, "plant.rope_2.soft": 4e8})
    assert structure_of(soft).substeps < structure_of(stiff).substeps
    scenarios, shares = [stiff, soft, stiff, override(soft, {SOFT: 3.9e6})], []
    batch = rollout(["controller.nftsm.beta"], [[0.05]], scenarios, stride=500, progress=shares.append)
    assert batch.outcomes.tolist() == [["completed"] * 4]
    for index, scenario in enumerate(scenarios):
        alone = rollout(["controller.nftsm.beta"], [[0.05]], [scenario], stride=500)
        assert batch.metrics["mse"][0, index] == alone.metrics["mse"][0, 0], "to the bit"
        assert np.array_equal(batch.columns["F1"][:, index], alone.columns["F1"][:, 0])
    assert shares == sorted(shares)
    assert shares[-1] == 1


@pytest.mark.slow
def test_scenarios_of_sensitivities_take_the_sub_steps_of_their_own() -> None:
    soft, stiff = EXPERIMENT, override(EXPERIMENT, {SOFT: 4e8, "plant.rope_2.soft": 4e8})
    slopes = sensitivities(["controller.nftsm.beta"], [[0.05]], [stiff, soft], stride=0)
    assert slopes.metrics["mse"][0] == pytest.approx([simulate(each).metrics.mse for each in (stiff, soft)], rel=1e-6)
    assert slopes.gradients["mse"].shape == (1, 2, 1)


def test_an_interrupt_leaves_the_scenarios_of_further_groups_out() -> None:
    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    stiff = override(EXPERIMENT, {SOFT: 4e8, "plant.rope_2.soft": 4e8})
    batch = rollout(["controller.nftsm.beta"], [[0.05]], [stiff, EXPERIMENT, stiff], stride=500, progress=interrupt)
    assert batch.interrupted
    assert batch.outcomes.tolist() == [["completed", "not_run", "completed"]]
    assert np.isnan(batch.metrics["mse"][0]).tolist() == [False, True, False]
    assert np.isnan(batch.columns["F1"][0, 1]).all()


def test_scenarios_of_two_lengths_are_no_batch() -> None:
    soft, longer = EXPERIMENT, override(EXPERIMENT, {SOFT: 4e8, "simulation.duration": 2})
    with pytest.raises(ConfigurationError, match=r"^scenarios\[1\]: must have the structure and the length of scen"):
        rollout(["controller.nftsm.beta"], [[0.05]], [soft, longer])
    with pytest.raises(
        ConfigurationError, match=r"^parameters\[0\]: simulation\.substeps = \d+: must be >= \d+ for rk4"
    ):
        rollout([SOFT], [[4e8]], [soft])


def test_the_plant_is_linearised_with_their_spring_rates() -> None:
    slope = linearise(10.0, 1.0, plant=EXPERIMENT.plant)
    point = operating_point(10.0, 1.0, plant=EXPERIMENT.plant)
    k = 4e6 / 40.5 + 2 * 8e9 * (0.8 * point.theta_1 - 10.0) / 40.5**2
    row, column = slope.outputs.index("F1"), slope.states.index("theta_1")
    assert slope.C[row, column] == pytest.approx(0.8 * k, rel=1e-9)


def test_the_nominal_rope_is_the_tangent_rope() -> None:
    values = parameters_of(EXPERIMENT)
    spring, damping = Stiffening().tangent(1000.0, 25.5)
    assert values["nominal.rope_1.modulus"] * values["nominal.rope_1.area"] / 25.5 == pytest.approx(spring)
    assert values["nominal.rope_2.damping"] == damping == 1000
    tighter = parameters_of(override(EXPERIMENT, {"controller.coordination.preload": 4000}))
    assert tighter["nominal.rope_1.modulus"] > values["nominal.rope_1.modulus"]
    kalman = replace(EXPERIMENT, controller=replace(EXPERIMENT.controller, estimator=CalibratingKalman()))
    assert simulate(kalman).outcome == "completed"


def test_a_linear_one_runs_as_the_paper_s() -> None:
    """E A of the wire rope in another law: the exponential integrator and rk4 agree."""
    wire = Stiffening(soft=80e9 * 4.52e-4, growth=0.0)
    ours = simulate(override(case(4, rope=wire), {"simulation.duration": 2.0}))
    theirs = simulate(override(case(4), {"simulation.duration": 2.0, "simulation.substeps": 32}))
    assert (ours.integrator, theirs.integrator) == ("rk4", "adaptive")
    assert np.abs(ours["x"] - theirs["x"]).max() < 1e-6
    assert ours.metrics.mse == pytest.approx(theirs.metrics.mse, rel=1e-3)


def test_what_changes_the_wire_rope_s_tension_changes_the_run() -> None:
    """An integrator that knew the wire rope's law by heart would run the rope that was changed."""
    ours = simulate(override(case(1, rope=Fading()), {"simulation.duration": 0.5, "simulation.substeps": 64}))
    same = Rope(modulus=0.9 * 80e9, damping=900.0)
    theirs = simulate(override(case(1, rope=same), {"simulation.duration": 0.5, "simulation.substeps": 64}))
    other = simulate(override(case(1), {"simulation.duration": 0.5, "simulation.substeps": 64}))
    assert (ours.integrator, theirs.integrator) == ("rk4", "adaptive")
    assert np.abs(ours["F1"] - theirs["F1"]).max() < 1.0
    assert np.abs(ours["F1"] - other["F1"]).max() > 30
