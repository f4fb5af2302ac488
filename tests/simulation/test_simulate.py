import numpy as np
import pytest

from dualwinch.simulation import simulate as module
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

SHORT = override(case(4), {"simulation.duration": 2.0, "sensors.speed_noise": 1e-3, "disturbance.current_sigma": 0.05})


@pytest.mark.parametrize("stride", [0, 1, 7])
def test_a_run_in_pieces_is_the_run(stride: int, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = simulate(SHORT, stride=stride)
    monkeypatch.setattr(module, "PIECE", 300)
    shares: list[float] = []
    pieces = simulate(SHORT, stride=stride, progress=shares.append)
    assert pieces.final_state == whole.final_state
    assert pieces.metrics == whole.metrics
    for name, values in whole.columns.items():
        assert np.array_equal(pieces[name], values, equal_nan=True)
    assert shares == sorted(shares)
    assert len(shares) > 5
    assert shares[-1] == 1


def test_a_run_that_ends_early_ends_between_pieces_too(monkeypatch: pytest.MonkeyPatch) -> None:
    loose = override(case(1), {"controller.observer.l0": 1e300, "simulation.duration": 2.0})
    whole = simulate(loose)
    monkeypatch.setattr(module, "PIECE", 3)
    pieces = simulate(loose)
    assert pieces.outcome == whole.outcome
    assert pieces.end_time == whole.end_time
    assert np.array_equal(pieces["t"], whole["t"])
