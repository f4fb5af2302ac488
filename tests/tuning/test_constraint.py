"""Statistics, objectives and constraints by name."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.result import Statistic, statistic_from
from dualwinch.simulation.paper import case
from dualwinch.tuning.constraints import (
    NO_PEAK,
    NO_SLACK,
    Constraint,
    constraints_from,
    constraints_with,
    measured,
    objectives_from,
)
from tests.own_metrics import PullSpread


def bound(text: str) -> Constraint:
    """A constraint where the paper's controller reaches 8."""
    return constraints_from([text], case(4))[0].given(8.0)


def test_statistics_look_at_the_bad_end() -> None:
    values = np.array([1.0, 2.0, 3.0, 10.0])
    assert Statistic("mean", "mse").over(values) == 4
    assert Statistic("geomean", "mse").over(values) == pytest.approx(60 ** (1 / 4))
    assert Statistic("geomean", "mse").over(values - 1) == 0
    assert np.isnan(Statistic("geomean", "mse").over(values - 2))
    assert Statistic("median", "mse").over(values) == 2.5
    assert Statistic("worst", "peak_tension").over(values) == 10
    assert Statistic("worst", "min_tension").over(values) == 1
    assert Statistic("p95", "min_tension").over(values) == pytest.approx(np.quantile(values, 0.05))
    assert statistic_from("mse") == Statistic("mean", "mse")


def test_what_no_run_has_is_nan_and_violates_all_of_a_bound() -> None:
    nothing = np.array([np.nan])
    assert np.isnan(measured(Statistic("mean", "mse"), nothing))
    assert np.isnan(measured(Statistic("worst", "min_tension"), nothing))
    assert np.isnan(measured(Statistic("worst", "mse"), np.array([np.inf])))
    assert bound("worst.peak_tension<=6000").violation(np.nan) == 1
    assert bound("worst.min_tension>=100").violation(np.nan) == 1
    assert bound("worst.min_tension>=100").violation(np.inf) == -1


def test_what_the_papers_gains_do_not_reach_bounds_nothing() -> None:
    for text in ("mean.chatter<=1*paper", "worst.min_tension>=0.5*paper"):
        constraint = constraints_from([text], case(4))[0].given(np.nan)
        assert constraint.violation(1e9) == constraint.violation(0.0) == -1
        assert constraint.violation(np.nan) == 1
        assert constraint.label.endswith(": no bound, as the gains that it refers to complete no run")


def test_shares_are_given_in_per_cent() -> None:
    assert bound("mean.saturated_share<=1%").bound == 0.01
    assert bound("mean.saturated_share <= 0.5 %").bound == 0.005
    assert bound("mean.chatter<=25%*paper").bound == 2
    with pytest.raises(ConfigurationError, match=r'unit "%": must be one of N'):
        bound("worst.peak_tension<=5%")
    with pytest.raises(ConfigurationError, match=r'unit "kN": must be one of %'):
        bound("mean.saturated_share<=5kN")


@pytest.mark.parametrize(
    ("text", "limit", "at_least"),
    [
        ("worst.peak_tension<=6000", 6000, False),
        ("worst.peak_tension <= 0.95*controller.coordination.tension_max", 5700, False),
        ("mean.chatter<=0.25*paper", 2, False),
        ("worst.min_tension>=1e2", 100, True),
        ("worst.slack_share<=0", 0, False),
    ],
)
def test_bounds(text: str, limit: float, at_least: bool) -> None:
    found = bound(text)
    assert (found.bound, found.at_least) == (limit, at_least)


def test_a_bound_of_the_papers_is_a_factor_until_it_is_given() -> None:
    factor = constraints_from(["mean.chatter<=0.25*paper"], case(4))[0]
    assert (factor.reference, factor.bound) == ("paper", 0.25)
    assert factor.label == "mean.chatter <= 0.25 times the paper's"
    assert factor.given(8.0).label == "mean.chatter <= 2 N"
    assert constraints_from(["mean.chatter<=paper"], case(4))[0].label == "mean.chatter <= the paper's"
    number = bound("mean.chatter<=3")
    assert number.given(8.0) == number


