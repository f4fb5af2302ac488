"""The peers of the benchmark compute what dualwinch computes."""

from dataclasses import astuple, replace
from functools import cached_property

import numpy as np
import pytest

from benchmarks import limits
from benchmarks.case import Case
from benchmarks.measure import DisagreementError, Timing, check_candidates, difference, measure
from benchmarks.peers import ADAPTIVE_LIMIT, DEFAULT, LIMIT, OURS, SENSITIVE, hand_c, peers
from benchmarks.peers.compiled import prepare_call
from benchmarks.peers.peer import Answer, Peer, Run, UnavailableError
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.paper import case
from tests.tiers import all_but

SHORT = 0.5
"""Duration in s."""

SAME = [LIMIT, "numba", "dualwinch-simulate", "mapaccum", "mapaccum-c", "interpreter"]
"""Peers of the same algorithm."""


@pytest.fixture(scope="module")
def rows() -> dict[str, Peer]:
    return {peer.key: peer for peer in peers(SHORT)}


@pytest.fixture(scope="module")
def expected(rows: dict[str, Peer]) -> Answer:
    return _answer(rows[OURS])


def _answer(peer: Peer) -> Answer:
    try:
        return peer.prepare(peer.case)(keep=True)
    except UnavailableError as missing:
        pytest.skip(str(missing))


@pytest.mark.parametrize("key", SAME)
def test_same_algorithm_gives_same_rollout(rows: dict[str, Peer], expected: Answer, key: str) -> None:
    answer = _answer(rows[key])
    assert difference(answer, expected) < 1e-9
    assert answer.positions is not None
    assert answer.x == answer.positions[-1]
    np.testing.assert_allclose(astuple(answer.metrics), astuple(expected.metrics), rtol=1e-6)


def test_the_adaptive_limit_is_the_same_method(rows: dict[str, Peer]) -> None:
    ours, limit = _answer(rows[DEFAULT]), _answer(rows[ADAPTIVE_LIMIT])
    assert difference(limit, ours) < 1e-12
    np.testing.assert_allclose(astuple(limit.metrics), astuple(ours.metrics), rtol=1e-8)


