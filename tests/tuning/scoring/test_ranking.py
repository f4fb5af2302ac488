"""Orders of candidates: constraints first, then what is sound."""

from dataclasses import replace

from dualwinch.tuning.scoring.ranking import (
    Candidate,
    Evaluation,
    feasibility_first,
    improves_on,
    pareto_front,
    rarest_violations_first,
)


def reached(*objectives: float, beyond: float = 0.0, pruned: bool = False) -> Evaluation:
    """An evaluation whose highest peak lies that share of the bound beyond it."""
    return Evaluation(Candidate({}, ""), objectives, {"worst.peak_tension <= 6000 N": beyond}, {}, {}, 1, pruned)


def test_the_best_comes_first_constraints_before_objective() -> None:
    evaluations = [reached(1, beyond=0.5), reached(3), reached(0.1, pruned=True), reached(2), reached(9, beyond=0.1)]
    assert feasibility_first(evaluations) == [3, 1, 4, 0, 2]


def test_the_front_is_what_no_other_feasible_one_beats() -> None:
    evaluations = [reached(1, 4), reached(2, 2), reached(3, 3), reached(4, 1), reached(0, 0, beyond=1), reached(2, 2)]
    assert pareto_front(evaluations) == [0, 1, 5, 3]
    assert feasibility_first(evaluations)[-2:] == [2, 4]


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


def test_better_than_the_start_is_also_what_violates_bounds_in_fewer_scenarios() -> None:
    rare, often = (replace(reached(1, beyond=0.5), violated=count) for count in (1, 9))
    assert improves_on(replace(rare, objectives=(2,)), often)
    assert not improves_on(often, rare)
    for bound in ("mean.chatter <= 1 N", "worst.disk_margin >= 0.4"):
        assert not improves_on(replace(rare, violations=rare.violations | {bound: 0.1}), often)


def test_rare_violations_are_weighed_against_the_objective() -> None:
    evaluations = [reached(1), reached(2), reached(10)]
    assert rarest_violations_first(evaluations, [0.04, 0.01, 0.0], penalty=50) == [1, 0, 2]  # factors e^2 and e^0.5
    assert rarest_violations_first(evaluations, [0.04, 0.01, 0.0], penalty=500) == [2, 1, 0]
    assert rarest_violations_first([reached(-1), reached(2)], [0.02, 0.01]) == [1, 0]


def test_a_margin_that_is_lost_weighs_more_than_one_that_nearly_suffices() -> None:
    """Neither violates a bound in any run."""
    lost, near = (
        replace(reached(cost), violations={"worst.disk_margin >= 0.3": short, "worst.peak_tension <= 8500 N": -0.1})
        for cost, short in ((1, 1.0), (3, 0.02))
    )
    assert rarest_violations_first([lost, near], [0.0, 0.0]) == [1, 0]
