from typing import Any

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.simulation.sweep import sweep

SHORT = override(case(4), {"simulation.duration": 0.5})
L0, DELAY, MASS = "controller.observer.l0", "simulation.delay_samples", "plant.vehicle.mass"


def test_a_sweep_is_what_single_runs_are() -> None:
    """Structural keys, numbers, a key of the signals and one that changes the number of samples, all in one grid."""
    grid: dict[str, Any] = {
        "controller.kind": ["nftsm", "pid-cascade"],
        DELAY: range(2),
        MASS: np.array([9e3, 1.1e4]),
        "simulation.duration": [0.3, 0.5],
    }
    found = sweep(SHORT, grid)
    assert found.keys == tuple(grid)
    assert found.values == (("nftsm", "pid-cascade"), (0, 1), (9e3, 1.1e4), (0.3, 0.5))
    assert found.shape == found.outcomes.shape == found.end_times.shape == found.metrics["mse"].shape == (2, 2, 2, 2)
    assert found.quantities[MASS].unit == "kg"
    for index in np.ndindex(found.shape):
        values = {key: found.values[axis][index[axis]] for axis, key in enumerate(grid)}
        single = simulate(override(SHORT, values))
        assert found.outcomes[index] == single.outcome == "completed"
        assert found.end_times[index] == pytest.approx(single.end_time)
        for name in ("mse", "chatter", "energy"):
            assert found.metrics[name][index] == pytest.approx(getattr(single.metrics, name), rel=1e-5), (values, name)
    assert len(np.unique(found.metrics["mse"])) == 16


def test_seeds_and_switches_are_swept_too() -> None:
    noisy = override(SHORT, {"sensors.position_noise": 1e-3})
    found = sweep(noisy, {"disturbance.seed": [1, 2], "disturbance.vortex": [True, False]})
    assert found.keys == ("simulation.seed", "disturbance.vortex")
    assert len(np.unique(found.metrics["mse"])) == 4


def test_runs_that_end_early_are_cells_without_figures_of_merit() -> None:
    wild = override(case(4, "pid-cascade"), {"controller.pid_cascade.kp2": 1000})
    found = sweep(wild, {"controller.pid_cascade.kp1": [0.1, 1000]})
    assert found.outcomes.tolist() == ["left_track", "completed"]
    assert np.isnan(found.metrics["mse"]).tolist() == [True, False]
    assert found.end_times[0] < 50
    assert repr(found) == "Sweep(controller.pid_cascade.kp1: 2; 1 completed, 1 left_track)"


def test_a_sweep_has_parts() -> None:
    found = sweep(SHORT, {DELAY: [0, 3], L0: [5, 10, 20]})
    part = found.at(DELAY, 3)
    assert (part.keys, part.values) == ((L0,), ((5.0, 10.0, 20.0),))
    assert part.metrics["mse"].tolist() == found.metrics["mse"][1].tolist()
    assert part.experiment == override(SHORT, {DELAY: 3})
    assert found.at(L0, 10).outcomes.shape == (2,)
    with pytest.raises(
        UnknownNameError, match=r"^'controller\.observer\.l' was not swept; did you mean 'controller\.ob"
    ):
        found.at("controller.observer.l", 5)
    with pytest.raises(ConfigurationError, match=r"^controller\.observer\.l0 = 6: must be one of 5\.0, 10\.0, 20\.0$"):
        found.at(L0, 6)


def test_progress_ends_at_all() -> None:
    shares: list[float] = []
    sweep(SHORT, {DELAY: [0, 1]}, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert shares[1] < 0.5
    assert shares[-1] == 1


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ({}, "sweep: no key to vary; give key: values, e.g. {'controller.observer.l0': [2, 5, 10]}"),
        ({L0: []}, f"{L0}: must have at least one value"),
        ({L0: 5}, f"{L0} = 5: must be a list of values"),
        ({"controller.kind": "nftsm"}, 'controller.kind = "nftsm": must be a list of values'),
        ({L0: [5, 10, 5.0]}, f"{L0} = 5.0: is given twice"),
        ({"controller.observer.l": [5]}, f"unknown key 'controller.observer.l'; did you mean '{L0}'?"),
        ({MASS: [1e4, -1]}, f"{MASS} = -1: must be a finite number > 0 kg"),
        ({DELAY: [0, 1.5]}, f"{DELAY} = 1.5: must be a whole number >= 0 and <= 100"),
        (
            {"controller.kind": ["fando-nftsm", "nftsm"], L0: [5]},
            (
                f'controller.kind = "nftsm", {L0} = 5: {L0}: belongs to controller.kind = "fando-nftsm", '
                'here it is "nftsm"'
            ),
        ),
        (
            {"simulation.integrator": ["rk4"], "simulation.substeps": [5, 1]},
            (
                "simulation.substeps = 1: must be >= 2 for rk4 "
                "at simulation.sample_time = 0.001 s (the shortest rope oscillates at"
            ),
        ),
    ],
)
def test_grids_that_cannot_be_run_are_told(grid: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        sweep(SHORT, grid)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)
