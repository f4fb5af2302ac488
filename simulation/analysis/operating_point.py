"""Operating points of an experiment: plant, preload and limits come from it."""

from dualwinch.model.linear.operating_point import OperatingPoint
from dualwinch.model.linear.operating_point import operating_point as of_plant
from dualwinch.model.plant import Plant
from dualwinch.simulation.experiment import Experiment


def operating_point(
    x: float | None = None,
    v: float = 0.0,
    preload: float | None = None,
    plant: Plant | None = None,
    *,
    experiment: Experiment | None = None,
    current: float = 0.0,
    force: float = 0.0,
    tension_min: float | None = None,
    tension_max: float | None = None,
) -> OperatingPoint:
    """State, torques and tensions with which the vehicle passes x at the constant speed v.

    What is not given comes from the experiment, or is the paper's. See
    `model.linear.operating_point.operating_point` for how the tensions are shared.

    Args:
        x: position in m; default: amid the track.
        v: speed in m/s, -10 to 10; negative: towards winch 2.
        preload: sum of both tensions in N, between twice tension_min and twice tension_max.
        plant: in place of the experiment's.
        experiment: default: the paper's.
        current: ambient current in m/s, constant.
        force: disturbance force in N along the track, constant.
        tension_min: lower limit of a tension in N; 0 lets a rope go slack.
        tension_max: upper limit of a tension in N.

    Raises:
        ConfigurationError: a point off the track, a rope at its shortest length, a speed, preload or limit out of
            range.
    """
    experiment = experiment or Experiment()
    plant, limits = plant or experiment.plant, experiment.controller.limits
    return of_plant(
        plant.track.length / 2 if x is None else x,
        v,
        limits.preload if preload is None else preload,
        plant,
        current=current,
        force=force,
        tension_min=limits.tension_min if tension_min is None else tension_min,
        tension_max=limits.tension_max if tension_max is None else tension_max,
    )
