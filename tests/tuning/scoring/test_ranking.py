"""Orders of candidates: constraints first, then what is sound."""

from dataclasses import replace

from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.constraints import constraints_from
from dualwinch.tuning.scoring.ranking import (
    Candidate,
    Evaluation,
    feasibility_first,
    improves_on,
    pareto_front,
    penalised_first,
)

BOUNDS = constraints_from(["worst.peak_tension<=6000", "mean.chatter<=1", "worst.disk_margin>=0.4"], Experiment())


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
    assert improves_on(reached(0.5), start, BOUNDS)
    assert not improves_on(reached(1), start, BOUNDS)
    assert not improves_on(reached(2), start, BOUNDS)
    assert not improves_on(reached(0.5, beyond=0.1), start, BOUNDS)
    assert not improves_on(reached(0.5, pruned=True), start, BOUNDS)
    loud = reached(1, beyond=0.5)
    assert improves_on(reached(2), loud, BOUNDS)  # constraints come first
    assert improves_on(reached(0.5, beyond=0.1), loud, BOUNDS)
    assert not improves_on(reached(2, beyond=0.1), loud, BOUNDS)
    assert not improves_on(reached(0.5, beyond=0.6), loud, BOUNDS)
    assert improves_on(reached(2, 1), reached(1, 2), BOUNDS)
    assert not improves_on(reached(2, 2), reached(1, 2), BOUNDS)


def test_better_than_the_start_is_also_what_violates_bounds_in_fewer_scenarios() -> None:
    rare, often = (replace(reached(1, beyond=0.5), violated=count) for count in (1, 9))
    assert improves_on(replace(rare, objectives=(2,)), often, BOUNDS)
    assert not improves_on(often, rare, BOUNDS)
    for bound in ("mean.chatter <= 1 N", "worst.disk_margin >= 0.4"):
        assert not improves_on(replace(rare, violations=rare.violations | {bound: 0.1}), often, BOUNDS)


def test_a_penalty_weighs_violations_against_the_objective() -> None:
    evaluations = [reached(1, beyond=0.04), reached(2, beyond=0.01), reached(10)]
    assert penalised_first(evaluations, penalty=50) == [1, 0, 2]  # factors e^2 and e^0.5
    assert penalised_first(evaluations, penalty=500) == [2, 1, 0]
    assert penalised_first([reached(-1, beyond=0.02), reached(2, beyond=0.01)]) == [1, 0], "no logarithm: bounds first"
