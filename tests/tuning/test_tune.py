"""Tuning in one call, the choice of the best, and the figures of a study."""

from itertools import pairwise

import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.tree import leaves
from dualwinch.tuning.plots.score import before_and_after, held_out
from dualwinch.tuning.plots.search import front, history, importance, importances, parallel_coordinates
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.selection import FINALISTS, RUNG, rungs
from dualwinch.tuning.tune import Tuned, tune
from tests.tuning.conftest import MakeProblem


@pytest.fixture
def tuned(make_problem: MakeProblem) -> Tuned:
    return tune(make_problem(), trials=60, held_out=6)


def test_the_best_is_the_tuned_experiment_and_the_numbers_are_exact(tuned: Tuned) -> None:
    assert [one.number for one in tuned.trials] == list(range(60))
    settings = tuned.problem.space.settings(tuned.verdict.best.point)
    assert leaves(tuned.best)["controller.nftsm.beta"] == settings["controller.nftsm.beta"]
    assert tuned.verdict.held_out
    assert tuned.verdict.held_out.scenarios == 6


def test_a_budget_is_needed(make_problem: MakeProblem) -> None:
    with pytest.raises(ConfigurationError, match="needs a budget, trials or seconds"):
        tune(make_problem())


def test_every_figure_says_what_it_shows(tuned: Tuned) -> None:
    problem, trials, verdict = tuned.problem, tuned.trials, tuned.verdict
    drawn = (
        history(problem, trials),
        importance(problem, trials),
        parallel_coordinates(problem, trials),
        front(problem, trials),
        before_and_after(problem, verdict),
        held_out(verdict),
    )
    for figure in drawn:
        assert figure
        assert figure.texts[0].get_text()
        assert all(axes.lines or axes.patches for axes in figure.axes)
    assert sum(importances(problem, trials).values()) == pytest.approx(1)


def test_the_ladder_goes_from_the_best_to_the_cautious() -> None:
    ordered = [Evaluation(Candidate({}, ""), (1.01**place,), {}, {}, {}, 1) for place in range(400)]
    places = rungs(ordered)
    values = [ordered[place].objectives[0] for place in places]
    assert len(places) == FINALISTS
    assert places[0] == 0
    assert all(after / before > RUNG for before, after in pairwise(values))
