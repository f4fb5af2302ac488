"""Orders of candidates: constraints first, then what is sound."""

import math

from dualwinch.tuning.scoring.ranking import (
    Candidate,
    Evaluation,
    backed_off_first,
    best_first,
    improves_on,
    pareto_front,
)
from dualwinch.tuning.selection_config import SelectionConfig

MARGIN = 0.01


def reached(*objectives: float, beyond: float = 0.0, pruned: bool = False) -> Evaluation:
    """An evaluation whose highest peak lies that share of the bound beyond it."""
    return Evaluation(Candidate({}, ""), objectives, {"worst.peak_tension <= 6000 N": beyond}, {}, {}, 1, pruned)


def test_what_keeps_off_its_bound_is_sounder_unless_it_is_much_worse() -> None:
    on_the_bound, off_it = reached(1.0, beyond=0.0), reached(1.4, beyond=-MARGIN)
    assert best_first([on_the_bound, off_it]) == [0, 1]
    assert backed_off_first([on_the_bound, off_it], MARGIN) == [1, 0]
    far_worse = reached(1.01 * math.exp(SelectionConfig.penalty * MARGIN), beyond=-MARGIN)
    assert backed_off_first([on_the_bound, far_worse], MARGIN) == [0, 1]


def test_further_off_than_the_margin_is_no_sounder() -> None:
    assert backed_off_first([reached(1.0, beyond=-0.2), reached(0.9, beyond=-MARGIN)], MARGIN) == [1, 0]


def test_who_breaks_a_bound_or_was_given_up_comes_behind_who_keeps_to_all() -> None:
    judged = [reached(0.1, beyond=1e-6), reached(9.0, beyond=0.0), reached(0.01, beyond=-1.0, pruned=True)]
    assert backed_off_first(judged, MARGIN) == [1, 0, 2]


def test_several_objectives_and_those_without_a_logarithm_are_ordered_as_the_best() -> None:
    for judged in (
        [reached(2.0, 1.0, beyond=-1.0), reached(1.0, 0.5, beyond=0.0)],
        [reached(0.0, beyond=-1.0), reached(-1.0, beyond=0.0)],
    ):
        assert backed_off_first(judged, MARGIN) == best_first(judged)


def test_the_best_comes_first_constraints_before_objective() -> None:
    evaluations = [reached(1, beyond=0.5), reached(3), reached(0.1, pruned=True), reached(2), reached(9, beyond=0.1)]
    assert best_first(evaluations) == [3, 1, 4, 0, 2]


def test_the_front_is_what_no_other_feasible_one_beats() -> None:
    evaluations = [reached(1, 4), reached(2, 2), reached(3, 3), reached(4, 1), reached(0, 0, beyond=1), reached(2, 2)]
    assert pareto_front(evaluations) == [0, 1, 5, 3]
    assert best_first(evaluations)[-2:] == [2, 4]


def test_better_than_the_start_is_what_breaks_no_more_and_has_a_smaller_objective() -> None:
    start = reached(1)
    assert improves_on(reached(0.5), start)
    assert not improves_on(reached(1), start)
    assert not improves_on(reached(2), start)
    assert not improves_on(reached(0.5, beyond=0.1), start)
    assert not improves_on(reached(0.5, pruned=True), start)
    loud = reached(1, beyond=0.5)
    assert improves_on(reached(2), loud)  # constraints come first
    assert improves_on(reached(0.5, beyond=0.1), loud)
    assert not improves_on(reached(2, beyond=0.1), loud)
    assert not improves_on(reached(0.5, beyond=0.6), loud)
    assert improves_on(reached(2, 1), reached(1, 2))
    assert not improves_on(reached(2, 2), reached(1, 2))
