"""Logs of machines whose ropes have mass and sag and whose gearboxes give, fitted by a model that has them too."""

import math

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.loop.structure import parameters_of
from dualwinch.toolboxes.identification.options import DEFAULTS
from dualwinch.toolboxes.identification.predictor import (
    READINGS,
    described_disturbances,
    initial_state,
    parameter_names,
    predicted_system,
    predictor_structure,
    state_template,
)

SITE = dw.load_ensemble("site").experiment


def test_the_filter_begins_with_ropes_as_taut_as_the_load_cells_read() -> None:
    """Sag and inner nodes among them: its first prediction is what the sensors read."""
    structure, process = predictor_structure(SITE), described_disturbances(SITE, DEFAULTS.noise)
    read = np.array([20.0, 0.5, 1400.0, 700.0, np.nan, np.nan, np.nan, np.nan])
    state, covariance = initial_state(SITE, structure, read, (30.0, 15.0), 0.0, process, DEFAULTS.initial_state)
    known = parameters_of(SITE) | {f"time.{name}": each.time for name, each in process.items()}
    parameters = [known[key] for key in parameter_names(structure)]
    found = predicted_system(structure, ()).sense(state, [0.0, 30.0, 15.0, 1e-3, 1.0, 1.0], parameters)
    first = dict(zip(READINGS, np.array(found).ravel().tolist(), strict=True))
    assert [first[name] for name in ("x", "v")] == pytest.approx([20.0, 0.5])
    assert [first[name] for name in ("F1", "F2")] == pytest.approx([1400.0, 700.0], rel=0.02)  # and drag along the rope
    turns = [1400.0, 700.0] / np.array(SITE.plant.winch_1.gear_stiffness) * 0.8 + SITE.plant.winch_1.backlash / 2
    assert abs(first["theta_1"] - turns[0] - 25.0) < 0.1
    spread = np.linalg.eigvalsh(covariance)
    assert spread.min() > -1e-15 * spread.max()
    assert (np.diag(covariance)[:6] > 0).all()
    spread = dict(zip(leaves(state_template(structure)), np.sqrt(np.diag(covariance)).tolist(), strict=True))
    assert all(spread[f"motion.plant.rope_{number}.hysteresis.share"] == 1 / math.sqrt(3) for number in (1, 2))
    for number, pull in ((1, 1400.0), (2, 700.0)):  # 1 m of rope with the water around it, and its depth at rest
        rate = DEFAULTS.initial_state.share * 20.2 / (8 * pull) * np.pi * np.sqrt(pull / 2.96)
        assert spread[f"motion.plant.rope_{number}.sag.rate"] == pytest.approx(rate, rel=0.02)
    inner = ("waves.position", "waves.speed", "actuator_1.torque", "load_cells.F1", "rail.deflection")
    assert all(value > 0 for name, value in spread.items() if name.endswith(inner))


@pytest.mark.nightly
@pytest.mark.slow
def test_the_masses_of_ropes_are_found() -> None:
    """Also of the slack one, half a metre long at first, whose friction between the wires is unknown then."""
    damped = {f"controller.winch_{number}.damping": 164.0 for number in (1, 2)}
    machine = dw.override(
        SITE,
        damped
        | {"simulation.duration": 20.0, "simulation.readings": True, "controller.estimator": "self-calibrating-kalman"},
    )
    log = dw.simulate(dw.override(machine, {"plant.rope_1.mass_per_length": 2.5, "plant.rope_2.mass_per_length": 2.3}))
    found = dw.identify(log, ["plant.rope_*.mass_per_length"], machine)
    deviations = np.sqrt(np.diag(found.covariance))
    assert (deviations < 0.02).all()
    assert (np.abs(found.values - [2.5, 2.3]) < 4 * deviations).all()


@pytest.mark.slow
def test_the_controller_of_an_experiment_is_no_part_of_the_model_that_is_fitted() -> None:
    machine = dw.override(dw.case(2), {"simulation.duration": 4.0, "simulation.readings": True})
    log, key = dw.simulate(machine), "plant.vehicle.mass"
    plain = dw.identify(log, [key], machine, unrecorded=0.9)
    filtered = dw.identify(log, [key], dw.override(machine, {"controller.estimator": "kalman"}), unrecorded=0.9)
    assert filtered.values == pytest.approx(plain.values)
