"""What a search in an ensemble begins with, beyond the paper's gains."""

import math
from collections.abc import Collection

from dualwinch.controllers.coordinations.proportional_tension import ProportionalTension
from dualwinch.model.plant import Plant, is_distributed
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.ropes import tangent_rope
from dualwinch.model.scalar import present
from dualwinch.model.winch import total_inertia
from dualwinch.simulation.ensembles.ensemble import Ensemble

KNOWN = ("drum_radius", "layer_thickness")
"""Numbers of a winch that a controller knows, unless they are drawn."""

POSITIONS = frozenset(
    (
        *(f"plant.winch_{i}.{name}" for i in (1, 2) for name in (*KNOWN, "radius_error", "eccentricity")),
        *(f"plant.creep_{i}.elongation" for i in (1, 2)),
        *(f"sensors.encoder_zero_{i}" for i in (1, 2)),
        *(f"sensors.{name}" for name in ("position_bias", "position_drift", "outage_length")),
    )
)
"""Keys of what an estimator is misled by that takes drums and encoder zeros for exact."""

FORCES = frozenset(
    (
        *(f"plant.winch_{i}.{name}" for i in (1, 2) for name in ("torque_error", "torque_ripple")),
        *(f"sensors.load_cell_{name}_{i}" for i in (1, 2) for name in ("error", "zero")),
    )
)
"""Keys of what makes tensions others than torques and load cells say."""

CALIBRATING = "calibrating-kalman"
"""The estimator for noisy sensors and inexact ropes, where drums, encoder zeros and position sensor are exact."""

RESERVE = "controller.coordination.reserve"

SMOOTHING = "controller.nftsm.smoothing"


def default_estimator(ensemble: Ensemble) -> str:
    """The kind of filter for noisy sensors and inexact ropes, and maybe drums that nobody knows exactly."""
    return "self-calibrating-kalman" if _uncertain(ensemble, POSITIONS) else CALIBRATING


def default_coordination(ensemble: Ensemble) -> str | None:
    """The kind that shares fast forces in proportion to the tensions, where ropes sag; ``None``: as it is."""
    sags = any(present(side.rope.submerged_weight) for side in ensemble.experiment.plant.sides)
    return ProportionalTension.kind if sags else None


def default_reserve(ensemble: Ensemble) -> float:
    """What tensions near their limit may be off by, in N, as far as torques and load cells are uncertain.

    Where drums swing, more, for what the tensions overshoot (`SWING`).
    """
    if not _uncertain(ensemble, FORCES):
        return 0.0
    plant, limit = ensemble.experiment.plant, ensemble.experiment.controller.limits.tension_max
    shares = (_largest(ensemble, key) for key in FORCES if "zero" not in key and "ripple" not in key)
    zeros = (_largest(ensemble, key) for key in FORCES if "zero" in key)
    off = limit * max(shares) + max(zeros)
    return off * SWING if swings(plant) else off


def default_beliefs(ensemble: Ensemble) -> dict[str, float]:
    """Key → what the controller of an ensemble begins with beyond the paper, where its machines ask for more.

    Where ropes have mass, gears give or winches are heavy: damping of the drums that matches the wave impedance of
    the ropes and leads the lag of the drives (`controllers.coordinations.winch_pid`), more preload, and the
    filter's estimate of the disturbance and of its rate in place of the law's observer. The observer's gain stands
    in the loop gain at the drums' resonance (`simulation.analysis.resonance`); the filter, which measured tensions
    drive, sees no disturbance there. The law is stiffer, by a thinner boundary layer, and smoother: below the speed
    error where its odd powers are smoothed they damp in proportion to the speed. Unsmoothed they damp small motions
    so much that an error of half a millimetre takes a second to fade. Beside these, deviations for what the
    self-calibrating filter learns.
    """
    experiment, known = ensemble.experiment, leaves(ensemble.experiment)
    plant, beliefs = experiment.plant, dict[str, float]()
    if swings(plant):
        beliefs["controller.coordination.preload"] = MORE_PRELOAD * experiment.controller.limits.preload
        beliefs |= STIFF if "controller.kalman.compensation" in known else {}
    for side in plant.sides if swings(plant) else ():
        length = plant.track.length / 2 + plant.track.rope_offset
        rope = tangent_rope(side.rope, experiment.controller.limits.preload / 2, length)
        impedance = math.sqrt(rope.modulus * rope.area * (side.rope.mass_per_length or STEEL_ROPE))
        beliefs[f"controller.winch_{side.number}.damping"] = (
            impedance * side.winch.drum_radius**2 / side.winch.gear_ratio
        )
        beliefs[f"controller.winch_{side.number}.lead"] = LEAD * known.get(DRIVE, 0.0)
        lever = side.winch.drum_radius / side.winch.gear_ratio
        beliefs |= {f"controller.winch_{side.number}.{gain}": value * lever for gain, value in TENSION_LOOP.items()}
        if side.winch.gear_stiffness:
            beliefs["controller.drums.give"] = side.winch.drum_radius**2 / side.winch.gear_stiffness
        if side.rope.submerged_weight:
            beliefs["controller.drums.sag"] = SAG_DEVIATION
    if _uncertain(ensemble, ["sensors.speed_error"]):
        beliefs["controller.drums.wheel"] = _largest(ensemble, "sensors.speed_error")
    return {key: value for key, value in beliefs.items() if key in known}


