"""What `dualwinch.identify` compares a machine with, and the fit of one log."""

import dualwinch as dw
from dualwinch.model.quantities import tables
from dualwinch.toolboxes.identification.alternatives import ALTERNATIVES
from dualwinch.toolboxes.identification.log import log_of

LOGGED = {
    "simulation.duration": 60.0,
    "simulation.sample_time": 2e-3,
    "simulation.readings": True,
    "sensors.position_noise": 5e-4,
    "sensors.speed_noise": 2e-3,
    "sensors.tension_noise": 10.0,
    "sensors.encoder_counts": 4096,
    "disturbance.current_sigma": 0.05,
    "disturbance.normal_force_sigma": 0.1,
}
"""A log of Case 4 with usual sensors, in a sea."""

DESCRIBED = {"plant.rope_1.modulus": 7.2e10, "plant.rope_2.modulus": 8.8e10}
"""Moduli that are off by a tenth."""

KEYS = "plant.vehicle.mass, plant.vehicle.drag_coefficient, plant.rope_*.modulus"


def alternatives() -> str:
    """Names and meanings of all alternatives."""
    rows = [[f"`{kind}`", each.meaning] for kind, each in ALTERNATIVES.items()]
    return tables.markdown(["alternative", "meaning"], rows)


def example() -> str:
    """Estimates by the log of a machine that is described wrong."""
    right = dw.override(dw.case(4), LOGGED)
    fit = dw.identify(log_of(dw.simulate(right)), KEYS, dw.override(right, DESCRIBED), plain=True)
    return tables.markdown(*fit.tables[0])
