"""Parts that nobody registered, as a user writes them: whatever works with a built-in part works with these.

One machine has a part of each kind; what is peculiar to a kind stands in the file of that kind.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np
import pytest

import dualwinch as dw
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.batch import batch_source, rows_source
from dualwinch.codegen.drivers.rollout import rollout_source
from dualwinch.controllers.controller import Controller, controller_function, controller_step, initial_controller_state
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.nominal import Nominal
from dualwinch.controllers.parts import Measurement, PositionLaw, PositionOutput
from dualwinch.model.actuators import Actuator, NoState
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of, zeros_of
from dualwinch.simulation.metrics.metrics import BUILT_IN
from dualwinch.tuning.space import ContinuousDimension, space_of
from tests.own_actuators import Drooping, Torques, TwoLags
from tests.own_metrics import LastBeyond, PullSpread, Room
from tests.own_parts import Belief, DriftFree, StateFeedback, Watched
from tests.own_ropes import Stiffening

CONTROLLER = Controller(estimator=DriftFree(), law=StateFeedback(), coordination=Watched())
METRICS = (LastBeyond(2e-3), PullSpread(), Room())
PARTS = (DriftFree, StateFeedback, Watched, Stiffening, TwoLags, LastBeyond, PullSpread, Room)
BUILT = replace(dw.case(4), controller=CONTROLLER, simulation=Simulation(duration=1.0))
EXPERIMENT = replace(BUILT, plant=Plant(rope_1=Stiffening(), rope_2=Stiffening()), actuator=TwoLags(), metrics=METRICS)
SIGNALS = {"gain.0": "1", "gain.1": "1", "surprise": "m", "offset": "m/s", "imbalance": "N"}

LAW, ESTIMATOR, COORDINATION = "controller.state_feedback.", "controller.drift_free.", "controller.watched."
BANDWIDTH = LAW + "bandwidth"
NUMBERS = {
    "law": (BANDWIDTH, 6.0),
    "estimator": (ESTIMATOR + "rate", 0.1),
    "coordination": (COORDINATION + "share", 0.5),
    "rope": ("plant.rope_1.soft", 5e6),
    "actuator": ("actuator.two_lags.lag", 8e-3),
    "metric": ("metrics.last_beyond.band", 5e-3),
}
"""A number of the part of each kind, and another value of it."""
CHANGED = dict(NUMBERS.values())


def test_both_engines_run_them() -> None:
    ours, theirs = dw.simulate(EXPERIMENT), dw.simulate(EXPERIMENT, engine="interpreter")
    assert (ours.outcome, theirs.outcome, ours.integrator) == ("completed", "completed", "rk4")
    assert ours.metrics.max_abs_error < 2e-3
    for name, column in ours.columns.items():
        assert np.abs(column - theirs[name]).max() <= 1e-9 * max(1.0, np.abs(column).max()), name
    for name, value in ours.metrics.items():
        assert value == pytest.approx(theirs.metrics[name], rel=1e-9, abs=1e-15, nan_ok=True), name


def numbers_of(group: Any) -> list[float]:
    return [float(value) for value in leaves(group).values()]


def test_floats_give_what_symbols_give() -> None:
    function, state = controller_function(CONTROLLER, Plant()), initial_controller_state(CONTROLLER)
    assert function.name() == "state_feedback"
    for k in range(20):
        measured = Measurement(0.01 * k, 0.3, 1500.0, 900.0, 0.0, 0.0, 0.0, 0.0)
        point = Setpoint(0.011 * k, 0.31, 0.1)
        inputs = [numbers_of(group) for group in (state, measured, point)]
        following, torques, _ = (np.array(output).ravel().tolist() for output in function(*inputs, 1e-3))
        state, output = controller_step(state, measured, point, CONTROLLER, Plant(), 1e-3)
        assert numbers_of(state) == pytest.approx(following, rel=1e-12)
        assert numbers_of(output.winches)[2:4] == pytest.approx(torques, rel=1e-12)


def test_their_signals_are_columns_with_units() -> None:
    result = dw.simulate(EXPERIMENT)
    assert list(result.columns)[-len(SIGNALS) :] == list(SIGNALS)
    assert {name: result.units[name] for name in SIGNALS} == SIGNALS
    assert result.quantities["imbalance"].meaning == "sum of the tensions beyond the preload"
    assert result["imbalance"] == pytest.approx(result["F1"] + result["F2"] - 2000, abs=1e-9)
    assert result["gain.0"][0] == pytest.approx(0.5)


def test_their_states_have_names_by_their_places() -> None:
    final = dw.simulate(EXPERIMENT).final_state
    assert [name.removeprefix("controller.law.") for name in final if name.startswith("controller.law.")] == [
        *("z.0", "z.1", "P.0.0", "P.0.1", "P.1.0", "P.1.1")
    ]
    assert final["controller.law.z.0"] == pytest.approx(final["motion.plant.x"], abs=2e-3)
    assert final["controller.law.P.0.1"] == pytest.approx(final["controller.law.P.1.0"])
    assert [name for name in final if ".estimator." in name] == [
        "controller.estimator.offset",
        "controller.estimator.x",
    ]
    assert [name for name in final if name.startswith("actuator")] == [
        f"actuator_{number}.tau.{element}" for number in (1, 2) for element in (0, 1)
    ]
    loop = closed_loop(structure_of(EXPERIMENT))
    assert loop.marks["controller.estimator.x"] == {Mark.POSITION}
    assert [loop.marks[f"controller.law.z.{index}"] for index in (0, 1)] == [{Mark.POSITION}, {Mark.SPEED}]
    assert loop.marks["controller.law.P.0.0"] == frozenset()


def test_their_numbers_stand_below_their_kind_and_compile_nothing() -> None:
    changed = dw.override(EXPERIMENT, CHANGED)
    assert {key: leaves(changed)[key] for key in CHANGED} == CHANGED
    assert set(CHANGED) <= set(parameters_of(EXPERIMENT))
    assert structure_of(changed) == structure_of(EXPERIMENT) != structure_of(Experiment())
    assert not [key for key in parameters_of(EXPERIMENT) if "nftsm" in key or "speed_filter_time" in key]
    assert dw.simulate(changed).metrics.mse != dw.simulate(EXPERIMENT).metrics.mse


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({BANDWIDTH: 51}, f"{BANDWIDTH} = 51: must be a finite number > 0 and <= 50 rad/s"),
        ({COORDINATION + "share": -1}, "controller.watched.share = -1: must be a finite number >= 0 and <= 1"),
        ({LAW + "bandwith": 5}, f"unknown key '{LAW}bandwith'; did you mean '{BANDWIDTH}'?"),
        (
            {"controller.nftsm.beta": 0.1},
            'controller.nftsm.beta: belongs to controller.kind = "fando-nftsm" or "nftsm", here it is "state-feedback"',
        ),
        (
            {"controller.kind": "state-fedback"},
            (
                'controller.kind = "state-fedback": must be "fando-nftsm" or "nftsm" or "pid-cascade" or '
                '"super-twisting" or "adrc" or "lqi" or "eid" or "rbf-sliding-mode" or "mpc" or "state-feedback" '
                "(a kind of your own: dw.register(YourClass), or --plugin FILE); did you mean 'state-feedback'?"
            ),
        ),
        ({"plant.rope_1.soft": 0}, "plant.rope_1.soft = 0: must be a finite number > 0 N"),
        ({"plant.rope_1.sof": 1}, "unknown key 'plant.rope_1.sof'; did you mean 'plant.rope_1.soft'?"),
        ({"plant.rope_1.kind": "steel"}, 'plant.rope_1.kind = "steel": must be "kelvin-voigt" or "stiffening"'),
        (
            {"plant.rope_1.modulus": 9e10},
            'plant.rope_1.modulus: belongs to plant.rope_1.kind = "kelvin-voigt", here it is "stiffening"',
        ),
        ({"actuator.two_lags.lag": 2}, "actuator.two_lags.lag = 2: must be a finite number >= 0.001 and <= 1 s"),
        (
            {"actuator.motor.rate_limit": 1},
            'actuator.motor.rate_limit: belongs to actuator.kind = "motor", here it is "two-lags"',
        ),
        ({"metrics.last_beyond.band": 0}, "metrics.last_beyond.band = 0: must be a finite number > 0 m"),
        (
            {"metrics.last_beyond.bnd": 1},
            "unknown key 'metrics.last_beyond.bnd'; did you mean 'metrics.last_beyond.band'?",
        ),
    ],
)
def test_wrong_values_are_refused_as_those_of_any_other(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        dw.override(EXPERIMENT, values)
    assert str(caught.value).partition(" The nearest of ")[0].startswith(message)


def test_their_rules_are_checked() -> None:
    leaking = dw.override(EXPERIMENT, {LAW + "leak": 2})
    with pytest.raises(ConfigurationError, match=r"^controller\.state_feedback\.bandwidth = 1: must be > contr"):
        dw.simulate(replace(leaking, controller=replace(CONTROLLER, law=StateFeedback(1.0, leak=2.0))))
    with pytest.raises(ConfigurationError, match=r"^parameters\[1\]: controller\.state_feedback\.bandwidth = 1: must"):
        dw.rollout([BANDWIDTH], [[3.0], [1.0]], [leaking])


def test_two_parts_of_one_kind_do_not_get_in_each_others_way() -> None:
    @dataclass(frozen=True)
    class Namesake(DriftFree):
        bandwidth: Annotated[float, at.Gt(0), Quantity("rad/s", "of the filter")] = 7.0
        kind: ClassVar = "state-feedback"

    with pytest.raises(ConfigurationError, match=r"Namesake: the key controller\.state_feedback\.bandwidth is taken"):
        Experiment(controller=Controller(Namesake(), StateFeedback()))


def test_many_run_side_by_side() -> None:
    sets = [[parameters_of(EXPERIMENT)[key] for key in CHANGED], list(CHANGED.values())]
    batch = dw.rollout(list(CHANGED), sets, [EXPERIMENT], stride=1)
    for row, values in enumerate(sets):
        changed = dw.override(EXPERIMENT, dict(zip(CHANGED, values, strict=True)))
        substeps = {"simulation.substeps": structure_of(EXPERIMENT).substeps}
        single = dw.simulate(dw.override(changed, substeps), nominal=EXPERIMENT.plant)
        assert batch.outcomes[row, 0] == single.outcome == "completed"
        for name in ("x", "torque_1", "gain.1"):
            assert np.abs(batch.columns[name][row, 0] - single[name]).max() < 1e-6, name
        for name in ("mse", "last_beyond", "pull_spread", "room"):
            assert batch.metrics[name][row, 0] == pytest.approx(single.metrics[name], rel=1e-6), name


def test_runs_can_be_differentiated_by_their_numbers() -> None:
    smooth = dw.override(EXPERIMENT, {"controller.coordination.preload": 5000})
    names = [BANDWIDTH, "plant.rope_1.soft", "actuator.two_lags.lag"]
    values = np.array([parameters_of(smooth)[name] for name in names])
    slopes = dw.sensitivities(names, [values], [smooth], stride=0)
    steps = 1e-4 * np.eye(len(names)) * values
    around = dw.rollout(names, [*(values - steps), *(values + steps)], [smooth])
    for name in ("mse", "pull_spread"):
        below, above = around.metrics[name][:, 0].reshape(2, -1)
        quotients = (above - below) / (2 * steps.sum(axis=0))
        assert slopes.gradients[name][0, 0] == pytest.approx(quotients, rel=2e-3), name


def test_a_gain_that_is_zero_for_good_is_left_out_of_the_code() -> None:
    structure, values = structure_of(EXPERIMENT), parameters_of(EXPERIMENT)
    leak = LAW + "leak"
    lean = closed_loop(structure, frozenset({leak}))
    column = lean.parameters.index(leak)
    state, outside = list(initial_state_of(EXPERIMENT).values()), np.zeros(len(lean.exogenous))
    for loop, unmoved in ((lean, True), (closed_loop(structure), False)):
        at_zero, at_one = loop.vector(values), loop.vector(values)
        at_one[column] = 1.0
        state[loop.states.index("controller.law.z.0")] = 0.5
        after = [np.array(loop.step(state, outside, vector)[0]).ravel() for vector in (at_zero, at_one)]
        assert np.array_equal(after[0], after[1]) is unmoved


@pytest.mark.parametrize(
    ("experiment", "key"),
    [
        (EXPERIMENT, LAW + "leak"),
        (dw.override(EXPERIMENT, {"plant.rope_1.growth": 0}), "plant.rope_1.growth"),
        (replace(EXPERIMENT, actuator=Drooping(0.0)), "actuator.drooping.droop"),
    ],
    ids=["law", "rope", "actuator"],
)
def test_numbers_that_are_off_at_zero_are_zero_for_good(experiment: Experiment, key: str) -> None:
    assert key in zeros_of(structure_of(experiment), parameters_of(experiment))
    assert "plant.rope_2.growth" not in zeros_of(structure_of(experiment), parameters_of(experiment))


def test_a_gain_that_may_be_left_open_shifts_no_other() -> None:
    """Left open it is no parameter and another code; given, it is one parameter more, in its place."""
    key = LAW + "advance"
    ahead, without_it = dw.override(EXPERIMENT, {key: 0.05}), closed_loop(structure_of(EXPERIMENT)).parameters
    assert structure_of(ahead) != structure_of(EXPERIMENT)
    with_it = closed_loop(structure_of(ahead))
    assert [name for name in with_it.parameters if name != key] == list(without_it)
    assert len(with_it.parameters) == len(without_it) + 1
    vector = dict(zip(with_it.parameters, with_it.vector(parameters_of(ahead)).tolist(), strict=True))
    assert vector == parameters_of(ahead)
    looking = dw.simulate(ahead)
    assert looking["u"][1] != dw.simulate(EXPERIMENT)["u"][1]
    assert np.abs(looking["x"] - dw.simulate(ahead, engine="interpreter")["x"]).max() < 1e-9
    batch = dw.rollout([key], [[0.05]], [ahead], stride=1)
    assert np.abs(batch.columns["x"][0, 0] - looking["x"]).max() < 1e-9
    with pytest.raises(ConfigurationError, match=r"^unknown parameter 'controller\.state_feedback\.advance'"):
        dw.rollout([key], [[0.05]], [EXPERIMENT])


def test_gains_are_searched_for_within_the_bounds_beside_them() -> None:
    interval = ContinuousDimension(BANDWIDTH, (BANDWIDTH,), 1.0, 10.0, log=True, unit="rad/s")
    assert space_of({BANDWIDTH: {}}, EXPERIMENT).dimensions == (interval,)
    names = [dimension.name for dimension in space_of({}, EXPERIMENT).dimensions]
    assert {BANDWIDTH, "controller.winch.kp"} <= set(names)
    assert not [name for name in names if "walk" in name or "nftsm" in name or not name.startswith("controller.")]
    assert names == [dimension.name for dimension in space_of({}, BUILT).dimensions]


def test_files_say_what_their_numbers_are_and_are_read_with_a_base(tmp_path: Path) -> None:
    file, changed = tmp_path / "own.toml", dw.override(EXPERIMENT, CHANGED)
    text = dw.to_toml(changed)
    for line in (
        'kind = "state-feedback"',
        "# advance =",
        "[rad/s] poles of the feedback; > 0 and <= 50 (by hand)",
        'kind = "stiffening"',
        "[N] tension over strain of the unstretched rope; > 0",
        "[actuator.two_lags]",
        "[metrics.last_beyond]  # [s] time at which the error was last beyond the band",
        "band = 0.005  # [m] half width of the band; > 0",
    ):
        assert line in text
    file.write_text(text)
    assert dw.load(file, EXPERIMENT) == changed


@pytest.mark.parametrize("missing", PARTS)
def test_files_name_the_part_that_is_not_registered(missing: type, tmp_path: Path) -> None:
    (file := tmp_path / "own.toml").write_text(dw.to_toml(EXPERIMENT))
    for part in PARTS:
        if part is not missing:
            dw.register(part)
    with pytest.raises(ConfigurationError, match=r"own\.toml:?\d*: ") as caught:
        dw.load(file)
    assert missing.kind in str(caught.value).replace("_", "-")
    dw.register(missing)
    assert dw.load(file) == EXPERIMENT


def test_results_are_saved_and_loaded(tmp_path: Path) -> None:
    file, result = tmp_path / "run.npz", dw.simulate(EXPERIMENT)
    dw.save(result, file)
    again = dw.load_result(file, base=replace(EXPERIMENT, metrics=METRICS[::-1]))
    assert (again, again.integrator) == (result, "rk4")
    assert f"rk4 with {structure_of(EXPERIMENT).substeps} sub-steps" in repr(again)
    with pytest.raises(ConfigurationError, match=r": no such part is registered; register it, "):
        dw.load_result(file)


def test_they_become_blocks() -> None:
    controller, plant, loop = (dw.block(name, EXPERIMENT) for name in ("controller", "plant", "closed-loop"))
    keys = [{parameter.name for parameter in block.parameters} & set(CHANGED) for block in (controller, plant, loop)]
    gains, rope, lag = {key for key in CHANGED if key.startswith("controller.")}, *list(CHANGED)[3:5]
    assert keys == [gains, {rope}, {*gains, rope, lag}]
    assert [state.name for state in controller.states][:4] == ["estimator.offset", "estimator.x", "law.z.0", "law.z.1"]
    assert {output.name: output.unit for output in controller.outputs}.items() >= SIGNALS.items()
    starts = {state.name: state.start for state in plant.states}
    assert Stiffening().tension(0.8 * starts["theta_1"], 0.0, 50.5) == pytest.approx(1000.0)
    plain = replace(EXPERIMENT, metrics=())
    for name, block in (("controller", controller), ("plant", plant), ("closed-loop", loop)):
        assert str(block.step) == str(dw.block(name, plain).step), "figures of merit stay out of them"


def test_they_become_linear_systems() -> None:
    linear = dw.linear_closed_loop(EXPERIMENT, 1.0, 0.1)
    assert {name: linear.units[name] for name in SIGNALS} == SIGNALS
    assert linear.units["actuator_2.tau.0"] == "N m"
    assert np.abs(np.linalg.eigvals(linear.A)).max() < 1
    plain = dw.linear_closed_loop(replace(EXPERIMENT, metrics=()), 1.0, 0.1)
    assert plain.states == linear.states
    assert np.array_equal(plain.A, linear.A)


def test_figures_of_merit_change_no_bit_and_no_code_of_a_run() -> None:
    plain = replace(EXPERIMENT, metrics=())
    ours, theirs = dw.simulate(EXPERIMENT), dw.simulate(plain)
    assert {name: ours.metrics[name] for name in BUILT_IN} == dict(theirs.metrics)
    assert all(np.array_equal(ours[name], theirs[name]) for name in theirs)
    loop = closed_loop(structure_of(plain))
    assert not [name for name in (*loop.states, *loop.parameters) if "beyond" in name]
    assert loop.states == closed_loop(structure_of(EXPERIMENT)).states[: len(loop.states)]
    assert type(theirs.metrics) is dw.Metrics


def test_the_nominal_plant_is_theirs_too() -> None:
    heavy = dw.override(EXPERIMENT, {"controller.nominal.mass": 1.5e4})
    assert heavy.controller.nominal == Nominal(1.5e4)
    assert dw.simulate(heavy)["u"][0] == pytest.approx(1.5 * dw.simulate(EXPERIMENT)["u"][0])


def test_a_part_without_a_step_is_none() -> None:
    @dataclass(frozen=True)
    class Unfinished(PositionLaw):
        kind: ClassVar = "unfinished"

        def initial_state(self) -> Belief:
            return Belief()

    with pytest.raises(ConfigurationError, match=r"Unfinished: has no step; write def step\(self, state, estimate, s"):
        Unfinished()  # pyright: ignore[reportAbstractUsage]


@dataclass(frozen=True)
class Growing:
    """A state that has another shape after a step."""

    z: Annotated[Any, Quantity("m", "what changes its shape")]


@dataclass(frozen=True)
class GrowingLaw(PositionLaw):
    kind: ClassVar = "growing"

    def initial_state(self) -> Growing:
        return Growing(np.zeros(2))

    def step(self, state: Any, estimate: Any, setpoint: Any, context: Any) -> tuple[Growing, PositionOutput]:  # noqa: ARG002
        return Growing(np.zeros(3)), PositionOutput(0.0, 0.0)


@dataclass(frozen=True)
class Shifty(Actuator):
    kind: ClassVar = "shifty"

    def initial_state(self) -> Any:
        return Torques()

    def step(self, state: Any, demand: Any, sample_time: Any) -> tuple[NoState, Any]:  # noqa: ARG002
        return NoState(), demand.torque


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"law": StateFeedback}, "kind: must be a PositionLaw, not the class StateFeedback; write StateFeedback()"),
        ({"law": dict}, "kind: must be a PositionLaw, not the class dict"),
        ({"law": DriftFree()}, "kind: must be a PositionLaw, not a DriftFree"),
        ({"law": "state-feedback"}, "kind: must be a PositionLaw, not a str"),
        ({"law": GrowingLaw()}, "growing: its step must give a state of the elements it was given, not z.2"),
        ({"actuator": Shifty()}, "shifty: its step gives a NoState as next state; must be a Torques"),
    ],
)
def test_wrong_objects_are_one_line(parts: Any, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        dw.simulate(dw.case(4, **parts))
    assert str(caught.value).endswith(message)


def test_a_copy_of_a_built_in_law_compiles_to_the_same_code() -> None:
    """So in vector lanes a law of one's own is as fast as a built-in one of the same arithmetic."""
    sources = []
    for law in (FandoNftsm(), Copy()):
        loop = closed_loop(structure_of(dw.case(4, law=law)))
        in_lanes = (source(loop, find_compiler()) for source in (batch_source, rows_source))
        sources.append((rollout_source(loop), *in_lanes))
    assert sources[0] == sources[1]


class Copy(FandoNftsm):
    """The paper's law under another name."""

    kind: ClassVar = "copy"