class WithSlack(Case):
    """Case 3: the speed step slackens rope 2 for some milliseconds."""

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment."""
        simulation = Simulation(duration=self.duration, integrator="adaptive", substeps=self.substeps)
        return replace(case(3, "fando-nftsm"), simulation=simulation)


@pytest.mark.parametrize("substeps", [5, 8])
def test_the_adaptive_limit_follows_slack_ropes(substeps: int) -> None:
    slack = WithSlack(0.5, "adaptive", substeps)
    ours = prepare_call(slack)(keep=True)
    try:
        limit = hand_c.prepare_with("hand_adaptive")(slack)(keep=True)
    except UnavailableError as missing:
        pytest.skip(str(missing))
    assert ours.metrics.slack_share > 0.01
    assert difference(limit, ours) < 1e-11
    np.testing.assert_allclose(astuple(limit.metrics), astuple(ours.metrics), rtol=1e-6)


@pytest.mark.parametrize(
    "key", all_but(["numba-batch-1", "casadi-map-1"], ["numba-batch-1", "casadi-map-1", "jax", "diffrax"])
)
def test_batches_give_every_candidates_rollout(rows: dict[str, Peer], expected: Answer, key: str) -> None:
    """diffrax takes a method of its own, exact to its order."""
    answer, ours = _answer(rows[key]), rows["batch-1"].prepare(rows[OURS].case)(keep=True)
    assert answer.errors is not None
    assert ours.errors is not None
    check_candidates(answer, ours)
    assert difference(answer, expected) < (1e-6 if key == "diffrax" else 1e-12)
    assert answer.metrics.mse == answer.errors[0]
    if key != "diffrax":
        np.testing.assert_allclose(answer.errors, ours.errors, rtol=1e-8)
    with pytest.raises(DisagreementError, match="candidates"):
        check_candidates(replace(answer, errors=answer.errors + 1e-4), ours)


def test_archimedes_gives_the_same_rollout(rows: dict[str, Peer], expected: Answer) -> None:
    answer = _answer(rows["archimedes"])
    assert difference(answer, expected) < 1e-12
    assert answer.metrics.mse == pytest.approx(expected.metrics.mse, rel=1e-8)


def test_scipy_agrees_within_its_tolerance() -> None:
    short = {peer.key: peer for peer in peers(0.05)}
    assert difference(_answer(short["scipy-rk45"]), _answer(short[OURS])) < 1e-6


@pytest.mark.parametrize("key", [LIMIT, "numba"])
def test_what_is_not_kept_changes_nothing(rows: dict[str, Peer], key: str) -> None:
    kept = _answer(rows[key])
    lean = rows[key].prepare(rows[key].case)()
    assert lean.positions is None
    assert lean.x == kept.x
    assert lean.metrics == kept.metrics


@pytest.mark.parametrize("substeps", [3, 8])
def test_substeps_are_taken_at_run_time(rows: dict[str, Peer], substeps: int) -> None:
    short = Case(0.1, substeps=substeps)
    ours, limit = rows[OURS].prepare(short)(keep=True), _answer(replace(rows[LIMIT], case=short))
    assert difference(limit, ours) < 1e-9


def test_wrong_answer_gives_no_table(rows: dict[str, Peer]) -> None:
    def prepare_wrong(case: Case) -> Run:
        right = rows[OURS].prepare(case)

        def run(*, keep: bool = False) -> Answer:
            answer = right(keep=keep)
            assert answer.positions is not None
            return replace(answer, positions=answer.positions + 2e-6)

        return run

    wrong = replace(rows[LIMIT], title="a wrong peer", prepare=prepare_wrong)
    with pytest.raises(DisagreementError, match="a wrong peer: positions differ"):
        measure([rows[OURS], wrong], rounds=1, slow_rounds=1)


def test_missing_peer_is_a_row_that_says_so(rows: dict[str, Peer]) -> None:
    def prepare_missing(case: Case) -> Run:
        raise UnavailableError(f"nothing for {case.duration} s")

    timings = measure([rows[OURS], replace(rows["numba"], prepare=prepare_missing)], rounds=2, slow_rounds=1)
    assert timings[0].seconds
    assert timings[1].seconds == []
    assert timings[1].missing == "nothing for 0.5 s"


@pytest.mark.parametrize("key", all_but(["sea-1", "sea-kernel"], ["sea-1", "rig-1", "sea-kernel", "rig-ensemble"]))
def test_ensembles_are_checked_against_a_scalar_rollout_of_a_scenario(key: str, rows: dict[str, Peer]) -> None:
    peer = rows[key]
    assert peer.expected is not None
    assert difference(_answer(peer), peer.expected(peer.case)) < 1e-9


def test_slopes_change_nothing_about_the_rollout(rows: dict[str, Peer]) -> None:
    ours, beside = _answer(rows[DEFAULT]), _answer(rows[SENSITIVE])
    assert difference(beside, ours) < 1e-6
    np.testing.assert_allclose(astuple(beside.metrics), astuple(ours.metrics), rtol=1e-8)


def test_rates_stand_beside_what_they_are_to_reach(rows: dict[str, Peer], monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = {ADAPTIVE_LIMIT: 8.0, DEFAULT: 9.0, "batch-1": 1.0, "batch-2": 0.5, "sea-1": 2.0}
    seconds |= {"rig-1": 1.9, "rig-kernel": 2.0, "rig-ensemble": 2.5}
    timings = [
        Timing(replace(rows[DEFAULT], key=key, title=key), [value], deviation=1e-9) for key, value in seconds.items()
    ]
    monkeypatch.setattr(limits, "vector_features", lambda: ("avx512f", "avx2"))
    assert [row[2:5] for row in limits.rows(timings, 2)] == [
        ["0.89 ×", "1 ×", "no"],
        ["8.00 ×", "8 ×", "yes"],
        ["2.00 ×", "1.8 ×", "yes"],
        ["0.50 ×", "0.75 ×", "no"],
        ["0.53 ×", "0.5 ×", "yes"],
        ["0.80 ×", "0.77 ×", "yes"],
    ]
    monkeypatch.setattr(limits, "vector_features", lambda: ("avx2",))
    assert limits.rows(timings, 1)[1][3:5] == ["4 ×", "yes"]
