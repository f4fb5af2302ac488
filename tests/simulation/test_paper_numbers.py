"""The numbers an independent implementation reports for the paper's cases, and Figure 21's three reductions."""

import numpy as np
import pytest

from dualwinch.simulation.paper import CASES, CONTROLLERS, REDUCTIONS
from tests.conftest import OracleRun, PaperRun
from tests.tiers import mostly_slow


@pytest.mark.parametrize(
    ("metric", "percent"), [("steady_mae", -74.4), ("steady_max_abs_error", -77.4), ("steady_mse", -93.8)]
)
def test_reductions_by_the_observer_in_case_4(metric: str, percent: float, paper_run: PaperRun) -> None:
    with_observer, without = (getattr(paper_run(4, kind).metrics, metric) for kind in ("fando-nftsm", "nftsm"))
    assert 100 * (with_observer / without - 1) == pytest.approx(percent, abs=0.05)


def test_reductions_are_near_the_papers() -> None:
    assert REDUCTIONS == {"mae": -0.76, "max_abs_error": -0.67, "mse": -0.935}


@pytest.mark.parametrize(("kind", "mse"), [("fando-nftsm", 5.33e-6), ("nftsm", 7.73e-5), ("pid-cascade", 1.17e-2)])
def test_mean_square_error_of_case_4(kind: str, mse: float, paper_run: PaperRun) -> None:
    assert paper_run(4, kind).metrics.mse == pytest.approx(mse, rel=1e-3, abs=5e-3 * mse)


@pytest.mark.parametrize("number", [3, 4])
def test_order_of_the_steady_errors_with_vortices(number: int, paper_run: PaperRun) -> None:
    fando, nftsm, pid = (paper_run(number, kind).metrics.steady_mae for kind in CONTROLLERS)
    assert fando < nftsm < pid


@pytest.mark.parametrize("number", [1, 2])
def test_order_of_the_steady_errors_without_disturbance(number: int, paper_run: PaperRun) -> None:
    fando, nftsm, pid = (paper_run(number, kind).metrics.steady_mae for kind in CONTROLLERS)
    assert abs(fando - nftsm) < 1e-5 * pid
    assert fando < pid
    assert nftsm < pid


def test_without_disturbance_the_observer_changes_nothing_in_case_1(paper_run: PaperRun) -> None:
    fando, nftsm = (paper_run(1, kind).metrics.steady_mae for kind in ("fando-nftsm", "nftsm"))
    assert fando == pytest.approx(nftsm, rel=1e-4)


@pytest.mark.parametrize("number", [1, 3])
def test_the_speed_step_overshoots_the_tension_limit_and_slackens_rope_2(number: int, paper_run: PaperRun) -> None:
    result = paper_run(number, "fando-nftsm")
    assert result.metrics.peak_tension == pytest.approx(8000, rel=0.01)
    assert result["F1"].max() > 6000
    assert result["F2"].min() == 0
    assert result["F1"].min() > 0
    assert result.metrics.slack_share > 0


@pytest.mark.parametrize("number", [2, 4])
def test_the_profile_stays_within_the_tension_limits(number: int, paper_run: PaperRun) -> None:
    for kind in CONTROLLERS:
        metrics = paper_run(number, kind).metrics
        assert metrics.slack_share == 0
        assert metrics.peak_tension < 6000


@pytest.mark.parametrize("number", CASES)
def test_every_case_runs_to_its_end(number: int, paper_run: PaperRun) -> None:
    for kind in CONTROLLERS:
        result = paper_run(number, kind)
        assert result.outcome == "completed"
        assert result.end_time == pytest.approx(25 if number in {1, 3} else 50)


@pytest.mark.parametrize(
    ("kind", "samples"),
    mostly_slow([("pid-cascade", 1500), *((kind, None) for kind in CONTROLLERS)], lambda row: row[1] is not None),
)
def test_the_independent_implementation_has_the_same_mean_square_error(
    kind: str, samples: int | None, paper_run: PaperRun, oracle_run: OracleRun
) -> None:
    ours, theirs = paper_run(4, kind), np.mean(oracle_run(4, kind, samples)["e"] ** 2)
    assert np.mean(ours["e"][:samples] ** 2) == pytest.approx(theirs, rel=1e-5)
    if samples is None:
        assert ours.metrics.mse == pytest.approx(theirs, rel=1e-5)
