"""Sums over many samples in single precision."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from benchmarks.embedded.host import Host, build
from benchmarks.embedded.loop import float_controller
from dualwinch.codegen.block import Block, Variable
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.export.package import Provenance, c_package, compensated, prepared
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.model.scalar import where
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate

ABOUT = Provenance("dualwinch", "test", "2026-01-01")
STEP, SAMPLES = 1.8e-3, 25_000


def odometer() -> Block:
    """Distances at the speed of the input: a plain one, one that begins at the first input, a filter, a copy."""
    state, speed = ca.SX.sym("state", 5), ca.SX.sym("input")
    x, late, primed, filtered, _ = ca.vertsplit(state)
    following = ca.vertcat(
        x - (-speed) * 1e-3,
        where(primed > 0, late, 40.0) + 1e-3 * speed,
        1,
        filtered * 0.9 + 0.1 * speed,
        x,
    )
    names = ["x", "late", "primed", "filtered", "copy"]
    return Block(
        name="odometer",
        description="distances",
        step=ca.Function("step", [state, speed], [following, x], ["state", "input"], ["next_state", "output"]),
        initial=ca.Function("initial", [], [ca.DM([0, 0, 0, 0, 0])], [], ["state"]),
        states=tuple(Variable(name, "m", name, 0.0) for name in names),
        inputs=(Variable("speed", "m/s", "speed", STEP * 1e3),),
        outputs=(Variable("distance", "m", "distance", 0.0),),
        parameters=(),
        sample_time=1e-3,
    )


def test_states_that_are_sums_keep_what_rounding_takes_and_others_do_not() -> None:
    step = compensated(odometer().step)
    assert (step.name_in()[-1], step.name_out()[-1]) == ("lost", "next_lost")
    assert step.numel_in("lost") == 2
    assert prepared(odometer(), "float").lost == 2
    assert prepared(odometer(), "double").lost == 0


def test_a_state_that_is_chosen_is_no_sum() -> None:
    state, value, due = ca.SX.sym("state", 3), ca.SX.sym("value"), ca.SX.sym("due")
    held, summed, both = ca.vertsplit(state)
    following = ca.vertcat(
        where(due > 0, value, held), where(due > 0, summed + value, 0.0), where(due > 0, both, 1) + value
    )
    step = ca.Function("step", [state, value, due], [following], ["state", "value", "due"], ["next_state"])
    given = [ca.DM([1.0, 2.0, 3.0]), ca.DM(0.5), ca.DM(1.0)]
    summing = compensated(step)
    assert summing.numel_in("lost") == 2, "the second and the third"
    found = summing.call([*given, ca.DM.zeros(2)])[0]
    assert np.array(found).ravel() == pytest.approx([0.5, 2.5, 3.5])


def test_a_distance_is_not_lost_between_two_numbers(tmp_path: Path) -> None:
    made = odometer()
    files = c_package(made, made.name, ABOUT, "float")
    library = build(tmp_path, files, made.name, find_compiler().command)
    host = Host(library, made.name, made, "float", freeze=True)
    plain, rounded = np.float32(0), np.float32(STEP)
    for _ in range(SAMPLES):
        assert host.step() == 0
        plain += rounded
    expected = SAMPLES * STEP
    assert abs(float(plain) - expected) > 1e-3
    assert host.state[0] == pytest.approx(expected, abs=4e-6)
    assert host.state[1] == pytest.approx(40 + expected, abs=8e-6)


@pytest.mark.parametrize(
    ("kind", "estimator"), [pytest.param("fando-nftsm", "kalman", marks=pytest.mark.slow), ("adrc", "lowpass")]
)
def test_observers_in_single_precision_hold_the_vehicle_where_those_in_double_do(kind: str, estimator: str) -> None:
    experiment = with_leaves(case(4, kind), {"controller.estimator": estimator})
    apart = np.abs(float_controller(experiment)[:, 0] - simulate(experiment).columns["x"])
    assert 0 < apart.max() < 2e-5  # half a millimetre without


def test_what_is_lost_beyond_all_numbers_is_refused_and_forgotten(tmp_path: Path) -> None:
    made = odometer()
    library = build(tmp_path, c_package(made, made.name, ABOUT, "float"), made.name, find_compiler().command)
    host = Host(library, made.name, made, "float", freeze=True)
    assert host.step() == 0
    before = host.state.copy()
    host.lost[:] = np.inf
    assert host.step() == 3
    np.testing.assert_array_equal(host.state, before)
    assert host.step() == 0
    assert host.state[0] == pytest.approx(2 * STEP)
