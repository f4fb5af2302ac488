"""Rollouts in lanes: signals are those of `Signals.fill`, bit for bit; lanes may be given up; loops are vectorised."""

import subprocess
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.batch import LANES, Batch, batch_source, compile_batch, rows_source
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.signals.signals import OutageSignal, RandomSignal, Signals, UniformSignal
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import PAIRED_STATEMENTS, lane_flags, paired
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.codegen.toy import oscillator

SAMPLES = 64 * 3 + 17
COUNT = 7
SHARED = np.arange(SAMPLES) / 7


@pytest.fixture(scope="module")
def recorder() -> Batch:
    """A system that writes down what it receives, while its motion grows by a factor at every sample."""
    state, outside, factor = ca.SX.sym("state", 2), ca.SX.sym("exogenous", COUNT), ca.SX.sym("parameters", 1)
    motion, hold, part = ca.SX.sym("motion", 1), ca.SX.sym("hold", 1), ca.SX.sym("part", 1)
    at_sample = [state, outside, factor], ["state", "exogenous", "parameters"]
    (symbols, names), moved = at_sample, [factor * motion, ca.SX(1)]
    of_move = ["motion", "hold", "part", "parameters"]
    return compile_batch(
        Sampled(
            sample=ca.Function("sample", symbols, [state[1] + 1, outside[0]], names, ["discrete", "hold"]),
            observe=ca.Function("observe", symbols, [outside], names, ["row"]),
            move=ca.Function("move", [motion, hold, part, factor], moved, of_move, ["next_motion", "margin"]),
            parts=1,
            one_step=None,
        ),
        rows=True,
    )


def test_a_rollout_without_rows_is_compiled_without_their_code(recorder: Batch) -> None:
    system = oscillator()
    assert "void observe(" not in batch_source(system, find_compiler())
    assert "void observe(" in rows_source(system, find_compiler())
    with pytest.raises(ValueError, match="compiled without rows"):
        run(replace(recorder, recording=None), [source(0)] * LANES, np.ones(LANES))


def source(seed: int) -> Signals:
    """Signals of all kinds; what is random and what is given differs from seed to seed."""
    odd = seed % 2 == 1
    signals = Signals(
        [
            *(RandomSignal(seed, 1, 1.0), RandomSignal(seed, 2, 2.0, 0.97, 3.0), None),
            *(UniformSignal(seed, 3), OutageSignal(seed, 4, 50, 9), None),
            RandomSignal(seed, 5, 0.5) if odd else UniformSignal(seed, 5) if seed % 4 else None,
        ]
    )
    ramp = np.linspace(0, seed, SAMPLES)
    signals.give([None, ramp, SHARED, None, ramp if odd else None, ramp if odd else SHARED, None])
    return signals


def filled(seed: int) -> np.ndarray:
    table = np.empty((SAMPLES, COUNT))
    source(seed).fill(table, 0)
    return table


