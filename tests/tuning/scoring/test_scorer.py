"""Scoring: rollouts given up, divergence that stays finite, interrupts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.tuning.scoring import rollouts as runs
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate
from dualwinch.tuning.scoring.scorer import FAILED, Scorer
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare
from dualwinch.tuning.storage.record import evaluation_of, finished_trial
from tests.studies import MakeProblem


def test_candidates_with_slack_ropes_are_given_up_where_no_rope_may_be_slack(make_problem: MakeProblem) -> None:
    kp = "controller.winch_1.kp"
    tight, free = (
        Evaluator(
            prepare(
                make_problem(
                    settings=["simulation.duration=1"],
                    space=[f"{kp}=1e-4:10:log"],
                    scenarios=2,
                    constraints=bounds,
                )
            )
        )
        for bounds in (["worst.min_tension>=10"], ["mean.chatter<=100*paper"])
    )
    stiff, start = Candidate({kp: 0.5}, "method"), Candidate({kp: 0.5}, "start")
    (ours,) = tight.evaluate([stiff])
    assert ours.outcomes["went_slack"] > 0
    assert ours.statistics["worst.min_tension"] == 0
    assert ours.violations["worst.min_tension >= 10 N"] == 1
    assert ours.violations[FAILED] > 0
    (theirs,) = free.evaluate([stiff])
    assert set(theirs.outcomes) == {"completed"}, "where ropes may be slack nobody is given up for it"
    assert theirs.statistics["worst.min_tension"] == 0
    (first,) = tight.evaluate([start])
    assert set(first.outcomes) == {"completed"}, "what others are compared with runs to its end"
    assert set(tight.over([stiff], tight.training.scenarios)[0].outcomes) == {"completed"}


def test_diverged_candidates_are_infeasible_finite_and_survive_storage(make_problem: MakeProblem) -> None:
    problem = make_problem(
        settings=["simulation.duration=1"],
        space=["controller.winch.kd=0:100", "controller.winch.kp=1e-5:1e9"],
        scenarios=1,
    )
    prepared = prepare(problem)
    wild = Candidate({"controller.winch.kd": 90.0, "controller.winch.kp": 1e9}, "x")
    found = Evaluator(prepared).evaluate([wild])[0]
    numbers = [*found.objectives, *found.violations.values(), *found.statistics.values()]
    assert all(map(math.isfinite, numbers))
    assert finished_trial(found, problem.space).state.name == "COMPLETE"
    lost = Scorer(prepared).evaluation(found.candidate, _all_diverged(prepared), prepared.scenarios)
    assert lost.violations[FAILED] == 1
    assert not lost.feasible
    assert lost.outcomes == {"diverged": 1}
    again = evaluation_of(finished_trial(lost, problem.space))
    assert (again.objectives, again.violations, again.statistics) == (lost.objectives, lost.violations, lost.statistics)


def _all_diverged(prepared: TrainingSet) -> BatchResult:
    result = prepared.paper
    broken = {name: np.full_like(values, np.nan) for name, values in result.metrics.items()}
    return replace(result, outcomes=np.full_like(result.outcomes, "diverged"), metrics=broken)


def test_an_interrupt_is_raised_even_where_every_rollout_is_finished(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A batch is so short that all of it is under way when Ctrl-C comes: it must not be lost."""
    prepared = prepare(make_problem())
    whole = runs.rollout
    monkeypatch.setattr(runs, "rollout", lambda *words, **more: replace(whole(*words, **more), interrupted=True))
    with pytest.raises(KeyboardInterrupt):
        Evaluator(prepared).evaluate([Candidate(prepared.problem.start, "")])
