import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.toolboxes.stress.limits import DEFAULTS, constraints_of, failures, limits_of, violated_limits

EXPERIMENT = Experiment()


def reached(
    *given: dict[str, tuple[float, float]], outcomes: tuple[str, ...] = ("completed", "completed")
) -> RunOutcomes:
    """What two scenarios came to; later values take the place of earlier ones."""
    metrics = {name: np.array(values) for each in given for name, values in each.items()}
    return RunOutcomes(np.array(outcomes), np.full(len(outcomes), np.nan), metrics)


GOOD = {"slack_share": (0.0, 0.0), "peak_tension": (5000.0, 5500.0), "mse": (1e-8, 4e-8), "min_tension": (200.0, 90.0)}


def test_defaults_stand_behind_what_a_study_has_noted() -> None:
    assert [constraint.text for constraint in constraints_of(None, (), EXPERIMENT)] == list(DEFAULTS)
    noted = ("worst.peak_tension<=5000", "mean.chatter<=0.25*paper")
    found = [constraint.text for constraint in constraints_of(None, noted, EXPERIMENT)]
    assert found == [*noted, *(text for text in DEFAULTS if "peak_tension" not in text)]
    assert [constraint.text for constraint in constraints_of((), noted, EXPERIMENT)] == []
    with pytest.raises(ConfigurationError, match="must be STATISTIC<=BOUND"):
        constraints_of(("peak",), (), EXPERIMENT)


def test_factors_are_on_what_the_papers_gains_reach_in_the_base() -> None:
    constraints = constraints_of(None, (), EXPERIMENT)
    limits = limits_of(constraints, reached(GOOD), {"own": reached(GOOD, {"mse": (1e-9, 1e-9)})})
    assert [limit.constraint.bound for limit in limits] == [0.0, 6000.0, pytest.approx(1.6e-7)]
    assert not any(limit.eased for limit in limits)


def test_paper_gains_that_complete_no_run_bound_nothing() -> None:
    constraints = constraints_of(("worst.mse<=4*paper", "worst.peak_tension<=5000"), (), EXPERIMENT)
    lost = reached(GOOD, outcomes=("left_track", "diverged"))
    assert [limit.words for limit in limits_of(constraints, lost, {"own": reached(GOOD)})] == [
        "worst.peak_tension <= 5000 N"
    ]


def test_who_breaks_a_constraint_in_the_base_may_become_twice_as_bad() -> None:
    constraints = constraints_of(("worst.min_tension>=100", "worst.peak_tension<=5000"), (), EXPERIMENT)
    limits = limits_of(constraints, reached(GOOD), {"paper": reached(GOOD)})
    assert [limit.constraint.bound for limit in limits] == [45.0, 11000.0]
    assert [limit.requested.bound for limit in limits] == [100.0, 5000.0]
    assert all(limit.eased for limit in limits)
    assert violated_limits(limits, reached(GOOD)) == ()
    worse = {"min_tension": (44.0, 90.0), "peak_tension": (11500.0, 1.0)}
    assert [each.name for each in violated_limits(limits, reached(GOOD, worse))] == ["peak_tension", "min_tension"]


def test_runs_that_end_early_come_first_then_the_largest_share() -> None:
    constraints = constraints_of(("worst.peak_tension<=5000", "worst.min_tension>=100"), (), EXPERIMENT)
    good = reached(GOOD, {"peak_tension": (4000.0, 4000.0), "min_tension": (150.0, 150.0)})
    limits = limits_of(constraints, good, {"paper": good})
    bad = reached({"peak_tension": (np.nan, 6000.0), "min_tension": (np.nan, 20.0)}, outcomes=("diverged", "completed"))
    assert [each.words for each in violated_limits(limits, bad)] == [
        "diverged in 1 scenario",
        "min tension 20 N < 100 N",
        "peak tension 6000 N > 5000 N",
    ]
    lost = reached(GOOD, outcomes=("left_track", "left_track"))
    assert [each.words for each in violated_limits(limits, lost)] == ["left track in 2 scenarios"]
    assert [each.words for each in violated_limits((), lost)] == ["left track in 2 scenarios"]


