"""The table of ensembles; what it times is not tested."""

import pytest

from benchmarks import ensembles
from benchmarks.ensembles import COUNTS, HEADINGS, case_of, row
from benchmarks.peers.ensembles import SEED, ensemble_of, kernel


def test_a_row_compares_the_whole_with_its_compiled_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ensembles, "memory", lambda _name, _duration, count: count / 100)
    for whole, verdict in ((1.2e-3, "yes"), (1.4e-3, "no")):
        monkeypatch.setattr(ensembles, "times", lambda *_, whole=whole: (1e-3, whole))
        cells = row("sea", 1.0, 1)
        assert cells[:3] == ["sea", "1.00 ms", f"{whole * 1e3:.2f} ms"]
        assert cells[3:6] == [f"{whole * 1e3:.2f} ×", "1.3 ×", verdict]
        assert cells[6:] == ["10 MB", "100 MB"]
        assert len(cells) == len(HEADINGS) + len(COUNTS)


def test_the_kernel_runs_every_scenario_and_can_be_called_again() -> None:
    call = kernel(ensemble_of("sea", case_of(0.1)).chosen(range(20), SEED), 1)
    assert call() is True
    assert call() is True


def test_times_are_those_of_a_scenario() -> None:
    compiled, whole = ensembles.times("sea", 0.05, 1)
    assert compiled > 0
    assert whole > 0
