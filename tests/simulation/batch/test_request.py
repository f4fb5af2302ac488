"""What a batch refuses, in one line that names key, row and range."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch import scenarios as module
from dualwinch.simulation.batch.scenarios import check_batch
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.structure import parameters_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override

COORDINATION = "controller.coordination."


@pytest.mark.parametrize(
    ("names", "row", "message"),
    [
        (["controller.nftsm.beta"], [-1.0], "controller.nftsm.beta = -1: must be > 0"),
        (["controller.nftsm.beta"], [np.nan], "controller.nftsm.beta = nan: must be > 0"),
        (["controller.nftsm.beta"], [np.inf], "controller.nftsm.beta = inf: must be > 0"),
        (["controller.nftsm.p"], [5.5], "controller.nftsm.p = 5.5: must be a whole number >= 3"),
        (["controller.nftsm.p"], [6.0], "controller.nftsm.p = 6: must be odd"),
        (["controller.nftsm.p"], [3.0], "controller.nftsm.p = 3: must be > controller.nftsm.q = 3"),
        (["controller.nftsm.p", "controller.nftsm.q"], [7.0, 9.0], "controller.nftsm.p = 7: must be > .* = 9"),
        ([COORDINATION + "preload"], [300.0], "preload = 300: must be > 400 and < 12000 N"),
        ([COORDINATION + "tension_min"], [7000.0], "tension_min = 7000: must be < .*tension_max = 6000 N"),
        ([COORDINATION + "reserve"], [5900.0], r"reserve = 5900: must be < 5800 N \(tension_max - tension_min\)"),
        ([COORDINATION + "reserve"], [5100.0], "preload = 2000: must be > 400 and < 1800 N"),
        (
            [COORDINATION + name for name in ("tension_min", "preload")],
            [600.0, 1100.0],
            "preload = 1100: must be > 1200",
        ),
        (["plant.vehicle.mass"], [0.0], "plant.vehicle.mass = 0: must be > 0"),
        (["plant.rope_1.modulus"], [1e15], r"simulation.substeps = 5: must be >= \d+ for adaptive"),
        (["nominal.vehicle.mass"], [-1.0], "nominal.vehicle.mass = -1: must be > 0"),
        (["disturbance.vortex"], [0.5], "disturbance.vortex = 0.5: must be 0 or 1"),
    ],
)
def test_a_row_out_of_range_is_refused(names: list[str], row: list[float], message: str) -> None:
    values = np.array([[parameters_of(case(4))[name] for name in names]] * 5)
    check_batch(names, values, [case(4)])
    values[3] = row
    with pytest.raises(ConfigurationError, match=rf"^parameters\[3\]: .*{message}"):
        check_batch(names, values, [case(4)])


def test_rows_must_fit_every_scenario() -> None:
    strong = override(case(4), {COORDINATION + "tension_min": 900.0})
    values = np.array([[1900.0], [1700.0]])
    check_batch([COORDINATION + "preload"], values, [case(4)])
    with pytest.raises(
        ConfigurationError, match=r"parameters\[1\] in scenarios\[1\]: .*preload = 1700: must be > 1800"
    ):
        check_batch([COORDINATION + "preload"], values, [case(4), strong])


@pytest.mark.parametrize("name", ["sensors.speed_noise", "sensors.position_drift", "simulation.jitter"])
def test_what_was_not_drawn_cannot_be_varied(name: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"{name} = 0: must be > 0 where it varies"):
        check_batch([name], np.array([[1e-4]]), [case(4)])
    check_batch([name], np.array([[1e-4]]), [override(case(4), {name: 2e-4})])


def test_thousands_of_sound_rows_are_looked_at_by_the_column(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Experiment] = []
    monkeypatch.setattr(module, "prepare", calls.append)
    names = ["controller.nftsm.beta", COORDINATION + "preload", "controller.nftsm.p"]
    values = np.column_stack([np.linspace(0.1, 1, 5000), np.linspace(1e3, 3e3, 5000), np.full(5000, 7.0)])
    scenarios = [replace(case(4), simulation=Simulation(seed=seed)) for seed in range(3)]
    check_batch(names, values, scenarios)
    assert len(calls) == len(scenarios)
