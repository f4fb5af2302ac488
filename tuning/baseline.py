"""Baseline controller of an ensemble: estimator, coordination and gains that a search starts from."""

from collections.abc import Collection
from dataclasses import replace

from dualwinch.controllers.coordinations.proportional_tension import ProportionalTension
from dualwinch.model.plant import Plant, is_distributed, sags
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.winch import total_inertia
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment

KNOWN = ("drum_radius", "layer_thickness")
"""Parameters of a winch that a controller knows, unless they are drawn."""

POSITIONS = frozenset(
    (
        *(f"plant.winch_{i}.{name}" for i in (1, 2) for name in (*KNOWN, "radius_error", "eccentricity")),
        *(f"plant.creep_{i}.elongation" for i in (1, 2)),
        *(f"sensors.encoder_zero_{i}" for i in (1, 2)),
        *(f"sensors.{name}" for name in ("position_bias", "position_drift", "outage_length")),
    )
)
"""Keys of imperfections that bias an estimator which assumes exact drums, encoder zeros and position sensor."""

FORCES = frozenset(
    (
        *(f"plant.winch_{i}.{name}" for i in (1, 2) for name in ("torque_error", "torque_ripple")),
        *(f"sensors.load_cell_{name}_{i}" for i in (1, 2) for name in ("error", "zero")),
    )
)
"""Keys of imperfections that make tensions differ from commanded torques and load cells."""

CALIBRATING = "calibrating-kalman"
"""The estimator for noisy sensors and inexact ropes, where drums, encoder zeros and position sensor are exact."""

RESERVE = "controller.coordination.reserve"

SMOOTHING = "controller.nftsm.smoothing"

POSITION_NOISE = "controller.kalman.position_noise"
"""Key of the position's noise that the filters assume; searches keep it."""


def default_estimator(ensemble: Ensemble) -> str:
    """The kind of filter for noisy sensors and uncertain ropes, or also for uncertain drums (`POSITIONS`) and sag.

    The former knows ropes by their compliance alone, and takes the length of their sag for a position error.
    """
    return "self-calibrating-kalman" if uncertain_drums(ensemble) or sags(ensemble.experiment.plant) else CALIBRATING


def uncertain_drums(ensemble: Ensemble) -> bool:
    """Whether drums, encoder zeros or the position sensor are uncertain."""
    return _uncertain(ensemble, POSITIONS)


def default_coordination(ensemble: Ensemble) -> str | None:
    """The kind that shares fast forces in proportion to the tensions, where ropes sag; else ``None``: no change."""
    return ProportionalTension.kind if sags(ensemble.experiment.plant) else None


def default_reserve(ensemble: Ensemble) -> float:
    """Error in N that uncertain torques and load cells cause in a tension near its limit.

    Times `SWING` where drums swing, for the overshoot of the tensions.
    """
    if not _uncertain(ensemble, FORCES):
        return 0.0
    plant, limit = ensemble.experiment.plant, ensemble.experiment.controller.limits.tension_max
    shares = (_largest(ensemble, key) for key in FORCES if "zero" not in key and "ripple" not in key)
    zeros = (_largest(ensemble, key) for key in FORCES if "zero" in key)
    off = limit * max(shares) + max(zeros)
    return off * SWING if swings(plant) else off


def starting_gains(ensemble: Ensemble) -> dict[str, float]:
    """Key → start value of a gain for which the paper's own does not suit the machines of an ensemble.

    Where ropes have mass, gears are elastic or winches are heavy: a higher preload. The remaining values are the noise
    of the position sensor, with its rounding, to one digit, and prior deviations of the parameters that the
    self-calibrating filter learns. The gains of law, filter and winches are designed (`analysis.design`).
    """
    experiment, values = ensemble.experiment, leaves(ensemble.experiment)
    plant, gains = experiment.plant, dict[str, float]()
    if swings(plant):
        gains["controller.coordination.preload"] = MORE_PRELOAD * experiment.controller.limits.preload
    for side in plant.sides if swings(plant) else ():
        if side.winch.gear_stiffness:
            gains["controller.drums.give"] = side.winch.drum_radius**2 / side.winch.gear_stiffness
        if side.rope.submerged_weight:
            gains["controller.drums.sag"] = SAG_DEVIATION
    coarsest = {name: _largest(ensemble, f"sensors.{name}") for name in ("position_noise", "position_resolution")}
    if noise := replace(experiment.sensors, **coarsest).position_deviation:
        gains[POSITION_NOISE] = float(f"{noise:.1g}")
    if _uncertain(ensemble, ["sensors.speed_error"]):
        gains["controller.drums.wheel"] = _largest(ensemble, "sensors.speed_error")
    return {key: value for key, value in gains.items() if key in values}


