"""The record of what runs came to."""

import re

import numpy as np

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.unit import c_file
from dualwinch.simulation.results.outcomes import WORDS, RunOutcomes, concatenated, words_of

RUNS = RunOutcomes(
    outcomes=np.array([["completed", "diverged", "completed"], ["left_track", "completed", "not_run"]]),
    end_times=np.array([[25.0, 1.0, 25.0], [2.0, 25.0, np.nan]]),
    metrics={"mse": np.array([[1.0, np.nan, 3.0], [np.nan, 5.0, np.nan]])},
)


def test_c_and_python_number_outcomes_alike() -> None:
    (listed,) = re.findall(r"enum \{ (COMPLETED[^}]*) \}", c_file("driver.h"))
    numbers = dict(entry.split(" = ") for entry in listed.split(", "))
    assert numbers == {outcome.name: str(int(outcome)) for outcome in Outcome if outcome is not Outcome.NOT_RUN}


def test_every_outcome_has_a_word() -> None:
    assert words_of(np.arange(len(Outcome))).tolist() == [WORDS[outcome] for outcome in Outcome]
    assert len(set(WORDS.values())) == len(Outcome)


def test_completed_runs_and_counts() -> None:
    assert RUNS.completed.tolist() == [[True, False, True], [False, True, False]]
    assert RUNS.of_completed("mse").tolist() == [1.0, 3.0, 5.0]
    assert RUNS.outcome_counts == {"completed": 3, "diverged": 1, "left_track": 1, "not_run": 1}
    assert next(iter(RUNS.outcome_counts)) == "completed"


def test_parts_and_their_sum() -> None:
    row = RUNS.take(1, axis=0)
    assert (row.outcomes.tolist(), row.end_times[0]) == (["left_track", "completed", "not_run"], 2.0)
    parts = [RUNS.take([0], axis=1), RUNS.take([1, 2], axis=1)]
    np.testing.assert_equal(vars(concatenated(parts)), vars(RUNS))
    assert RUNS.reshape([6]).metrics["mse"].shape == (6,)
