import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.rollout import compile_rollout, rollout_source
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import CASES, CONTROLLERS, case
from tests.codegen.toy import oscillator
from tests.tiers import mostly_slow

SANITISERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
PARAMETERS = np.array([40.0, 0.5, 0.01])


def by_hand(samples: int, force: float = 0.0) -> np.ndarray:
    x, v, rows = 0.5, 0.0, []
    for _ in range(samples):
        acceleration = (force - 40.0 * x) / (2 * 0.5)
        rows.append((x, acceleration))
        x, v = x + 0.01 * v, v + 0.01 * acceleration
    return np.array(rows)


def test_rows_are_those_of_a_plain_loop() -> None:
    run, state = compile_rollout(oscillator()), np.array([0.5, 0.0, 0.0])
    outcome, done, rows = run(PARAMETERS, np.zeros((20, 1)), state)
    assert (outcome, done) == (Outcome.COMPLETED, 20)
    np.testing.assert_allclose(rows, by_hand(20), rtol=1e-14)


@pytest.mark.parametrize("stride", [1, 3, 20, 50])
def test_stride_keeps_every_nth_row(stride: int) -> None:
    run = compile_rollout(oscillator())
    _, _, rows = run(PARAMETERS, np.zeros((20, 1)), np.array([0.5, 0.0, 0.0]), stride)
    np.testing.assert_allclose(rows, by_hand(20)[::stride], rtol=1e-14)


def test_no_rows_on_request_and_the_state_goes_on() -> None:
    run, whole, halves = compile_rollout(oscillator()), np.array([0.5, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])
    assert run(PARAMETERS, np.zeros((20, 1)), whole, 0)[2].shape == (0, 2)
    for samples in (7, 13):
        run(PARAMETERS, np.zeros((samples, 1)), halves, 0)
    np.testing.assert_array_equal(whole, halves)


def test_a_crossed_margin_ends_the_run() -> None:
    run, state = compile_rollout(oscillator()), np.array([0.5, 0.0, 0.0])
    outcome, done, rows = run(PARAMETERS, np.full((1000, 1), 100.0), state)
    assert outcome == Outcome.LEFT
    assert abs(state[0]) > 1
    assert len(rows) == done < 1000
    np.testing.assert_allclose(rows, by_hand(done, 100.0), rtol=1e-12)


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_a_non_finite_number_ends_the_run(poison: float) -> None:
    run, state = compile_rollout(oscillator()), np.array([0.5, 0.0, 0.0])
    force = np.zeros((100, 1))
    force[41] = poison
    outcome, done, rows = run(PARAMETERS, force, state)
    assert (outcome, done, len(rows)) == (Outcome.DIVERGED, 42, 42)


def test_the_one_step_update_is_taken_only_where_it_is_valid() -> None:
    with_one_step, without = (compile_rollout(oscillator(one_step=True)), compile_rollout(oscillator()))
    states = np.array([0.5, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])
    force = 10 * np.sin(np.arange(300.0))[:, None]
    results = [run(PARAMETERS, force, state) for run, state in zip((with_one_step, without), states, strict=True)]
    np.testing.assert_allclose(results[0][2], results[1][2], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(*states, rtol=1e-12)


@pytest.mark.parametrize("kind", mostly_slow(((kind,) for kind in CONTROLLERS), lambda row: row == ("fando-nftsm",)))
def test_the_closed_loop_is_clean_under_sanitizers(kind: str, tmp_path: Path) -> None:
    """Address and undefined-behaviour sanitizers, over all four cases of the paper."""
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("needs gcc with its sanitizers")
    loop = closed_loop(structure_of(case(4, kind)))
    harness = (Path(__file__).parent / "sanitised.c").read_text()
    (tmp_path / "unit.c").write_text(rollout_source(loop) + harness)
    built = subprocess.run(
        [gcc, "-std=c99", "-O1", "-g", *SANITISERS, "unit.c", "-o", "unit", "-lm"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr[:2000]
    for number in CASES:
        experiment = case(number, kind)
        data = b"".join(
            (
                np.int64(experiment.samples).tobytes(),
                np.array(list(parameters_of(experiment).values())).tobytes(),
                np.array(list(initial_state_of(experiment).values())).tobytes(),
                exogenous_signals(experiment).tobytes(),
            )
        )
        done = subprocess.run([str(tmp_path / "unit")], input=data, capture_output=True, check=False)
        assert done.stderr == b""
        assert done.stdout.split() == [b"0", str(experiment.samples).encode()]
