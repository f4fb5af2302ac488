"""The force that nobody recorded: beside the one that acted, and back in experiments."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dualwinch.model.signals import Signal
from dualwinch.model.vehicle import inertia
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.identification.cli.identify import write_forces
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import log_of
from dualwinch.toolboxes.identification.result import IdentificationResult
from tests.toolboxes.identification.conftest import logged, machine

T = np.linspace(0, 20, 401)
GUST = 300 * np.sin(0.7 * T) + 150 * np.sin(2.1 * T + 1)
CALM = machine(disturbance__current_sigma=0.0, disturbance__normal_force_sigma=0.0)


@pytest.fixture(scope="module")
def found() -> IdentificationResult:
    force = Signal.from_arrays(T, GUST, unit="N")
    gusty = replace(CALM, disturbance=replace(CALM.disturbance, force=force))
    return identify([log_of(simulate(gusty))], ["plant.rope_*.modulus"], CALM, forces=True)


def test_the_force_is_the_one_that_acted_as_well_as_is_said(found: IdentificationResult) -> None:
    (force,) = found.forces
    assert force.log == "run"
    np.testing.assert_allclose(np.diff(force.t), 0.01, atol=1e-9)
    off = force.force - np.interp(force.t, T, GUST)
    assert np.sqrt(np.mean(off**2)) < 0.1 * GUST.std()
    size = np.sqrt(np.mean((off / force.deviation) ** 2))
    assert 0.2 < size < 1.5, "gusts as smooth as these are told better than a random force"
    assert found.process_noise["force"].deviation > 30, "found out by likelihood"


def test_a_file_of_it_is_a_disturbance(found: IdentificationResult, tmp_path: Path) -> None:
    for suffix in ("csv", "parquet"):
        (file,) = write_forces(tmp_path / f"force.{suffix}", found)
        again = override(CALM, {"disturbance.force.file": str(file)})
        assert again.disturbance.force.given
        direct = replace(CALM, disturbance=replace(CALM.disturbance, force=found.forces[0].signal))
        run, other = simulate(again), simulate(direct)
        np.testing.assert_allclose(run["x"], other["x"], atol=1e-9)
        assert np.abs(run["e"] - simulate(CALM)["e"]).max() > 1e-6


@pytest.mark.slow
def test_current_and_rail_load_count_as_force() -> None:
    """What the sea did by changing drag and friction, as one force: what the nominal model leaves unexplained."""
    right = machine(disturbance__vortex=False)
    run = simulate(right)
    (force,) = identify([log_of(run)], ["plant.rope_*.modulus"], right, forces=True).forces
    acted = np.interp(force.t, run["t"], run["d_true"]) * inertia(right.plant.vehicle)
    under_way = force.t > 5
    off = (force.force - acted)[under_way]
    assert np.sqrt(np.mean(off**2)) < 0.5 * np.std(acted[under_way])
    assert 0.5 < np.sqrt(np.mean((off / force.deviation[under_way]) ** 2)) < 1.5


@pytest.mark.slow
@pytest.mark.nightly
def test_of_several_logs_there_are_several_files(tmp_path: Path) -> None:
    logs = [logged(machine(simulation__seed=seed)) for seed in (1, 2)]
    both = identify(logs, ["plant.vehicle.mass"], machine(), forces=True)
    files = write_forces(tmp_path / "force.csv", both)
    assert [file.name for file in files] == ["force-1.csv", "force-2.csv"]
    assert all(file.exists() for file in files)
