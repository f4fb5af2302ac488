"""Values in a wrong unit are found on machines of any size, and right ones are not suspected."""

from pathlib import Path

import pytest

import dualwinch as dw
from dualwinch.analysis.plausibility import unlikely_units
from dualwinch.cli import main
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.experiment_file import CHECKED, checked_keys, own_keys
from dualwinch.model.quantities.tree import leaves
from tests.last_bit import SEEDS, perturbed

LENGTHS = ("track.length", "track.rope_offset", "vehicle.diameter", "vehicle.height")
LENGTHS_OF_A_SIDE = ("rope_{i}.diameter", "winch_{i}.drum_radius")


def similar(length: float) -> dw.Experiment:
    """The paper's machine with all lengths changed by a factor, masses by its cube, stresses as they are."""
    powers = dict.fromkeys((f"plant.{name}" for name in LENGTHS), 1) | {"plant.vehicle.drag_area": 2}
    powers |= {"plant.vehicle.mass": 3, "plant.vehicle.normal_force": 3}
    powers |= {f"controller.coordination.{name}": 2 for name in ("preload", "tension_min", "tension_max")}
    for i in (1, 2):
        powers |= dict.fromkeys((f"plant.{name.format(i=i)}" for name in LENGTHS_OF_A_SIDE), 1)
        powers |= {f"plant.rope_{i}.area": 2, f"plant.rope_{i}.damping": 2, f"plant.winch_{i}.inertia": 5}
    values = leaves(dw.Experiment())
    motion = {"reference.kind": "way-points", "reference.points": [0.5 * 50 * length]}
    return dw.override(dw.Experiment(), {key: values[key] * length**power for key, power in powers.items()} | motion)


WRONG = {
    "plant.track.length": 1000,
    "plant.vehicle.mass": 0.001,
    "plant.vehicle.diameter": 1000,
    "plant.vehicle.drag_area": 1e6,
    "plant.vehicle.normal_force": 0.001,
    "plant.rope_1.modulus": 1e-9,
    "plant.rope_2.area": 1e6,
    "plant.rope_1.damping": 1000,
    "plant.winch_2.drum_radius": 1000,
    "plant.winch_1.inertia": 1e4,
}


@pytest.mark.parametrize("length", [0.1, 1.0, 5.0])
def test_a_wrong_unit_is_found_on_a_machine_of_any_size(length: float) -> None:
    machine = similar(length)
    assert not unlikely_units(machine)
    for key, factor in WRONG.items():
        value = leaves(machine)[key] * factor
        (remark,) = unlikely_units(dw.override(machine, {key: value}))
        assert remark.startswith(f"{key} = {value:g} ")
        assert 31 < float(remark.partition(" is ")[2].partition(" times")[0]) ** (1 if factor > 1 else -1) <= 1.01e9


def test_several_wrong_units_are_told_apart_on_any_computer() -> None:
    wrong = {"plant.rope_1.modulus": 80.0, "plant.winch_2.drum_radius": 300.0, "plant.vehicle.mass": 10.0}
    for seed in SEEDS:
        remarks = unlikely_units(perturbed(dw.override(dw.Experiment(), wrong), seed))
        assert {remark.partition(" ")[0] for remark in remarks} == wrong.keys()


def test_heavy_winches_and_ropes_are_plausible() -> None:
    assert not unlikely_units(load_ensemble("site").experiment)
    heavy = load_ensemble("site").experiment
    for key in ("plant.rope_1.mass_per_length", "plant.winch_2.gear_stiffness"):
        (remark,) = unlikely_units(dw.override(heavy, {key: leaves(heavy)[key] * 1000}))
        assert remark.startswith(key)


def test_only_given_values_are_suspected_and_checked_ones_are_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f"[plant.track]\nlength = 6000  # m\n[plant.vehicle]\nmass = 10e6  # {CHECKED}, a ship\n")
    experiment = dw.load(file)
    assert checked_keys(file) == {"plant.vehicle.mass"}
    (remark,) = unlikely_units(experiment, own_keys(file), checked_keys(file))
    assert remark.startswith("plant.track.length = 6000 m is ")
    main(["config", "--config", str(file)])
    whole = capsys.readouterr().out
    assert f"# {CHECKED}: [kg] mass of the vehicle" in whole
    file.write_text(whole)
    assert checked_keys(file) == {"plant.vehicle.mass"}
