"""What a run that was completed does not say by that: slack ropes, forces at their limit, chatter, an unstable loop."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dualwinch.model.errors import DualwinchError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.analysis.linear_loop import linear_closed_loop
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.result import Result


@dataclass(frozen=True)
class RemarkLimits:
    """From where on a figure of merit is worth a remark.

    Attributes:
        chatter: mean jump of a tension from sample to sample, as a share of half the preload; noise-free laws of the
            paper's cases are below a thousandth.
        saturated: share of the samples with the force command beyond its limit.
    """

    chatter: float = 0.01
    saturated: float = 0.05


WINCHES = ("winch_1", "winch_2")

DEPENDENT: dict[str, tuple[str, ...]] = {
    "plant.vehicle.drag_area": ("plant.vehicle.diameter", "plant.vehicle.height"),
    **{f"plant.{winch}.inertia": (f"plant.{winch}.drum_radius",) for winch in WINCHES},
    **{
        f"controller.{winch}.{gain}": (f"plant.{winch}.drum_radius", f"plant.{winch}.gear_ratio")
        for winch in WINCHES
        for gain in ("kp", "ki")
    },
}
"""Key whose default was made for the defaults of others, which it does not follow."""


def defaults_left(experiment: Experiment) -> list[str]:
    """Say which defaults did not follow values that an experiment has in place of the defaults they were made for."""
    values, usual = leaves(experiment), leaves(Experiment())
    left = {
        key: [other for other in others if values[other] != usual[other]]
        for key, others in DEPENDENT.items()
        if key in values and values[key] == usual.get(key)
    }
    return [
        f"{key} = {values[key]:g} is still the default and does not follow {', '.join(others)}"
        for key, others in left.items()
        if others
    ]


def remarks(result: Result, limits: RemarkLimits | None = None) -> Iterator[str]:
    """Say in words what is wrong with a completed run; nothing of other runs, whose outcome says it.

    The closed loop is linearised at rest amid the track (`linear_closed_loop`), as `dualwinch linearise --loop closed`
    does, where the plant is not the default one, or the run chatters.

    Args:
        result: the run.
        limits: from where on.
    """
    if result.outcome != "completed":
        return
    metrics, limits, experiment = result.metrics, limits or RemarkLimits(), result.experiment
    half = experiment.controller.limits.preload / 2
    if metrics.slack_share > 0:
        yield f"a rope is slack in {100 * metrics.slack_share:.3g} % of the samples: more preload, or slower"
    if metrics.saturated_share > limits.saturated:
        yield f"the force command is beyond its limit in {100 * metrics.saturated_share:.3g} % of the samples"
    chatters = metrics.chatter > limits.chatter * half
    if chatters:
        yield (
            f"it chatters: tensions jump by {metrics.chatter:.3g} N a sample, {100 * metrics.chatter / half:.2g} % of "
            "their mean"
        )
    if chatters or experiment.plant != Experiment().plant:
        middle = experiment.plant.track.length / 2
        try:
            radius = float(np.abs(linear_closed_loop(experiment, middle).poles()).max(initial=0.0))
        except (DualwinchError, ArithmeticError):
            return  # there is no rest to linearise at
        if radius > 1:
            rate = np.log(radius) / experiment.simulation.sample_time
            yield (
                f"unstable at small amplitudes: at rest at {middle:g} m deviations grow by {rate:.3g} 1/s "
                f"(dualwinch linearise --loop closed --x {middle:g})"
            )
