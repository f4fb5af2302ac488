"""What makes a log no log of such a machine: columns that cannot be, and fits that have to explain too much away."""

from collections.abc import Sequence

import numpy as np

from dualwinch.identification.fit import Fit
from dualwinch.identification.log import TORQUES, Log
from dualwinch.identification.noise import smallest_noise
from dualwinch.identification.sections import Section
from dualwinch.identification.sensed import READINGS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import holding_torques
from dualwinch.simulation.experiment import Experiment

ANOTHER = 0.1
"""Unrecorded torque or force over the recorded one, both root mean square, from which on the machine is another."""

BEYOND_DOUBT = 0.9
"""The same, from which on nobody is told how to have the fit nonetheless."""

NOISIER = 50.0
"""How much noisier than its own jumps a sensor would have to be for a log to be of another machine."""

BEYOND_TRACK, BEYOND_LIMITS = 0.2, 10.0
"""How far a column may lie beyond the track, over its length, and beyond limits of tension, as a factor."""


def check_log(log: Log, experiment: Experiment) -> None:
    """Refuse a log with columns that cannot be.

    Raises:
        ConfigurationError: a column that never changes, or one that must be in another unit.
    """
    held = [name for name in TORQUES if np.nanmin(log.columns[name]) == np.nanmax(log.columns[name])]
    if len(held) == len(TORQUES):
        raise ConfigurationError(f"{log.name}: tau_1, tau_2: never change, and torques are what a fit goes by")
    for name in log.readings:
        low, high = float(np.nanmin(log.columns[name])), float(np.nanmax(log.columns[name]))
        if low == high:
            raise ConfigurationError(
                f"{log.name}: {name}: is {low:g} in every row; name another column (--column {name}=NAME) or leave it "
                f"out (--column {name}=-)"
            )
    for name, (low, high) in plausible(experiment).items():
        if name not in log.columns:
            continue
        least, most = float(np.nanmin(log.columns[name])), float(np.nanmax(log.columns[name]))
        if least < low or most > high:
            worst = least if least < low else most
            raise ConfigurationError(
                f"{log.name}: {name} = {worst:.4g}: must be {low:.3g} to {high:.3g} on this machine; is it in another "
                f"unit (--column {name}=NAME:UNIT)?"
            )


def plausible(experiment: Experiment) -> dict[str, tuple[float, float]]:
    """Column → the lowest and highest value, in SI units, that a log of such a machine may hold."""
    plant, strongest = experiment.plant, BEYOND_LIMITS * experiment.controller.limits.tension_max
    length, radius_1, radius_2 = plant.track.length, plant.winch_1.drum_radius, plant.winch_2.drum_radius
    beyond, torques = BEYOND_TRACK * length, holding_torques(2 * strongest, plant)
    whole = length + beyond
    return {
        "x": (-beyond, whole),
        "F1": (-strongest, strongest),
        "F2": (-strongest, strongest),
        "theta_1": (-whole / radius_1, whole / radius_1),
        "theta_2": (-whole / radius_2, whole / radius_2),
        "tau_1": (-float(torques.tau_1), float(torques.tau_1)),
        "tau_2": (-float(torques.tau_2), float(torques.tau_2)),
    }


def check_fit(
    name: str, fit: Fit, sections: Sequence[Section], experiment: Experiment, unrecorded: float = ANOTHER
) -> tuple[str, ...]:
    """Refuse a fit that has to explain torques or readings away.

    Args:
        name: of the log.
        fit: to be looked at.
        sections: of the log.
        experiment: what was believed.
        unrecorded: torque or force that nobody recorded, over the recorded one, from which on a fit is refused.

    Returns:
        What is said of a fit that is not refused, but would have been with the usual share, `ANOTHER`.

    Raises:
        ConfigurationError: torques or forces that nobody recorded would be as large as those that were, or a sensor
            noisier by far than it jumps.
    """
    recorded = np.concatenate([section.torques for section in sections])
    held = holding_torques(2.0, experiment.plant)  # 1 N in each rope
    pulls = recorded[:, 0] / float(held.tau_1), recorded[:, 1] / float(held.tau_2)
    torque, force = float(np.sqrt(np.mean(recorded**2))), float(np.sqrt(np.mean(pulls[0] ** 2 + pulls[1] ** 2)))
    further = {key: each.deviation for key, each in fit.levels.scatter.items()}
    readings = np.concatenate([section.readings for section in sections])
    counts = np.isfinite(readings).sum(axis=0)
    seen = counts[[READINGS.index(name) for name in ("x", "v", "F1", "F2")]].any()
    excess = {
        f"torques of {further['torque_1']:.3g} N m that nobody recorded would have to act beside those of {torque:.3g} "
        "N m that were": further["torque_1"] / torque,
        f"a force of {further['force']:.3g} N that nobody recorded would have to act on the vehicle beside the "
        f"{force:.3g} N of the ropes": further["force"] / force if seen else 0.0,
    }
    unlike = "it is of another machine, or tau_1 or tau_2 is of another sign, unit or time"
    for what, share in excess.items():
        if share > unrecorded:
            yet = f" (--unrecorded {share + 0.005:.0%} takes it for this one)" if share < BEYOND_DOUBT else ""
            raise ConfigurationError(f"{name}: {what}: {unlike}{yet}")
    jumps = smallest_noise(readings)
    ratios = np.sqrt(fit.levels.noise) / jumps
    for index, reading in enumerate(READINGS):
        if counts[index] and ratios[index] > NOISIER:
            raise ConfigurationError(
                f"{name}: {reading}: what is left of it is {jumps[index] * ratios[index]:.3g} (s.d.), its own noise "
                f"{jumps[index]:.3g}: {unlike}"
            )
    return tuple(f"{what}: the model lacks something" for what, share in excess.items() if share > ANOTHER)