def test_violations_are_shares_of_the_bound_and_positive_beyond_it() -> None:
    assert bound("worst.peak_tension<=6000").violation(6600) == pytest.approx(0.1)
    assert bound("worst.peak_tension<=6000").violation(6000) == 0
    assert bound("worst.min_tension>=100").violation(50) == pytest.approx(0.5)
    assert bound("worst.min_tension>=100").violation(100, 0.005) == 0.005
    assert bound("worst.disk_margin>=0").violation(0.0, 0.005) == 0, "a share of nothing: every margin satisfies it"
    assert bound("worst.slack_share<=0").violation(0.02) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("worst.peak_tension<6000", "must be STATISTIC<=BOUND"),
        ("worst.peak_tensoin<=6000", "unknown metric 'peak_tensoin'; did you mean 'peak_tension'?"),
        ("least.mse<=1", "unknown statistic 'least'; must be one of mean, geomean, median, p95, worst"),
        ("mean.mse<=controller.coordination.tension_mx", "did you mean 'controller.coordination.tension_max'?"),
        ("mean.mse<=controller.kind", "names no number"),
        ("mean.mse<=nan", "'nan' must be a finite number"),
        ("mean.mse<=x*paper", "'x' must be a finite number"),
        ("peak_tension<=5500", "of which statistic? worst.peak_tension<=5500 or mean.peak_tension<=5500"),
        ("min_tension<=80", "of which statistic? worst.min_tension>=80 or mean.min_tension>=80"),
        ("worst.peak_tension >= 5.5kN", "large values are the bad ones: worst.peak_tension <= 5.5kN"),
        ("mean.chatter>=0.5*paper", "large values are the bad ones: mean.chatter<=0.5*paper"),
        ("worst.min_tension<=100", "small values are the bad ones: worst.min_tension>=100"),
        ("worst.delay_margin<=5ms", "small values are the bad ones: worst.delay_margin>=5ms"),
        ("mean.chatter<=-1", "nothing satisfies it, no run has less than 0 N"),
        ("mean.chatter<=-1*paper", "nothing satisfies it, no run has less than 0 N"),
        ("mean.slack_share<=-1%", "nothing satisfies it, no run has less than 0"),
        ("mean.saturated_share<=150%", "all runs satisfy it, none has more than 1"),
        ("worst.phase_margin>=400deg", "must be at most 180 deg, half a turn"),
        ("worst.dealy_margin>=5ms", "did you mean 'delay_margin'? Must be one of gain_margin, phase_margin, delay"),
        ("mean.delay_margin>=5ms", "a margin must be bounded as worst.delay_margin"),
        ("delay_margin>=5ms", "a margin must be bounded as worst.delay_margin"),
        ("worst.delay_margin>=5mm", 'unit "mm": must be one of s, ms, us, ns, min, h'),
        ("worst.gain_margin>=6deg", 'unit "deg": must be one of dB'),
        ("worst.phase_margin>=1s", 'unit "s": must be one of deg, rad'),
        ("worst.disk_margin>=1dB", 'unit "dB": must be a plain number'),
    ],
)
def test_wrong_constraints_are_one_line(text: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        bound(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_metrics_of_ones_own_may_be_bounded_at_both_ends() -> None:
    own = replace(case(4), metrics=(PullSpread(),))
    texts = ["mean.pull_spread<=900", "mean.pull_spread>=-1"]
    assert [each.text for each in constraints_from(texts, own)] == texts


MARGIN, CHATTER = "worst.delay_margin>=5ms", "mean.chatter<=3"


@pytest.mark.parametrize(
    ("texts", "meant"),
    [
        (None, [NO_SLACK, NO_PEAK]),
        (["none"], []),
        ([], []),
        ([CHATTER], [NO_SLACK, NO_PEAK, CHATTER]),
        (["worst.peak_tension<=5000"], [NO_SLACK, "worst.peak_tension<=5000"]),
        (["none", CHATTER], [CHATTER]),
        ([MARGIN], [NO_SLACK, NO_PEAK, MARGIN]),
        (["none", MARGIN], [MARGIN]),
        ([MARGIN, CHATTER], [NO_SLACK, NO_PEAK, MARGIN, CHATTER]),
    ],
)
def test_bounds_of_ones_own_add_to_the_default_ones(texts: list[str] | None, meant: list[str]) -> None:
    found = constraints_with(texts, [NO_SLACK, NO_PEAK], case(4))
    assert [constraint.text for constraint in found] == meant


def test_wrong_objectives_and_repetitions_are_refused() -> None:
    assert [statistic.name for statistic in objectives_from(["mse", "p95.chatter"])] == ["mean.mse", "p95.chatter"]
    with pytest.raises(ConfigurationError, match="small is bad; make it a constraint"):
        objectives_from(["worst.min_tension"])
    with pytest.raises(ConfigurationError, match="named twice"):
        objectives_from(["mse", "mean.mse"])
    with pytest.raises(ConfigurationError, match="bounded twice"):
        constraints_from(["mean.mse<=1", "mean.mse<=2"], case(4))
