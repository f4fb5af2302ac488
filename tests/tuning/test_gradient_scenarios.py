"""Which scenarios a gradient is taken in."""

import numpy as np
import pytest

from dualwinch.tuning.optimisers import linearise as module
from dualwinch.tuning.optimisers.linearise import HARDEST, active_scenarios
from dualwinch.tuning.scoring.rollouts import counts, run_pairs
from dualwinch.tuning.scoring.training_set import prepare
from tests.studies import MakeProblem

BOUNDS = ["mean.chatter<=1*paper", "worst.peak_tension<=6000", "worst.min_tension>=80"]


def test_those_that_count_in_means_and_the_hardest_of_each_bound(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem(scenarios=8, constraints=BOUNDS))
    space, point = prepared.problem.space, prepared.problem.start
    everywhere = [*prepared.scenarios, *prepared.hard]
    ran = run_pairs(space.keys, [space.parameters(point)], everywhere)
    assert (ran.outcomes == "completed").all()
    wanted = {index for index, one in enumerate(everywhere) if counts(prepared.problem.objectives[0], one)}
    wanted |= set(np.argsort(ran.metrics["peak_tension"][0])[-HARDEST:].tolist())
    wanted |= set(np.argsort(ran.metrics["min_tension"][0])[:HARDEST].tolist())
    found = active_scenarios(prepared, point)
    assert [id(scenario) for scenario in found] == [id(everywhere[index]) for index in sorted(wanted)]
    assert len(found) < len(everywhere)


def test_an_experiment_alone_is_not_run_for_that(make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    prepared = prepare(make_problem(ensemble=None, case=4))
    monkeypatch.setattr(module, "run_pairs", lambda *_: pytest.fail("is run"))
    assert active_scenarios(prepared, prepared.problem.start) == list(prepared.scenarios)
