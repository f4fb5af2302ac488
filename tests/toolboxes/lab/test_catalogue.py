"""The catalogue says what the annotations say, and no more."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.paper import CASES
from dualwinch.toolboxes.lab.catalogue import catalogue
from dualwinch.toolboxes.lab.wasm.settings import OFF_AT_ZERO
from dualwinch.toolboxes.lab.wasm.structures import structures
from tests.toolboxes.lab.in_node import of_id

SOME = ("fando-nftsm", "pid-cascade", "fando-nftsm+site")


@cache
def made() -> dict[str, Any]:
    return catalogue([of_id(name) for name in SOME], load_ensemble("rig"), "0.1.0")


def test_every_law_is_offered_and_every_structure_has_a_name_of_its_own() -> None:
    offered = structures()
    assert {structure.chosen["controller.kind"] for structure in offered} == set(POSITION_LAWS)
    assert (
        len({structure.id for structure in offered}) == len({structure.label for structure in offered}) == len(offered)
    )
    assert offered[0].experiment == dw.case(2)


def test_keys_are_described_as_in_the_configuration() -> None:
    known = describe_parts(of_id("fando-nftsm").module.wide)
    for key in made()["structures"][0]["parameters"]:
        entry, leaf = made()["keys"][key], known[key]
        assert (entry["unit"], entry["meaning"]) == (leaf.quantity.unit, leaf.quantity.meaning)
        if key in {*OFF_AT_ZERO, "reference.kind"}:
            continue
        ends = (
            -math.inf if entry["low"] is None else entry["low"],
            math.inf if entry["high"] is None else entry["high"],
        )
        assert ends == leaf.bounds, key


def test_sliders_hold_the_default_within_the_bounds() -> None:
    for key, entry in made()["keys"].items():
        if entry["kind"] == "part":
            assert entry["default"] in entry["choices"]
            assert len(entry["labels"]) == len(entry["choices"])
            continue
        low, high = entry["slider"]
        around = entry["instead"] if entry["default"] is None else entry["default"]
        assert low < high, key
        assert low > 0 or entry["scale"] == "linear", key
        assert around is None or low <= around <= high, key
        assert entry["low"] is None or low >= entry["low"], key
        assert entry["high"] is None or high <= entry["high"], key


def test_every_key_that_a_structure_takes_is_described_and_has_its_default() -> None:
    for structure in made()["structures"]:
        values = leaves(of_id(structure["id"]).experiment)
        assert set(structure["nominal"]) | set(structure["optional"]) <= set(structure["parameters"])
        for key in structure["parameters"]:
            default = structure["defaults"].get(key, made()["keys"][key]["default"])
            if key != "reference.kind":
                assert default == values.get(key, 60.0 if key == "actuator.motor.thermal_time" else 0.0), key


def test_columns_are_those_of_a_result() -> None:
    columns = {column["name"]: column["unit"] for column in made()["structures"][0]["columns"]}
    assert dw.simulate(dw.case(2)).units.items() <= columns.items()


def test_cases_and_figures_are_those_of_simulate() -> None:
    assert [case["id"] for case in made()["cases"]] == [*(f"case-{number}" for number in CASES), "case-site"]
    found = made()["paper"]["case-4"]["pid-cascade"]
    assert found == dict(dw.simulate(dw.case(4, "pid-cascade")).metrics)
    assert made()["claims"]["change"]["steady_mae"] == -0.76


def test_machines_are_the_first_of_the_ensemble() -> None:
    rig, drawn = load_ensemble("rig"), made()["rig"]
    for index in (0, 7, 19):
        values = leaves(rig.scenario(index, drawn["seed"]).experiment)
        assert drawn["seeds"][index] == values["simulation.seed"]
        for key, numbers in drawn["machines"].items():
            assert numbers[index] == pytest.approx(values[key], rel=1e-15)
        for key, value in drawn["values"].items():
            assert value == values[key] or key in drawn["machines"], key
    spread = np.array(drawn["machines"]["plant.vehicle.mass"]) / 1e4
    assert spread.min() >= drawn["distributions"]["plant.vehicle.mass"]["low"]


def test_a_heavy_machine_has_sliders_of_its_own_and_the_papers_none_that_move_nothing() -> None:
    paper, _, heavy = (set(structure["parameters"]) for structure in made()["structures"])
    own = {"plant.rope_1.mass_per_length", "plant.rope_2.submerged_weight", "plant.track.roller_spacing"}
    own |= {"plant.winch_1.gear_stiffness", "plant.winch_2.backlash", "controller.winch_1.damping"}
    assert own <= heavy
    assert not own & paper
    assert not {"plant.winch_1.gear_damping", "plant.rope_1.spare_length"} & paper
    assert {"plant.winch_1.rotor_inertia", "plant.winch_2.inertia", "plant.rope_1.modulus"} <= paper & heavy
    for key in ("plant.rope_1.mass_per_length", "plant.track.roller_spacing"):
        assert made()["keys"][key]["low"] > 0, "zero is another structure"


def test_the_heavy_machine_is_the_nominal_one_of_the_ensemble() -> None:
    (case,) = (known for known in made()["cases"] if known["id"] == "case-site")
    assert case["structure"] == "fando-nftsm+site"
    heavy = dw.override(dw.case(4), {"controller.winch_1.damping": 164.0, "controller.winch_2.damping": 164.0})
    known = leaves(replace(heavy, plant=load_ensemble("site").experiment.plant))
    usual = leaves(dw.case(2))
    for key, value in case["values"].items():
        assert key == "reference.kind" or value == known[key] != usual[key], key


def test_it_is_plain_json() -> None:
    import json

    assert json.loads(json.dumps(made(), allow_nan=False)) == made()
