"""The paper's claims: each verdict follows from the runs, and turns where they turn."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.simulation.paper import CONTROLLERS
from dualwinch.simulation.results.result import Result
from dualwinch.toolboxes.paper.claims import claims, converged_at, reductions

Runs = dict[tuple[int, str], Result]


@pytest.fixture(scope="module")
def runs(paper_run: Callable[[int, str], Result]) -> Runs:
    return {(number, kind): paper_run(number, kind) for number in (1, 2, 3, 4) for kind in CONTROLLERS}


def with_metrics(run: Result, **changed: float) -> Result:
    return replace(run, metrics=replace(run.metrics, **changed))


def test_the_papers_runs_hold_four_claims_and_refute_its_faster_convergence(runs: Runs) -> None:
    found = claims(runs)
    assert [claim.verdict for claim in found] == [
        "does not hold",
        "holds",
        "holds",
        "partly",
        "holds",
        "holds",
        "partly",
    ]
    assert found[0].here == (
        "Within ±0.2 m for good after 16.9 s, the PID cascade after 11.7 s; "
        "within ±0.1 m for good after 18.8 s, the PID cascade never."
    )
    assert "−21 %" in found[3].here
    assert "−74.4 %, −77.4 %, −93.8 %." in found[4].here
    assert "7.98 kN (commands: 6 kN), a rope slack for 7 ms" in found[6].here


def test_verdicts_turn_with_the_runs(runs: Runs) -> None:
    turned = dict(runs)
    turned[1, "fando-nftsm"], turned[1, "pid-cascade"] = runs[1, "pid-cascade"], runs[1, "fando-nftsm"]
    turned[3, "fando-nftsm"] = with_metrics(runs[3, "fando-nftsm"], steady_mae=1e-3)
    turned[4, "fando-nftsm"] = with_metrics(runs[4, "fando-nftsm"], steady_mae=1.0, steady_mse=1.0)
    verdicts = ["holds", "holds", "partly", "holds", "partly", "holds", "partly"]
    assert [claim.verdict for claim in claims(turned)] == verdicts


def test_figure_21_compares_two_controllers_in_case_4(runs: Runs) -> None:
    change = reductions({key: run.metrics for key, run in runs.items()})
    assert change == pytest.approx({"mae": -0.744, "max_abs_error": -0.774, "mse": -0.938}, abs=5e-4)
    assert reductions({key: run.metrics for key, run in runs.items() if key[0] != 4}) is None


def test_runs_that_are_missing_or_did_not_end_tell_nothing(runs: Runs) -> None:
    assert claims({}) == []
    assert claims({(4, "nftsm"): runs[4, "nftsm"]}) == []
    broken = runs | {(1, "pid-cascade"): replace(runs[1, "pid-cascade"], outcome="diverged")}
    assert "Case 1: the proposed controller converges" not in " ".join(claim.words for claim in claims(broken))


def test_a_run_has_converged_where_it_stays(runs: Runs) -> None:
    run = runs[2, "fando-nftsm"]
    assert converged_at(run) == 0.0
    assert converged_at(run, 0.0) == np.inf
    late = round(1000 * converged_at(runs[1, "pid-cascade"]))
    outside = np.abs(runs[1, "pid-cascade"]["e"]) > 0.2
    assert outside[late - 1]
    assert not outside[late:].any()