DRIVE, LEAD = "actuator.motor.time_constant", 0.4
"""Lag of the drives, and the share of it by which damping leads.

It doubles the delay that the loop tolerates at a motor's torque, at the resonance of rotor and gearbox. A longer lead
amplifies what is faster than that resonance: less delay is tolerated on short ropes.
"""

STEEL_ROPE = 2.36
"""Mass of a steel rope of 24 mm in kg/m (EN 12385-4), for the impedance of ropes that are modelled without mass."""

MORE_PRELOAD = 1.8
"""Factor on the preload with which ropes of swinging drums stay taut, so that a search starts with feasible gains."""

STIFF = {
    "controller.kalman.compensation": 1.0,
    "controller.kalman.ramp": 0.2,
    "controller.kalman.speed_noise": 3e-3,
    "controller.kalman.encoder_noise": 2e-4,
    "controller.observer.l0": 0.2,
    "controller.nftsm.phi": 0.01,
    "controller.nftsm.beta": 0.3,
    SMOOTHING: 2e-3,
}
"""Gains of a stiff and smooth law whose filter compensates the disturbance, where drums swing.

Wheel and encoders are believed less than their own noise says: they see the vehicle through ropes that stretch and sag.
"""

TENSION_LOOP = {"kp": 0.009, "ki": 0.45}
"""Gains of the tension loops over the lever of torque to tension: stronger ones make swinging drums swing more."""

SWING = 1.6
"""Factor on the reserve for what the tensions of swinging drums overshoot."""

SAG_DEVIATION = 0.7
"""Share by which sags are believed to differ: spacings of rollers by a third."""

HEAVY = 20.0
"""Inertia of a winch over its drum's radius squared, in kg, from which on it swings on its rope."""


def swings(plant: Plant) -> bool:
    """Whether drums swing on their ropes as those of light drums on ropes without mass do not."""
    return is_distributed(plant) or any(
        total_inertia(side.winch) > HEAVY * side.winch.drum_radius**2 for side in plant.sides
    )


def further_gains(ensemble: Ensemble) -> dict[str, dict[str, float]]:
    """Gains to search for beside the standard ones, as entries of a space.

    Where drums swing on their ropes, the smoothing of the law is searched for. The damping of the winches is not:
    it is the wave impedance of the ropes. Searches raise it to twice that and more, for less error, and the loop
    then tolerates less than a sample of further delay.

    Where tensions are uncertain, commands keep off their limit: by up to what tensions may be off there, and half of it
    again for what they swing. More of it is missing where the reference asks for nearly all the force there is, which
    is too seldom for a search to see.
    """
    off, known = default_reserve(ensemble), leaves(ensemble.experiment)
    reserve = {RESERVE: {"lower": 0.0, "upper": 1.5 * off}} if off else {}
    smoothed = {SMOOTHING: {}} if swings(ensemble.experiment.plant) and SMOOTHING in known else {}
    return reserve | smoothed


def _largest(ensemble: Ensemble, key: str) -> float:
    """Largest magnitude that a key has in any scenario."""
    given = leaves(ensemble.experiment)[key]
    drawn = ensemble.distributions.get(key)
    return max(abs(float(value)) for value in (drawn.ends(given) if drawn else (given,)))


def assumptions(ensemble: Ensemble | None) -> str:
    """What has to be true of a machine for gains tuned in an ensemble to be worth what they are there, in words."""
    if ensemble is None:
        return "this assumes that machine and sensors match the model exactly"
    if _uncertain(ensemble, POSITIONS):
        return f"this holds for machines within the tolerances of '{ensemble.name}'"
    return (
        "this assumes exact drums, encoder zeros and position sensor, as "
        f"'{ensemble.name}' does (dualwinch stress finds how exact they must be)"
    )


def _uncertain(ensemble: Ensemble, keys: Collection[str]) -> bool:
    """Whether one of these is drawn, or is not zero, beside what a controller knows."""
    given = leaves(ensemble.experiment)
    return any(key in ensemble.distributions or (given[key] and not key.endswith(KNOWN)) for key in keys)
