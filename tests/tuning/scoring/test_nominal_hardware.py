"""Nominal hardware: nothing but what data sheets say is left out of a scenario."""

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.quantities.tree import leaves
from dualwinch.tuning.scoring.training_set import nominal_hardware

ERRORS = ("error", "zero", "eccentricity", "ripple", "elongation", "bias", "drift")
RIG, SEA = load_ensemble("rig"), load_ensemble("sea")


def test_what_no_data_sheet_says_is_zero_and_all_else_stays() -> None:
    drawn = RIG.chosen(range(4), 3)
    for before, after in zip(drawn, nominal_hardware(drawn), strict=True):
        theirs, ours = leaves(before.experiment), leaves(after.experiment)
        changed = {key for key in ours if ours[key] != theirs[key]}
        assert {ours[key] for key in changed} == {0.0}
        assert all(any(error in key for error in ERRORS) for key in changed)
        assert {"plant.winch_1.radius_error", "sensors.encoder_zero_2", "sensors.position_drift"} <= changed
        assert ours["plant.vehicle.mass"] == theirs["plant.vehicle.mass"] != 1e4
        assert ours["simulation.seed"] == theirs["simulation.seed"]
        assert (ours["simulation.jitter"], ours["sensors.outage_length"]) == (50e-6, 0.2)
        assert after.index == before.index


def test_in_the_sea_there_is_nothing_to_leave_out() -> None:
    drawn = SEA.chosen(range(3), 3)
    assert [each.experiment for each in nominal_hardware(drawn)] == [each.experiment for each in drawn]
    assert nominal_hardware([]) == []
