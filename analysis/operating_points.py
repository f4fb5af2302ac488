"""Operating points: the plant's, and steady motion of the closed loop without disturbances and sensor errors.

`analysis.steady_motion` solves for the latter.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.steady_motion import LASTING, force_stays, loop_operating_points
from dualwinch.model.arguments import instance, one_number
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_point import OperatingPoint, operating_points, resistance
from dualwinch.model.plant import DisturbanceInputs, Plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.model.ropes import Creep
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import ClosedLoop, closed_loop
from dualwinch.simulation.loop.structure import LoopStructure, parameters_of, structure_of
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.sensors import FAULTS

Floats = NDArray[np.float64]

MANY = "; operating_points of dualwinch.model.linear.operating_point takes arrays"
"""Hint of the error message for more than one number."""


def position_in(experiment: Experiment, x: float | None) -> float:
    """A position in m; default: the middle of an experiment's track.

    Raises:
        ConfigurationError: `experiment` is no experiment.
    """
    instance("experiment", experiment, Experiment, hint=", which includes plant, limits and preload")
    return experiment.plant.track.length / 2 if x is None else x


def operating_point(
    experiment: Experiment,
    x: float | None = None,
    v: float = 0.0,
    *,
    preload: float | None = None,
    current: float = 0.0,
    force: float = 0.0,
    tension_min: float | None = None,
    tension_max: float | None = None,
) -> OperatingPoint:
    """State, torques and tensions with which the vehicle passes x at the constant speed v.

    See `model.linear.operating_point.operating_points` for the distribution of the tensions.

    Args:
        experiment: source of the plant, and of preload and limits unless given.
        x: position in m; default: mid-track.
        v: speed in m/s, -10 to 10; negative: towards winch 2.
        preload: sum of both tensions in N, between twice tension_min and twice tension_max.
        current: ambient current in m/s, constant.
        force: disturbance force in N along the track, constant.
        tension_min: lower limit of a tension in N; 0 lets a rope go slack.
        tension_max: upper limit of a tension in N.

    Raises:
        ConfigurationError: a point off the track, a rope at its shortest length, or a speed, preload or limit out of
            range.

    Example:
        >>> import dualwinch as dw
        >>> point = dw.operating_point(dw.case(4), x=25, v=1.8)
        >>> f"{point.F1:.0f} N and {point.F2:.0f} N"
        '3606 N and 200 N'
    """
    x, limits = position_in(experiment, x), experiment.controller.limits
    coordinates = {"x": x, "v": v, "preload": limits.preload if preload is None else preload}
    return operating_points(
        **{name: one_number(name, value, MANY) for name, value in coordinates.items()},
        plant=experiment.plant,
        current=current,
        force=force,
        tension_min=limits.tension_min if tension_min is None else tension_min,
        tension_max=limits.tension_max if tension_max is None else tension_max,
    )[0]


@dataclass(frozen=True)
class LoopOperatingPoint:
    """An operating point of the closed loop, for linearisation.

    Attributes:
        loop: the closed loop with ropes that never go slack, identical to the original one while they are taut.
        experiment: the experiment, with perfect sensors and no disturbance.
        state, exogenous, parameters: values of the closed loop's vectors.
        row: column → value of the result's row there.
        residual: largest relative change of a state that is not held over a sample beyond the steady motion.
        opened: A, B, C, D of the loop opened at all of `LOOP_OPENINGS`, as in `LoopOperatingPoints.opened`.
        kept_states: indices of its states among those of the closed loop.
    """

    loop: ClosedLoop
    experiment: Experiment
    state: Floats
    exogenous: Floats
    parameters: Floats
    row: dict[str, float]
    residual: float
    opened: tuple[Floats, Floats, Floats, Floats]
    kept_states: NDArray[np.intp]


def loop_operating_point(
    experiment: Experiment, x: float | None, v: float, nominal: Plant | None = None
) -> LoopOperatingPoint:
    """Solve for steady motion through a position in m (None: mid-track) at a speed in m/s; at v = 0 that is rest.

    `nominal` is the plant the controller was designed for, as in a `Scenario`; default: the simulated one.

    Raises:
        ConfigurationError: a position off the track, a speed whose resistance the ropes cannot overcome, or gains
            without steady motion.
    """
    x, v = one_number("x", position_in(experiment, x)), one_number("v", v)
    instance("nominal", nominal, Plant, optional=True)
    calm = in_calm(experiment)
    prepare(calm)
    limits, needed = calm.controller.limits, resistance(v, DisturbanceInputs(), calm.plant, x)
    if not abs(needed) < limits.force:
        raise ConfigurationError(
            f"v = {v:g}: steady motion needs a force of {float(needed):.4g} N, must be within ±{limits.force:g} N "
            "(tension_max - reserve - tension_min)"
        )
    operating_points(x, v, limits.preload, calm.plant, tension_min=limits.tension_min, tension_max=limits.command_max)
    structure = with_taut_ropes(structure_of(calm))
    loop = closed_loop(structure)
    parameters = loop.vector(parameters_of(calm, nominal and still_plant(nominal)))
    motion = loop_operating_points(structure, parameters[None], np.array([x]), np.array([v]), compiled=False)
    kind = calm.controller.law.kind
    if not motion.repeats[0]:
        raise ConfigurationError(f"v = {v:g}: '{kind}' with these gains reaches no steady motion")
    if not force_stays(structure, motion):
        raise ConfigurationError(
            f"v = {v:g}: '{kind}' with these gains reaches no steady motion: its force command changes within "
            f"{LASTING} samples; does a state of law or estimator that moves with the vehicle lack Mark.POSITION?"
        )
    if not motion.steady[0]:
        command, _, *pulls = motion.facts[0].tolist()
        raise ConfigurationError(
            f"v = {v:g}: steady motion of '{kind}' is beyond its limits: force command {command:.4g} N, "
            f"tensions {pulls[0]:.4g} and {pulls[1]:.4g} N"
        )
    state, outside = motion.state[0], motion.outside[0]
    row = dict(zip(loop.columns, np.array(loop.observe(state, outside, parameters)).ravel().tolist(), strict=True))
    row |= {"x": x, "v": v}  # as given, without round-off
    residual = float(motion.residual[0])
    return LoopOperatingPoint(loop, calm, state, outside, parameters, row, residual, motion.opened, motion.kept_states)


def with_taut_ropes(structure: LoopStructure) -> LoopStructure:
    """A structure with ropes that never go slack."""
    return replace(structure, plant=replace(structure.plant, rope_slack=False))


def in_calm(experiment: Experiment) -> Experiment:
    """The experiment without disturbances, sensor errors and anything else that prevents steady motion.

    Motors have no limits, torque commands are not quantised, slow parts of a controller are updated at every sample,
    and its gates pass every measurement; for the plant see `still_plant`.
    """
    # unit noise gives the noise inputs of the linear system the units of the sensors
    sensors = replace(
        experiment.sensors,
        position_noise=1.0,
        position_resolution=0.0,
        position_drift=0.0,
        position_rate=0.0,
        outage_length=0.0,
        speed_noise=1.0,
        tension_noise=1.0,
        encoder_counts=0,
        drum_speed_resolution=0.0,
        **dict.fromkeys(FAULTS, 0.0),
    )
    simulation = replace(experiment.simulation, jitter=0.0, torque_step=0.0)
    described = describe_parts(experiment.controller)
    slow = {key: 1 for key, leaf in described.items() if Mark.INTERVAL in leaf.marks}
    slow |= {key: 0.0 for key, leaf in described.items() if Mark.GATE in leaf.marks}
    return replace(
        experiment,
        controller=with_leaves(experiment.controller, slow),
        plant=still_plant(experiment.plant),
        actuator=experiment.actuator.unlimited(),
        disturbance=Disturbance(),
        sensors=sensors,
        simulation=simulation,
    )


def still_plant(plant: Plant) -> Plant:
    """The plant without effects that prevent steady motion.

    Effects periodic in drum, gear and motor angles (eccentricity, transmission error, ripple), rail waviness and rope
    creep are disturbances of a loop, not part of it. Friction has no memory, as its stored force at rest would be
    arbitrary.
    """
    still = {"eccentricity": 0.0, "torque_ripple": 0.0, "transmission_error": 0.0}
    return replace(
        plant,
        vehicle=replace(plant.vehicle, bristle_stiffness=0.0),
        track=replace(plant.track, waviness=0.0),
        rope_1=replace(plant.rope_1, hysteresis=0.0),
        rope_2=replace(plant.rope_2, hysteresis=0.0),
        winch_1=replace(plant.winch_1, **still),
        winch_2=replace(plant.winch_2, **still),
        creep_1=Creep(),
        creep_2=Creep(),
    )
