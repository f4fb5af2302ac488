"""The peers of the benchmark compute what dualwinch computes."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from benchmarks.case import Case
from benchmarks.measure import DisagreementError, difference, measure
from benchmarks.peers import LIMIT, OURS, peers
from benchmarks.peers.peer import Answer, Peer, Run, UnavailableError

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
    case = Case(0.1, substeps=substeps)
    ours, limit = rows[OURS].prepare(case)(keep=True), _answer(replace(rows[LIMIT], case=case))
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