def run(recorder: Batch, sources: list[Signals], factors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return recorder(factors[:, np.newaxis], sources, np.tile([1.0, 0.0], (LANES, 1)), SAMPLES, stride=1)


def test_every_lane_receives_its_own_signals(recorder: Batch) -> None:
    outcome, done, rows = run(recorder, [source(seed) for seed in range(LANES)], np.ones(LANES))
    assert (outcome == Outcome.COMPLETED).all()
    assert (done == SAMPLES).all()
    for seed in range(LANES):
        assert rows[seed].tobytes() == filled(seed).tobytes()


def test_lanes_that_share_their_signals_all_receive_them(recorder: Batch) -> None:
    shared = source(3)
    for _ in range(2):  # the signals are not changed
        rows = run(recorder, [shared] * LANES, np.ones(LANES))[2]
        assert all(lane.tobytes() == filled(3).tobytes() for lane in rows)


@pytest.mark.parametrize("distinct", [1, 5, LANES])
def test_samples_that_are_done_again_receive_the_same(recorder: Batch, distinct: int) -> None:
    """The samples since the last look are done again where a lane has diverged, here in the second block of them."""
    seeds = [lane % distinct for lane in range(LANES)]
    factors = np.where(np.arange(LANES) == 5, 2e3, 1.0)
    made = [source(seed) for seed in range(distinct)]
    outcome, done, rows = run(recorder, [made[seed] for seed in seeds], factors)
    assert outcome[5] == Outcome.DIVERGED
    assert 64 < done[5] < 128
    for lane in set(range(LANES)) - {5}:
        assert rows[lane].tobytes() == filled(seeds[lane]).tobytes()


def test_a_lane_is_given_up_at_the_next_look_and_leaves_the_others_alone(recorder: Batch) -> None:
    """What is watched is 1 before the first sample and grows by the lane's factor at each."""
    sources, factors = [source(seed) for seed in range(LANES)], np.full(LANES, 1.0)
    factors[[2, 7, 11]] = 1.1, 1.02, 10 ** (1 / (SAMPLES - 5))  # beyond 10 after 25, 117 and, too late, 205 samples
    state = np.tile([1.0, 0.0], (LANES, 1))
    outcome, done, rows = recorder(factors[:, np.newaxis], sources, state, SAMPLES, 1, watched=0, most=10.0)
    assert (outcome[[2, 7]] == Outcome.GIVEN_UP).all()
    assert done[[2, 7]].tolist() == [64, 128]
    others = np.delete(np.arange(LANES), [2, 7])
    assert (outcome[others] == Outcome.COMPLETED).all()
    assert (done[others] == SAMPLES).all()
    for lane in others:
        assert rows[lane].tobytes() == filled(int(lane)).tobytes()
    assert np.isfinite(rows[7][:128]).all()
    assert np.isnan(rows[7][128:]).all()


def test_a_scenario_in_some_lanes_receives_the_same_in_each(recorder: Batch) -> None:
    first, second = source(1), source(2)
    rows = run(recorder, [first, second] * (LANES // 2), np.ones(LANES))[2]
    for lane in range(LANES):
        assert rows[lane].tobytes() == filled(1 + lane % 2).tobytes()


@pytest.mark.parametrize("distinct", range(2, LANES, 3))
def test_any_number_of_scenarios_shares_the_lanes(distinct: int, recorder: Batch) -> None:
    made = [source(seed) for seed in range(distinct)]
    of = np.random.default_rng(distinct).integers(distinct, size=LANES)
    rows = run(recorder, [made[seed] for seed in of], np.ones(LANES))[2]
    for lane in range(LANES):
        assert rows[lane].tobytes() == filled(of[lane]).tobytes()


def left_scalar(compiler: Compiler, source: str, folder: Path) -> list[str]:
    """Functions in lanes whose loops gcc leaves scalar."""
    (folder / "unit.c").write_text(source, encoding="utf-8")
    flags = (*compiler.flags, *lane_flags(compiler), "-fopt-info-vec-all=said", "-o", "unit.so")
    subprocess.run([*compiler.command, *flags, "unit.c", "-lm"], cwd=folder, check=True)
    lines = source.splitlines()
    loops = {
        number: line
        for number, line in enumerate(lines, 1)
        if line.lstrip().startswith(("EACH_CALL", "SAMPLE_LANES(")) and not line.endswith("\\")
    }
    said = (folder / "said").read_text().splitlines()
    done, left = (
        {int(line.split(":")[1]) for line in said if words in line} & loops.keys()
        for words in ("optimized: loop vectorized", "missed: couldn't vectorize loop")
    )
    assert done
    return [loops[number] for number in left - done]


@pytest.mark.slow
@pytest.mark.parametrize("ensemble", ["sea", "rig", "site"])
def test_gcc_vectorises_every_loop(ensemble: str, tmp_path: Path) -> None:
    """gcc gives up a loop of more than a thousand reads and writes unless told otherwise."""
    compiler = find_compiler()
    if compiler.is_clang:
        pytest.skip("clang says what it does in other words")
    loop = closed_loop(structure_of(tuning_problem(ensemble=ensemble).experiment))
    for source_of in (batch_source, rows_source):
        assert left_scalar(compiler, source_of(loop, compiler), tmp_path) == []


def test_only_short_functions_process_two_lanes_per_call(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Compiler, "pairs", True)
    x = ca.SX.sym("x", PAIRED_STATEMENTS)
    short, long = (ca.Function("f", [each], [ca.sin(each)], ["x"], ["y"]) for each in (x[:5], x))
    once = ca.Function("derive", [x], [ca.sin(x)], ["parameters"], ["derived"])
    assert paired([short, once], find_compiler())
    assert not paired([short, long], find_compiler())
