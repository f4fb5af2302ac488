"""Parts that nobody registered, as a user writes them: whatever works with a built-in part works with these."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np
import pyarrow.parquet as pq
import pytest

from dualwinch.analysis.linear_loop import linear_closed_loop
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.batch import batch_source, rows_source
from dualwinch.codegen.drivers.rollout import rollout_source
from dualwinch.config.experiment_file import load, to_toml
from dualwinch.controllers.controller import Controller, controller_function, controller_step, initial_controller_state
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.nominal import Nominal
from dualwinch.controllers.parts import Measurement, PositionLaw, PositionOutput
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.batch.sensitivities import sensitivities
from dualwinch.simulation.blocks import block
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.results.file_formats import save
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.tuning.space import ContinuousDimension, space_of
from tests.own_parts import Belief, DriftFree, StateFeedback, Watched

OWN = Controller(estimator=DriftFree(), law=StateFeedback(), coordination=Watched())
EXPERIMENT = replace(case(4), controller=OWN, simulation=Simulation(duration=2.0))
SIGNALS = {"gain.0": "1", "gain.1": "1", "surprise": "m", "offset": "m/s", "imbalance": "N"}
OWN_KEYS = {
    *("controller.drift_free.rate", "controller.watched.share"),
    *(f"controller.state_feedback.{name}" for name in ("bandwidth", "walk", "leak")),
}
BANDWIDTH = "controller.state_feedback.bandwidth"


def test_both_engines_run_them() -> None:
    ours, theirs = simulate(EXPERIMENT), simulate(EXPERIMENT, engine="interpreter")
    assert ours.outcome == theirs.outcome == "completed"
    assert ours.metrics.max_abs_error < 2e-3
    for name, column in ours.columns.items():
        assert np.abs(column - theirs[name]).max() <= 1e-9 * max(1.0, np.abs(column).max()), name


def numbers_of(group: Any) -> list[float]:
    return [float(value) for value in leaves(group).values()]


def test_floats_give_what_symbols_give() -> None:
    function, state = controller_function(OWN, Plant()), initial_controller_state(OWN)
    assert function.name() == "state_feedback"
    for k in range(20):
        measured = Measurement(0.01 * k, 0.3, 1500.0, 900.0, 0.0, 0.0, 0.0, 0.0)
        point = Setpoint(0.011 * k, 0.31, 0.1)
        inputs = [numbers_of(group) for group in (state, measured, point)]
        following, torques, _ = (np.array(output).ravel().tolist() for output in function(*inputs, 1e-3))
        state, output = controller_step(state, measured, point, OWN, Plant(), 1e-3)
        assert numbers_of(state) == pytest.approx(following, rel=1e-12)
        assert numbers_of(output.winches)[2:4] == pytest.approx(torques, rel=1e-12)


def test_their_signals_are_columns_with_units(tmp_path: Path) -> None:
    result = simulate(EXPERIMENT)
    assert list(result.columns)[-len(SIGNALS) :] == list(SIGNALS)
    assert {name: result.units[name] for name in SIGNALS} == SIGNALS
    assert result.quantities["imbalance"].meaning == "sum of the tensions beyond the preload"
    assert result["imbalance"] == pytest.approx(result["F1"] + result["F2"] - 2000, abs=1e-9)
    assert result["gain.0"][0] == pytest.approx(0.5)
    assert result["gain.0"][-1] == pytest.approx(result["gain.0"][-2], rel=1e-3), "the filter's gain settles"
    save(result, tmp_path / "run.parquet")
    table = pq.read_table(tmp_path / "run.parquet")
    assert table.schema.field("gain.1").metadata[b"unit"] == b"1"
    assert np.array_equal(table["surprise"].to_numpy(), result["surprise"])


def test_their_states_have_names_by_their_places() -> None:
    final = simulate(EXPERIMENT).final_state
    law = [name.removeprefix("controller.law.") for name in final if name.startswith("controller.law.")]
    assert law == ["z.0", "z.1", "P.0.0", "P.0.1", "P.1.0", "P.1.1"]
    assert final["controller.law.z.0"] == pytest.approx(final["motion.plant.x"], abs=2e-3)
    assert final["controller.law.P.0.1"] == pytest.approx(final["controller.law.P.1.0"])
    assert [name for name in final if ".estimator." in name] == [
        "controller.estimator.offset",
        "controller.estimator.x",
    ]
    loop = closed_loop(structure_of(EXPERIMENT))
    assert loop.marks["controller.estimator.x"] == {Mark.POSITION}
    assert [loop.marks[f"controller.law.z.{index}"] for index in (0, 1)] == [{Mark.POSITION}, {Mark.SPEED}]
    assert loop.marks["controller.law.P.0.0"] == frozenset()


def test_their_gains_stand_below_their_kind() -> None:
    keys = {key for key in parameters_of(EXPERIMENT) if not key.startswith(("plant.", "nominal.", "disturbance."))}
    own = {key for key in keys if key.startswith(("controller.state_", "controller.drift_", "controller.watched."))}
    assert own == OWN_KEYS
    assert "controller.winch_1.kp" in keys
    assert not [key for key in keys if "nftsm" in key or "speed_filter_time" in key]
    faster = override(EXPERIMENT, {BANDWIDTH: 8, "controller.watched.share": 0.5, "controller.winch_2.kp": 1e-3})
    assert faster.controller.law == StateFeedback(8.0)
    assert leaves(faster.controller.coordination)["watched.share"] == 0.5
    assert leaves(faster)["controller.winch_2.kp"] == 1e-3
    assert structure_of(faster) == structure_of(EXPERIMENT), "numbers compile nothing"
    assert simulate(faster).metrics.mse != simulate(EXPERIMENT).metrics.mse


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({BANDWIDTH: 51}, f"{BANDWIDTH} = 51: must be a finite number > 0 and <= 50 rad/s"),
        ({"controller.watched.share": -1}, "controller.watched.share = -1: must be a finite number >= 0 and <= 1"),
        (
            {"controller.state_feedback.bandwith": 5},
            f"unknown key 'controller.state_feedback.bandwith'; did you mean '{BANDWIDTH}'?",
        ),
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
    ],
)
def test_what_is_wrong_with_them_is_said_as_of_any_other(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        override(EXPERIMENT, values)
    assert str(caught.value).partition(" The nearest of ")[0] == message


def test_their_ranges_and_rules_are_checked() -> None:
    with pytest.raises(ConfigurationError, match=r"^controller\.state_feedback\.bandwidth = 0\.0: must be a finite"):
        Experiment(controller=Controller(law=StateFeedback(0.0)))
    leaking = Experiment(controller=Controller(law=StateFeedback(1.0, leak=2.0)))
    with pytest.raises(ConfigurationError, match=r"^controller\.state_feedback\.bandwidth = 1: must be > contr"):
        prepare(leaking)
    with pytest.raises(ConfigurationError, match=r"^parameters\[1\]: controller\.state_feedback\.bandwidth = 1: must"):
        rollout([BANDWIDTH], [[3.0], [1.0]], [override(EXPERIMENT, {"controller.state_feedback.leak": 2})])


def test_two_parts_of_one_kind_do_not_get_in_each_others_way() -> None:
    @dataclass(frozen=True)
    class Namesake(DriftFree):
        bandwidth: Annotated[float, at.Gt(0), Quantity("rad/s", "of the filter")] = 7.0
        kind: ClassVar = "state-feedback"

    with pytest.raises(
        ConfigurationError, match=r"Namesake: the key controller\.state_feedback\.bandwidth is taken by S"
    ):
        Experiment(controller=Controller(Namesake(), StateFeedback()))


def test_many_run_side_by_side() -> None:
    names, sets = [BANDWIDTH, "controller.drift_free.rate"], [[2.0, 0.5], [8.0, 0.1]]
    batch = rollout(names, sets, [EXPERIMENT], stride=1)
    for row, gains in enumerate(sets):
        single = simulate(override(EXPERIMENT, dict(zip(names, gains, strict=True))))
        assert batch.outcomes[row, 0] == single.outcome == "completed"
        assert np.abs(batch.columns["x"][row, 0] - single["x"]).max() < 1e-9
        assert np.abs(batch.columns["gain.1"][row, 0] - single["gain.1"]).max() < 1e-9
        assert batch.metrics["mse"][row, 0] == pytest.approx(single.metrics.mse, rel=1e-6)
    with pytest.raises(ConfigurationError, match=r"^parameters\[1\]: controller\.state_feedback\.bandwidth = 60: must"):
        rollout([BANDWIDTH], [[2.0], [60.0]], [EXPERIMENT])


def test_runs_can_be_differentiated_by_their_gains() -> None:
    smooth = override(EXPERIMENT, {"controller.coordination.preload": 5000, "simulation.integrator": "exponential"})
    found = sensitivities([BANDWIDTH], [[4.0]], [smooth])
    around = rollout([BANDWIDTH], [[4.0 - 1e-3], [4.0 + 1e-3]], [smooth])
    quotient = np.diff(around.metrics["mse"][:, 0])[0] / 2e-3
    assert found.gradients["mse"][0, 0, 0] == pytest.approx(quotient, rel=1e-4)


def test_a_gain_that_is_zero_for_good_is_left_out_of_the_code() -> None:
    structure, values = structure_of(EXPERIMENT), parameters_of(EXPERIMENT)
    leak = "controller.state_feedback.leak"
    lean = closed_loop(structure, frozenset({leak}))
    column = lean.parameters.index(leak)
    state, outside = list(initial_state_of(EXPERIMENT).values()), np.zeros(len(lean.exogenous))
    for loop, unmoved in ((lean, True), (closed_loop(structure), False)):
        at_zero, at_one = loop.vector(values), loop.vector(values)
        at_one[column] = 1.0
        state[loop.states.index("controller.law.z.0")] = 0.5
        after = [np.array(loop.step(state, outside, vector)[0]).ravel() for vector in (at_zero, at_one)]
        assert np.array_equal(after[0], after[1]) is unmoved


def test_a_gain_that_may_be_left_open_shifts_no_other() -> None:
    """Left open it is no parameter and another code; given, it is one parameter more, in its place."""
    ahead = override(EXPERIMENT, {"controller.state_feedback.advance": 0.05})
    assert structure_of(ahead) != structure_of(EXPERIMENT)
    with_it, without = (closed_loop(structure_of(experiment)) for experiment in (ahead, EXPERIMENT))
    assert [name for name in with_it.parameters if name not in without.parameters] == [
        "controller.state_feedback.advance"
    ]
    assert [name for name in with_it.parameters if name in without.parameters] == list(without.parameters)
    for experiment, loop in ((ahead, with_it), (EXPERIMENT, without)):
        vector = dict(zip(loop.parameters, loop.vector(parameters_of(experiment)).tolist(), strict=True))
        assert vector == parameters_of(experiment)
    looking, plain = simulate(ahead), simulate(EXPERIMENT)
    assert looking["u"][1] != plain["u"][1]
    interpreted = simulate(ahead, engine="interpreter")
    assert np.abs(looking["x"] - interpreted["x"]).max() < 1e-9
    batch = rollout(["controller.state_feedback.advance"], [[0.05]], [ahead], stride=1)
    assert np.abs(batch.columns["x"][0, 0] - looking["x"]).max() < 1e-9
    with pytest.raises(ConfigurationError, match=r"^unknown parameter 'controller\.state_feedback\.advance'"):
        rollout(["controller.state_feedback.advance"], [[0.05]], [EXPERIMENT])


def test_they_are_searched_for_within_the_bounds_beside_them() -> None:
    interval = ContinuousDimension(BANDWIDTH, (BANDWIDTH,), 1.0, 10.0, log=True, unit="rad/s")
    assert space_of({BANDWIDTH: {}}, EXPERIMENT).dimensions == (interval,)
    names = [dimension.name for dimension in space_of({}, EXPERIMENT).dimensions]
    assert BANDWIDTH in names
    assert "controller.winch.kp" in names
    assert not [name for name in names if "walk" in name or "nftsm" in name]


def test_written_as_toml_they_are_read_where_they_are_known(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    tuned = override(EXPERIMENT, {BANDWIDTH: 6, "controller.watched.share": 0.25})
    file.write_text(to_toml(tuned))
    text = file.read_text()
    assert 'kind = "state-feedback"' in text
    assert "# advance =" in text
    assert "[rad/s] poles of the feedback; > 0 and <= 50 (by hand)" in text
    assert load(file, EXPERIMENT) == tuned
    with pytest.raises(ConfigurationError, match=r'own\.toml:\d+: controller\.\S+ = "\S+": must be "'):
        load(file)


def test_they_become_blocks_and_linear_systems() -> None:
    controller = block("controller", EXPERIMENT)
    assert [state.name for state in controller.states][:4] == ["estimator.offset", "estimator.x", "law.z.0", "law.z.1"]
    assert {output.name: output.unit for output in controller.outputs}.items() >= SIGNALS.items()
    assert {parameter.name for parameter in controller.parameters} >= OWN_KEYS
    linear = linear_closed_loop(EXPERIMENT, 1.0, 0.1)
    assert {name: linear.units[name] for name in SIGNALS} == SIGNALS
    assert np.abs(np.linalg.eigvals(linear.A)).max() < 1


def test_the_nominal_plant_is_theirs_too() -> None:
    heavy = override(EXPERIMENT, {"controller.nominal.mass": 1.5e4})
    assert heavy.controller.nominal == Nominal(1.5e4)
    ours, theirs = simulate(heavy), simulate(EXPERIMENT)
    resistance = 490 * np.tanh(0 / 0.01)
    assert ours["u"][0] - resistance == pytest.approx(1.5 * (theirs["u"][0] - resistance))


def test_a_part_without_a_step_is_none() -> None:
    @dataclass(frozen=True)
    class Unfinished(PositionLaw):
        kind: ClassVar = "unfinished"

        def initial_state(self) -> Belief:
            return Belief()

    with pytest.raises(
        ConfigurationError, match=r"Unfinished: has no step; write def step\(self, state, estimate, set"
    ):
        Unfinished()  # pyright: ignore[reportAbstractUsage]


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (StateFeedback, "controller.kind: must be a PositionLaw, not the class StateFeedback; write StateFeedback()"),
        (dict, "controller.kind: must be a PositionLaw, not the class dict"),
        (DriftFree(), "controller.kind: must be a PositionLaw, not a DriftFree"),
        ("state-feedback", "controller.kind: must be a PositionLaw, not a str"),
    ],
)
def test_what_stands_for_a_part_is_an_object_of_its_base(law: Any, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        case(4, law=law)
    assert str(caught.value).endswith(message.removeprefix("controller."))


@dataclass(frozen=True)
class Growing:
    """A state that has another shape after a step."""

    z: Annotated[Any, Quantity("m", "what changes its shape")]


@dataclass(frozen=True)
class Shifty(PositionLaw):
    """A law that returns another state than its own."""

    kind: ClassVar = "shifty"

    def initial_state(self) -> Growing:
        return Growing(np.zeros(2))

    def step(self, state: Any, estimate: Any, setpoint: Any, context: Any) -> tuple[Growing, PositionOutput]:  # noqa: ARG002
        return Growing(np.zeros(3)), PositionOutput(0.0, 0.0)


def test_a_state_that_changes_its_shape_is_named() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^shifty: its step must give a state of the elements it was given, not z\.2$"
    ):
        simulate(case(4, law=Shifty()))


def test_a_copy_of_a_built_in_law_compiles_to_the_same_code() -> None:
    """So in vector lanes a law of one's own is as fast as a built-in one of the same arithmetic."""
    sources = []
    for law in (FandoNftsm(), Copy()):
        loop = closed_loop(structure_of(case(4, law=law)))
        in_lanes = (source(loop, find_compiler()) for source in (batch_source, rows_source))
        sources.append((rollout_source(loop), *in_lanes))
    assert sources[0] == sources[1]


class Copy(FandoNftsm):
    """The paper's law under another name."""

    kind: ClassVar = "copy"
