"""The driver that steps many runs, on a system that knows nothing of winches."""

import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.rollout import compile_rollout
from dualwinch.codegen.drivers.stepping import Commanded, SteppedRuns, compile_stepping, stepping_source
from tests.codegen.drivers.test_rollout import SANITISERS
from tests.codegen.toy import oscillator

PARAMETERS = np.array([40.0, 0.5, 0.01])
START = np.array([0.5, 0.0, 0.0])


def commanded(*, one_step: bool = False) -> Commanded:
    """The oscillator; its speed is commanded, position and acceleration are observed."""
    system = oscillator(one_step=one_step)
    inputs = [ca.SX.sym(name, system.observe.size1_in(name)) for name in system.observe.name_in()]
    names = system.observe.name_in()
    sense = ca.Function("sense", inputs, [system.observe(*inputs)], names, ["observation"])
    return Commanded(system, sense, ((1,),))


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("one_step", [True, False])
@pytest.mark.parametrize("count", [1, 5, 16, 21])
def test_runs_are_those_of_single_rollouts(exact: bool, one_step: bool, count: int) -> None:
    system = commanded(one_step=one_step)
    rng = np.random.default_rng(0)
    parameters = PARAMETERS * rng.uniform(0.8, 1.2, (count, 3))
    forces, speeds = rng.uniform(-5, 5, (count, 31, 1)), rng.uniform(-0.5, 0.5, (30, count))
    runs = SteppedRuns(compile_stepping(system, exact=exact), count, 30, shared=False)
    runs.start(np.arange(count), np.tile(START, (count, 1)), parameters)
    for run in range(count):
        runs.read(run, forces[run].ctypes.data)
    single = compile_rollout(system.system)
    states = np.tile(START, (count, 1))
    for k, speed in enumerate(speeds):
        runs.commands[:, 0] = speed
        assert runs.odd_command() is None
        under_way = runs.step(1)
        for run in range(count):
            if k == 0 or abs(states[run, 0]) <= 1:
                states[run, 1] = speed[run]
                single(parameters[run], forces[run, k : k + 1], states[run], 0)
        assert under_way == np.count_nonzero(runs.outcomes == Outcome.RUNNING)
    np.testing.assert_allclose(runs.states(np.arange(count)), states, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(runs.observation[0], states[:, 0], rtol=1e-12)
    expected = np.where(np.abs(states[:, 0]) > 1, Outcome.LEFT, Outcome.COMPLETED)
    np.testing.assert_array_equal(runs.outcomes, expected)


@pytest.mark.parametrize("exact", [True, False])
def test_outcomes_are_each_runs_own(exact: bool) -> None:
    runs = SteppedRuns(compile_stepping(commanded(), exact=exact), 4, 50, shared=True)
    assert runs.outcomes.tolist() == [Outcome.COMPLETED] * 4  # nothing to step before they are started
    assert runs.step(1) == 0
    runs.start(np.arange(3), np.tile(START, (3, 1)), PARAMETERS[np.newaxis])
    quiet, poisoned = np.zeros((51, 1)), np.zeros((51, 1))
    poisoned[7] = np.nan
    for run, table in enumerate((quiet, poisoned, quiet)):
        runs.read(run, table.ctypes.data)
    runs.commands[:, 0] = [0.0, 0.0, 60.0, np.nan]
    assert runs.odd_command() is None  # the last is not under way
    assert runs.step(1000) == 0
    assert runs.outcomes.tolist() == [Outcome.COMPLETED, Outcome.DIVERGED, Outcome.LEFT, Outcome.COMPLETED]
    assert runs.done.tolist()[:2] == [50, 8]
    assert runs.done[2] == 1
    runs.start(np.array([1]), START[np.newaxis], PARAMETERS[np.newaxis])
    runs.commands[1] = -np.inf
    assert runs.odd_command() == (1, 0)


def test_the_driver_is_clean_under_sanitizers(tmp_path: Path) -> None:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("needs gcc with its sanitizers")
    harness = """
#include <stdio.h>
#define COUNT (3 * LANES + 1)
int main(void) {
  static LANE_ARRAY state[4 * STATES * LANES];
  static double commands[COUNT], observation[OBSERVED * COUNT], line[61], rows[60 * COLUMNS];
  static Constants constants;
  static const double *lines[4 * LANES];
  static int64_t outcome[4 * LANES], done[4 * LANES];
  double parameters[LANES * PARAMETERS];
  for (int l = 0; l < LANES; ++l) {
    parameters[l * PARAMETERS] = 40; parameters[l * PARAMETERS + 1] = 0.5; parameters[l * PARAMETERS + 2] = 0.01;
  }
  for (int run = 0; run < 4 * LANES; ++run) { lines[run] = line; outcome[run] = run < COUNT ? RUNNING : COMPLETED; }
  prepare(parameters, &constants);
  Runs runs = {&constants, 0, lines, state, outcome, done, commands, observation, COUNT, 60};
  look(&runs, 0, 4);
  int64_t running = odd_command(&runs);
  running = step(&runs, 0, 1, 60, rows);
  for (int k = 0; k < 10; ++k) running = step(&runs, 0, 4, 7, 0);
  printf("%d %d\\n", (int)running, (int)done[COUNT - 1]);
}
"""
    for exact in (True, False):
        (tmp_path / "unit.c").write_text(
            stepping_source(commanded(one_step=True), find_compiler(), exact=exact) + harness
        )
        built = subprocess.run(
            [gcc, "-std=gnu99", "-O1", "-g", "-Wno-unknown-pragmas", *SANITISERS, "unit.c", "-o", "unit", "-lm"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert built.returncode == 0, built.stderr[:2000]
        done = subprocess.run([str(tmp_path / "unit")], capture_output=True, text=True, check=False)
        assert done.stderr == ""
        assert done.stdout.split() == ["0", "60"]