MORE_PRELOAD = 1.8
"""Factor on the preload that keeps ropes of swinging drums taut, so that a search starts from feasible gains."""

SWING = 1.6
"""Factor on the reserve for the overshoot of the tensions of swinging drums."""

SAG_DEVIATION = 0.7
"""Prior relative deviation of the sags: a deviation of a third in the rollers' spacing."""

DAMPING = ("controller.winch_1.damping", "controller.winch_2.damping")
"""Keys of the damping of the drums' speed."""

SHAPING = ("controller.winch_1.shaping", "controller.winch_2.shaping")
"""Keys of the damping ratio that shaping gives the drums' resonance."""

TIED_SHAPING = "controller.winch.shaping"
"""Name of both in a space."""

SWINGING = "ropes have mass, gearboxes give or winches are heavy, so that drums swing on their ropes (docs/site.md)"
"""Why the paper's gains do not suit a machine that `swings`, in words."""

HEAVY = 20.0
"""Inertia of a winch over its drum's radius squared, in kg, above which the drum swings on its rope."""


def swings(plant: Plant) -> bool:
    """Whether drums swing on their ropes: the plant is distributed, or a winch is heavier than `HEAVY`."""
    return is_distributed(plant) or any(
        total_inertia(side.winch) > HEAVY * side.winch.drum_radius**2 for side in plant.sides
    )


def undamped(experiment: Experiment) -> list[str]:
    """Keys of the drums' damping that are 0 although the drums swing."""
    keys_of = leaves(experiment)
    return [key for key in DAMPING if keys_of.get(key) == 0] if swings(experiment.plant) else []


def further_gains(ensemble: Ensemble) -> dict[str, dict[str, float]]:
    """Gains to search for besides the standard ones, as entries of a space.

    Where drums swing on their ropes, the smoothing of the law is tuned, and so is the shaping of the tension commands
    by their resonance if the winches start with it: without it the loop has other code. The damping of the winches
    stays at the wave impedance of the ropes: searches raise it to more than twice that, for less error, and the delay
    margin of the loop then falls below a sample.

    Where tensions are uncertain, commands keep a reserve to their limit: up to 1.5 times the error of a tension there,
    the half for its overshoot. A larger reserve lacks force where the reference needs nearly all of it, which is too
    rare for a search to see.
    """
    off, values = default_reserve(ensemble), leaves(ensemble.experiment)
    reserve = {RESERVE: {"lower": 0.0, "upper": 1.5 * off}} if off else {}
    if not swings(ensemble.experiment.plant):
        return reserve
    names = ([SMOOTHING] if SMOOTHING in values else []) + ([TIED_SHAPING] if all(map(values.get, SHAPING)) else [])
    return reserve | {name: {} for name in names}


def _largest(ensemble: Ensemble, key: str) -> float:
    """Largest magnitude of a key over all scenarios."""
    nominal = leaves(ensemble.experiment)[key]
    distribution = ensemble.distributions.get(key)
    return max(abs(float(value)) for value in (distribution.ends(nominal) if distribution else (nominal,)))


def assumptions(ensemble: Ensemble | None) -> str:
    """Conditions, in words, under which gains tuned in an ensemble perform on a machine as they do there."""
    if ensemble is None:
        return "this assumes that machine and sensors match the model exactly"
    if _uncertain(ensemble, POSITIONS):
        return f"this holds for machines within the tolerances of '{ensemble.name}'"
    return (
        "this assumes exact drums, encoder zeros and position sensor, as "
        f"'{ensemble.name}' does (dualwinch stress finds how exact they must be)"
    )


def _uncertain(ensemble: Ensemble, keys: Collection[str]) -> bool:
    """Whether one of the keys is drawn, or is not zero and not one of `KNOWN`."""
    values = leaves(ensemble.experiment)
    return any(key in ensemble.distributions or (values[key] and not key.endswith(KNOWN)) for key in keys)