def test_a_bound_that_some_gains_lie_on_is_eased_for_all_alike() -> None:
    """The paper's gains lie on their own value; gains just below it would break by a thousandth."""
    constraints = constraints_of(
        ("worst.peak_tension<=1*paper", "worst.min_tension>=1*paper", "worst.mse<=4*paper"), (), EXPERIMENT
    )
    below = reached(GOOD, {"peak_tension": (5400.0, 5490.0), "min_tension": (91.0, 95.0)})
    peak, least, error = limits_of(constraints, reached(GOOD), {"paper": reached(GOOD), "own": below})
    assert (peak.constraint.bound, least.constraint.bound) == (11000.0, 45.0)
    assert (peak.on_bound, peak.violated_by) == (("paper",), ())
    assert not error.eased
    assert peak.easing() == "worst.peak_tension <= 5500 N is eased to 11000 N: paper lies on it in the base"
    assert least.easing() == "worst.min_tension >= 90 N is eased to 45 N: paper lies on it in the base"
    assert error.easing() == ""
    alone = limits_of(constraints, reached(GOOD), {"own": below})
    assert not any(limit.eased for limit in alone)


def test_a_bound_of_zero_that_all_lie_on_stays() -> None:
    constraints = constraints_of(("worst.slack_share<=1*paper",), (), EXPERIMENT)
    (slack,) = limits_of(constraints, reached(GOOD), {"paper": reached(GOOD)})
    assert not slack.eased
    assert slack.constraint.bound == 0.0


def test_a_figure_that_no_run_has_eases_no_bound() -> None:
    constraints = constraints_of(("worst.mse<=1e-9",), (), EXPERIMENT)
    none = reached(GOOD, {"mse": (np.nan, np.nan)})
    (error,) = limits_of(constraints, reached(GOOD), {"paper": none})
    assert not error.eased
    assert violated_limits([error], none)


def test_a_bound_that_some_gains_violate_is_eased_to_twice_the_worst_of_them() -> None:
    constraints = constraints_of(("worst.peak_tension<=1*paper",), (), EXPERIMENT)
    gains = {
        name: reached(GOOD, {"peak_tension": (5000.0, peak)})
        for name, peak in (("paper", 5500.0), ("a", 5700.0), ("b", 5600.0), ("c", 5000.0))
    }
    (peak,) = limits_of(constraints, gains["paper"], gains)
    assert peak.constraint.bound == 11400.0
    assert (peak.on_bound, peak.violated_by) == (("paper",), ("a", "b"))
    assert peak.easing() == (
        "worst.peak_tension <= 5500 N is eased to 11400 N: paper lies on it and a and b violate it in the base"
    )
    assert peak.to_record() == {
        "asked": "worst.peak_tension<=1*paper",
        "statistic": "worst.peak_tension",
        "at_least": False,
        "asked_bound": 5500.0,
        "bound": 11400.0,
        "unit": "N",
        "eased": True,
        "on_bound": ["paper"],
        "violated_by": ["a", "b"],
    }


@pytest.mark.parametrize(
    ("reached_in_base", "words"),
    [
        ({"slack_share": (0.0, 0.745)}, ["slack share 74.5 % > 0 %"]),
        ({"min_tension": (0.0, 150.0)}, ["min tension 0 N < 120 N"]),
        ({"peak_tension": (638970.0, 1.0)}, ["peak tension 638970 N > 6000 N"]),
        ({"slack_share": (0.0, 0.00256)}, []),
        ({"min_tension": (80.0, 150.0)}, []),
        ({"mse": (30.0, 49.0)}, []),
    ],
)
def test_gains_fail_in_the_base_where_an_eased_bound_would_bound_nothing(
    reached_in_base: dict[str, tuple[float, float]], words: list[str]
) -> None:
    noted = ("worst.min_tension>=120", "worst.peak_tension<=6000", "worst.slack_share<=0", "worst.mse<=4*paper")
    good = reached(GOOD, {"min_tension": (200.0, 150.0)}, reached_in_base)
    limits = limits_of(constraints_of(noted, (), EXPERIMENT), good, {"paper": good})
    assert [each.words for each in failures(limits, good, 6000.0)] == words


def test_a_peak_below_what_ropes_bear_is_eased() -> None:
    good = reached(GOOD)
    limits = limits_of(constraints_of(("worst.peak_tension<=5000",), (), EXPERIMENT), good, {"paper": good})
    assert failures(limits, good, 6000.0) == ()
    assert failures(limits, good, 5400.0)
    lost = reached(GOOD, outcomes=("left_track", "completed"))
    assert [each.words for each in failures(limits, lost, 6000.0)] == ["left track in 1 scenario"]
