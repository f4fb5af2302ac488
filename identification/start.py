"""What a filter expects before the first reading: a machine whose ropes are as taut as the load cells say.

A millimetre more or less of rope is tens of kilonewtons: vehicle and drums are not independently somewhere. So what may
be wrong is the vehicle's position together with both drums, the stretch of each rope, and the speeds.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.predictor import state_template
from dualwinch.identification.sensed import READINGS
from dualwinch.identification.unrecorded import Scatter
from dualwinch.model.plant import holding_torques
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.ropes import crept, rope_lengths
from dualwinch.model.winch import angle_of, winding
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import Structure

Floats = NDArray[np.float64]

POSITION, STRETCH, SPEED = 5e-3, 0.2, 0.02
"""How far position (m), stretch (share) and speed (m/s) may be off at the start, as standard deviations."""


def starting(
    experiment: Experiment,
    structure: Structure,
    first: Floats,
    torques: tuple[float, float],
    t: float,
    scatter: Mapping[str, Scatter],
) -> tuple[Floats, Floats]:
    """Expected state before the first reading, and its covariance.

    Args:
        experiment: gives plant and motors.
        structure: of `identification.predictor.machine_of`.
        first: (readings,) the first of each sensor; NaN where there is none.
        torques: first torque commands in N m.
        t: time of the first sample in s.
        scatter: of the unrecorded.
    """
    plant, sensors = experiment.plant, experiment.sensors
    read = dict(zip(READINGS, first.tolist(), strict=True))
    radius_1, radius_2 = plant.winch_1.drum_radius, plant.winch_2.drum_radius
    angle_1 = read["theta_1"] - sensors.encoder_zero_1 / radius_1
    angle_2 = read["theta_2"] - sensors.encoder_zero_2 / radius_2
    held = holding_torques(2.0, plant)  # 1 N in each rope
    pulls = (
        (read["F1"] - sensors.load_cell_zero_1) / (1 + sensors.load_cell_error_1),
        (read["F2"] - sensors.load_cell_zero_2) / (1 + sensors.load_cell_error_2),
    )
    F1, F2 = (
        pull if math.isfinite(pull) else max(torque / each, 1.0)
        for pull, torque, each in zip(pulls, torques, (held.tau_1, held.tau_2), strict=True)
    )
    x = read["x"] - sensors.position_bias
    if not math.isfinite(x):
        x = float(winding(angle_1, plant.winch_1).rope) if math.isfinite(angle_1) else 0.0
        x = -float(winding(angle_2, plant.winch_2).rope) if not math.isfinite(angle_1) and math.isfinite(angle_2) else x
    length_1, length_2 = rope_lengths(x, plant.track)
    stretch_1 = float(plant.rope_1.resting_stretch(max(F1, 1.0), length_1))
    stretch_2 = float(plant.rope_2.resting_stretch(max(F2, 1.0), length_2))
    v = read["v"] if math.isfinite(read["v"]) else 0.0
    longer_1, longer_2 = crept(t, plant.creep_1)[0], crept(t, plant.creep_2)[0]
    turned = 1 / winding(0.0, plant.winch_1).radius, 1 / winding(0.0, plant.winch_2).radius
    names = list(leaves(state_template(structure)))
    expected = dict.fromkeys(names, 0.0) | {
        "motion.plant.x": x,
        "motion.plant.v": v,
        "motion.plant.theta_1": float(angle_of(stretch_1 + x + longer_1, plant.winch_1)),
        "motion.plant.theta_2": float(angle_of(stretch_2 - x + longer_2, plant.winch_2)),
        "motion.plant.omega_1": v * float(turned[0]),
        "motion.plant.omega_2": -v * float(turned[1]),
    }
    actuator = experiment.actuator
    for number, torque in enumerate(torques, start=1):
        expected |= leaves(actuator.holding_state(torque), f"actuator_{number}.")
    together = {"x": 1.0, "theta_1": turned[0], "theta_2": -turned[1]}
    ways: list[dict[str, float]] = [
        {f"motion.plant.{name}": POSITION * share for name, share in together.items()},
        {"motion.plant.theta_1": STRETCH * stretch_1 * turned[0]},
        {"motion.plant.theta_2": STRETCH * stretch_2 * turned[1]},
        {
            "motion.plant.v": SPEED,
            "motion.plant.omega_1": SPEED * turned[0],
            "motion.plant.omega_2": -SPEED * turned[1],
        },
        {"motion.plant.omega_1": SPEED * turned[0]},
        {"motion.plant.omega_2": SPEED * turned[1]},
        *({f"unrecorded.{name}": each.deviation} for name, each in scatter.items()),
    ]
    directions = np.array([[way.get(name, 0.0) for name in names] for way in ways], float)
    return np.array([expected[name] for name in names], float), directions.T @ directions
