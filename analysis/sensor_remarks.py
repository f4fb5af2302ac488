"""Remarks on sensors that the controller takes for better than they are, and on one that is better than any."""

from collections.abc import Collection
from dataclasses import fields

from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import largest_speed
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.sensors import DELAYS, Sensors

NOISES = tuple(field.name for field in fields(Sensors) if field.name.endswith("_noise"))
"""Fields that are standard deviations of white noise."""


def sensor_remarks(experiment: Experiment, checked: Collection[str] = ()) -> list[str]:
    """Remarks on delays and rates of sensors that the controller does not assume, and on a speed without noise.

    Of a late position the remark has the error that it makes at the reference's largest speed. Nothing is said of a
    speed without noise where the user has `checked` that key.

    Example:
        >>> import dualwinch as dw
        >>> from dualwinch.analysis.sensor_remarks import sensor_remarks
        >>> sensor_remarks(dw.override(dw.case(4), {"sensors.position_delay": 5e-3}))[0]
        'sensors.position_delay = 0.005 s: the controller takes the reading for the present one, 9 mm off at 1.8 m/s'
    """
    values, remarks = leaves(experiment), list[str]()
    for name in DELAYS:
        delay, key = values[f"sensors.{name}"], f"controller.kalman.{name}"
        assumed = values.get(key, 0.0)
        if delay == assumed or (name == "position_delay" and values.get("controller.drums.delay")):
            continue
        words = f"sensors.{name} = {delay:g} s: the controller takes the reading for the present one"
        if assumed:
            words = f"{key} = {assumed:g} s, where sensors.{name} = {delay:g} s"
        off = ""
        if name == "position_delay":
            speed = largest_speed(experiment.reference, experiment.duration)
            off = f", {1e3 * abs(delay - assumed) * speed:.3g} mm off at {speed:.3g} m/s"
        advice = f"; {key} tells it" if key in values and not assumed and not off else ""
        remarks.append(words + off + advice)
    rate, key = values["sensors.position_rate"], "controller.trust.position_rate"
    if rate != values.get(key, 0.0):
        hint = f"; {key} = {rate:g} tells it" if key in values else ""
        remarks.append(
            f"sensors.position_rate = {rate:g} a second: the controller takes held readings for new ones{hint}"
        )
    noisy = [f"sensors.{name}" for name in NOISES if values[f"sensors.{name}"]]
    unread = values["sensors.speed"] == "none" or "v" in experiment.controller.estimator.silent
    if noisy and not (values["sensors.speed_noise"] or unread or "sensors.speed_noise" in checked):
        remarks.append(
            f"sensors.speed_noise = 0: a speed without noise beside {', '.join(noisy)}; no wheel is so good, and "
            'gains found with it need not hold; without a wheel: sensors.speed = "none"'
        )
    return remarks
