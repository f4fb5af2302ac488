"""Preview of the reference, in everything that runs, exports or linearises a controller that asks for it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import casadi as ca
import numpy as np
import pytest

from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.analysis.operating_points import loop_operating_point
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.controller import Controller, controller_function, controller_step, initial_controller_state
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.parts import Measurement
from dualwinch.export import export_c, export_mex
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import Previewed
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Reference, Setpoint, setpoint
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.batch.sensitivities import sensitivities
from dualwinch.simulation.blocks import block
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.stepper.stepper import Stepper
from tests.foresight import Foresight, ForesightfulTension

BOTH = Controller(law=Foresight(), coordination=ForesightfulTension())
SHORT = Reference("profile", accelerate_until=1.0, cruise_until=1.5, brake_until=2.5, speed=0.4)
EXPERIMENT = replace(case(4), controller=BOTH, reference=SHORT, simulation=Simulation(duration=2.6))
SHARE = "controller.foresight.share"


def seen(reference: Reference, t: np.ndarray) -> dict[str, np.ndarray]:
    soon, then = setpoint(t + 0.25, reference), setpoint(t + 1.0, reference)
    columns = {"x_soon": soon.x, "v_soon": soon.v, "a_soon": soon.a, "v_then": then.v}
    return {name: np.broadcast_to(column, t.shape) for name, column in columns.items()}


@pytest.mark.parametrize(
    "reference",
    [
        SHORT,
        replace(SHORT, jerk_limit=2.0),
        Reference("uniform", speed=0.5, jerk_limit=3.0),
        Reference("way-points", points=(0.5, 0.2), speed=0.5, acceleration=1.0, pauses=(0.2, 0.0)),
    ],
)
def test_parts_see_the_reference_ahead(reference: Reference) -> None:
    """Until the last sample, each at its own times; in both engines and in lanes."""
    experiment = replace(EXPERIMENT, reference=reference)
    result = simulate(experiment)
    lanes = rollout([SHARE], [[0.5]], [experiment], stride=1)
    interpreted = simulate(experiment, engine="interpreter")
    assert result.outcome == "completed"
    for name, expected in seen(reference, result["t"]).items():
        for found in (result[name], interpreted[name], lanes.columns[name][0, 0]):
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_a_law_that_foresees_acts_before_the_acceleration() -> None:
    blind = override(EXPERIMENT, {SHARE: 0.0})
    u, expected = simulate(EXPERIMENT)["u"], simulate(blind)["u"]
    before, since = slice(0, 740), slice(752, 760)  # the acceleration ends at 1 s, and is seen 0.25 s ahead
    assert np.abs(u - expected)[before].max() < 1e-9
    assert (u - expected)[since].max() < -1000


def test_those_who_do_not_look_ahead_receive_nothing_more() -> None:
    assert not [name for name in closed_loop(structure_of(case(4))).exogenous if name.startswith("ahead")]
    names = closed_loop(structure_of(EXPERIMENT)).exogenous
    assert [name for name in names if name.startswith("ahead.x")] == ["ahead.x.0", "ahead.x.1", "ahead.x.2"]
    alone = replace(EXPERIMENT, controller=Controller(law=Adrc(), coordination=ForesightfulTension()))
    assert closed_loop(structure_of(alone)).exogenous[-3:] == ("ahead.x", "ahead.v", "ahead.a")
    np.testing.assert_allclose(simulate(alone)["v_then"], seen(SHORT, simulate(alone)["t"])["v_then"], atol=1e-12)


def test_the_preview_of_a_coordination_goes_with_commands_from_outside() -> None:
    alone = replace(EXPERIMENT, controller=Controller(law=Adrc(), coordination=ForesightfulTension()))
    stepper = Stepper(alone, 3, command="force", signals=("t", "v_then"))
    for _ in range(49):
        stepper.step(np.full(3, 100.0))
    observed = stepper.step(np.full(3, 100.0))
    expected = seen(SHORT, np.asarray(observed["t"]))["v_then"]
    np.testing.assert_allclose(observed["v_then"], expected, atol=1e-12)


def test_scenarios_of_an_ensemble_look_ahead() -> None:
    ensemble = load_ensemble("sea", EXPERIMENT)
    result = run_ensemble(ensemble, 3, 5, traces=False)
    for index in range(3):
        drawn = ensemble.scenario(index, 5)
        alone = simulate(drawn.experiment, nominal=drawn.nominal)
        assert result.metrics["mse"][index] == pytest.approx(alone.metrics.mse, rel=1e-6)


def test_runs_are_differentiated_with_what_is_seen() -> None:
    smooth = override(EXPERIMENT, {"controller.coordination.preload": 5000, "simulation.integrator": "exponential"})
    found = sensitivities([SHARE], [[0.5]], [smooth])
    around = rollout([SHARE], [[0.5 - 1e-3], [0.5 + 1e-3]], [smooth])
    quotient = np.diff(around.metrics["mse"][:, 0])[0] / 2e-3
    assert found.gradients["mse"][0, 0, 0] == pytest.approx(quotient, rel=1e-4)


def test_in_a_cruise_the_setpoints_ahead_go_on_with_it() -> None:
    cruise = loop_operating_point(EXPERIMENT, 10.0, 0.5)
    assert cruise.row["x_soon"] == pytest.approx(cruise.row["x_ref"] + 0.125)
    assert cruise.row["v_soon"] == cruise.row["v_then"] == 0.5
    assert abs(cruise.row["e"]) < 1e-3
    assert np.abs(linear_closed_loop(EXPERIMENT, 10.0, 0.5).poles()).max() < 1


@pytest.mark.slow
def test_what_is_seen_of_a_cruise_changes_no_margin() -> None:
    """The loop is that of the same law without a look ahead."""
    blind = replace(EXPERIMENT, controller=Controller(law=Adrc()))
    for opening in ("u", "tau_1"):
        ours, theirs = (linear_open_loop(experiment, 10.0, 0.5, opening) for experiment in (EXPERIMENT, blind))
        omega = np.logspace(-1, 3, 30)
        assert ours.response(omega) == pytest.approx(theirs.response(omega), rel=1e-6)
    worst = [MarginSurvey([experiment]).worst([[]])[0] for experiment in (EXPERIMENT, blind)]
    for kind, margin in worst[0].items():
        assert margin.value == pytest.approx(worst[1][kind].value, rel=1e-6), kind


def test_exports_take_the_setpoints_ahead() -> None:
    made = block("controller", EXPERIMENT)
    about = {variable.name: variable for variable in made.inputs}
    assert [name for name in about if "ahead" in name] == [
        *("x_ref_ahead_1", "v_ref_ahead_1", "a_ref_ahead_1", "v_ref_ahead_3")
    ]
    assert about["x_ref_ahead_1"].description == "reference position 0.25 s ahead"
    assert about["v_ref_ahead_3"].description == "reference speed 1 s ahead"
    known = {time: Setpoint(0.2 + time, 0.3 + time, 0.4 + time) for time in BOTH.preview}
    sensed = Measurement(0.1, 0.2, 1500.0, 900.0, 0.0, 0.0, 0.0, 0.0)
    point = Previewed(0.2, 0.3, 0.4, known)
    start = initial_controller_state(BOTH)
    state, output = controller_step(start, sensed, point, BOTH, Plant(), 1e-3)
    given = leaves(sensed) | {"x_ref": 0.2, "v_ref": 0.3, "a_ref": 0.4}
    given |= {f"{name}_ref_ahead_1": value for name, value in zip("xva", (0.45, 0.55, 0.65), strict=True)}
    given |= {"v_ref_ahead_3": 1.3}
    values = [variable.start for variable in made.parameters]
    following, told = made.step(made.initial(values), [given[name] for name in about], values)
    assert np.array(following).ravel() == pytest.approx([float(value) for value in leaves(state).values()], rel=1e-9)
    assert float(told[0]) == pytest.approx(float(output.winches.tau_1), rel=1e-9)
    ahead = ca.DM([[vars(point)[name] for name in "xva"] for point in known.values()]).T
    function = controller_function(BOTH, Plant())
    torques = function(
        [float(v) for v in leaves(start).values()], list(leaves(sensed).values()), [0.2, 0.3, 0.4], 1e-3, ahead
    )
    assert float(torques[1][0]) == pytest.approx(float(output.winches.tau_1), rel=1e-9)


def test_the_closed_loop_says_what_departs_when() -> None:
    about = {variable.name: variable for variable in block("closed-loop", EXPERIMENT).inputs}
    assert (
        about["ahead.v.2"].description
        == "deviation of the future reference speed from constant acceleration, 1 s ahead"
    )
    assert about["ahead.v.2"].start == 0


def test_files_of_exports_hold_the_setpoints_ahead(tmp_path: Path) -> None:
    export_mex(EXPERIMENT, tmp_path)
    table = np.loadtxt(tmp_path / "reference.csv", delimiter=",")
    names = [variable.name for variable in block("controller", EXPERIMENT).inputs if "_ref" in variable.name]
    t = np.arange(len(table)) * 1e-3
    np.testing.assert_allclose(table[:, names.index("v_ref_ahead_3")], setpoint(t + 1.0, SHORT).v)
    export_c(EXPERIMENT, tmp_path / "c")
    assert "x_ref_ahead_1" in (tmp_path / "c" / "dualwinch_controller.h").read_text()


@dataclass(frozen=True)
class Guesser(Adrc):
    """Looks ahead without having asked."""

    asked: ClassVar[tuple] = ()
    kind: ClassVar = "guesser"

    @property
    def preview(self) -> tuple[float, ...]:
        return self.asked

    def step(self, state, estimate, setpoint, context):
        return super().step(state, estimate, setpoint.ahead(0.5), context)


def test_a_look_ahead_must_be_asked_for() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^setpoint\.ahead\(0\.5\): must be a time of the part's preview, none$"
    ):
        simulate(case(4, law=Guesser()))


@pytest.mark.parametrize("time", [0.0, -1.0, float("nan"), float("inf"), "soon"])
def test_times_ahead_are_positive(time: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Guesser, "asked", (time,))
    with pytest.raises(ConfigurationError, match=r"^guesser: its preview gives .*: must be times > 0 s$"):
        simulate(case(4, law=Guesser()))


@dataclass(frozen=True)
class Wavering(Foresight):
    """Looks ahead by a number that may change at run time."""

    time: Annotated[float, Quantity("s", "time ahead")] = 0.3
    kind: ClassVar = "wavering"

    @property
    def preview(self) -> tuple[float, ...]:
        return (self.time,)


def test_times_ahead_follow_from_what_shapes_code() -> None:
    with pytest.raises(ConfigurationError, match=r"^preview: .*; mark it Mark\.SHAPES_CODE$"):
        structure_of(Experiment(controller=Controller(law=Wavering())))
    other = Experiment(controller=Controller(law=Foresight(soon=0.3)))
    assert structure_of(other) != structure_of(Experiment(controller=Controller(law=Foresight())))
