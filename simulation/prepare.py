"""Check an experiment's values against each other, and prepare it for running.

Constraints on a single value are declared beside its field.
"""

import math
import os
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.arguments import instance
from dualwinch.model.disturbance import given_signals
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import least_duration
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.tree import check_rules
from dualwinch.model.reference import Reference, cruise_speed, setpoint
from dualwinch.model.ropes import Track
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import ClosedLoop, absent_signals, closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import (
    LoopStructure,
    Solver,
    is_automatic,
    parameters_of,
    solver_of,
    stable_substeps,
    stiffest_mode,
    structure_of,
    zeros_of,
)
from dualwinch.simulation.sensors import delays_beyond_memory

LONGEST = 10**9
"""Maximum number of samples of a run."""


@dataclass(frozen=True, eq=False)
class PreparedExperiment:
    """An experiment with consistent values, and the data needed to run it. Read-only.

    Attributes:
        experiment: the experiment to run.
        nominal: the plant the controller was designed for; None: the simulated one.
        structure: of its closed loop, which determines the compiled code.
        start: state name → initial value.
    """

    experiment: Experiment
    nominal: Plant | None
    structure: LoopStructure
    start: dict[str, float]

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Run-time parameters of the closed loop, by key (`loop.structure.parameters_of`)."""
        return parameters_of(self.experiment, self.nominal)

    @property
    def loop(self) -> ClosedLoop:
        """The closed loop without terms that are always zero, from the cache of graphs, whose size is limited."""
        return closed_loop(self.structure, self._zeros)

    @cached_property
    def _zeros(self) -> frozenset[str]:
        return zeros_of(self.structure, self.parameters) | absent_signals(self.experiment)

    @property
    def state(self) -> NDArray[np.float64]:
        """(states,) initial state, as a new array that may be overwritten."""
        return np.array(list(self.start.values()))


@lru_cache
def prepare(experiment: Experiment, nominal: Plant | None = None) -> PreparedExperiment:
    """Check that an experiment's values are consistent, and prepare it for running.

    `nominal` is the plant the controller was designed for; default: the simulated one.

    Raises:
        ConfigurationError: values are inconsistent; the message names the key and its range.
    """
    instance("experiment", experiment, Experiment)
    check_rules(experiment)
    _check_points(experiment.reference, experiment.plant.track)
    _check_rows(experiment.reference, experiment.plant.track)
    _check_time(experiment)
    _check_signals(experiment)
    _check_delays(experiment)
    if experiment.sensors.speed == "none" and "v" not in experiment.controller.silent:
        raise ConfigurationError(
            'sensors.speed = "none": must be "wheel" for an estimator that reads the speed; Kalman filters do without '
            "it where controller.kalman.speed_sensor = false"
        )
    if experiment.sensors.tension == "none" and "F1" not in experiment.controller.silent:
        raise ConfigurationError(
            'sensors.tension = "none": must be "load-cells" for a controller that reads tensions; it estimates them '
            "where controller.tension_observer.bandwidth > 0 rad/s"
        )
    try:
        _check_reference(experiment)
        check_substeps(experiment, solver_of(experiment))
        structure = structure_of(experiment)
        start = initial_state_of(experiment)
    except ArithmeticError as error:
        raise ConfigurationError("plant, reference: values too extreme to start from (a number overflows)") from error
    if not all(map(math.isfinite, start.values())):
        raise ConfigurationError("plant: values too extreme to start from (no finite initial state)")
    return PreparedExperiment(experiment, nominal, structure, start)


def _check_time(experiment: Experiment) -> None:
    if not 1 <= experiment.duration / experiment.simulation.sample_time <= LONGEST + 0.5:
        raise ConfigurationError(
            f"simulation.duration = {experiment.duration:g}: must be one to {LONGEST:g} sample times "
            f"of {experiment.simulation.sample_time:g} s"
        )


def _check_signals(experiment: Experiment) -> None:
    last = (experiment.samples - 1) * experiment.simulation.sample_time
    for name, (signal, unit) in given_signals(experiment.disturbance).items():
        try:
            signal.check(unit, last)
        except ConfigurationError as error:
            raise ConfigurationError(f"disturbance.{name}: {error}") from error


def _check_delays(experiment: Experiment) -> None:
    sensors, sample_time = experiment.sensors, experiment.simulation.sample_time
    for name, is_beyond in delays_beyond_memory(sensors, sample_time).items():
        if is_beyond:
            delay = getattr(sensors, name)
            raise ConfigurationError(
                f"sensors.{name} = {delay:g}: must be <= {sensors.memory * sample_time:g} s, sensors.memory = "
                f"{sensors.memory} samples; longer ones need sensors.memory >= {math.ceil(delay / sample_time)}"
            )


def _check_points(reference: Reference, track: Track) -> None:
    if reference.kind != "way-points":
        return
    if not any(reference.points):
        raise ConfigurationError("reference.points: must be one position or more, away from 0 m")
    if reference.pauses and len(reference.pauses) != len(reference.points):
        raise ConfigurationError(
            f"reference.pauses: has {len(reference.pauses)} numbers: must have {len(reference.points)}, one a point"
        )
    for index, point in enumerate(reference.points):
        if point > track.length:
            raise ConfigurationError(
                f"reference.points[{index}] = {point:g}: must be <= plant.track.length = {track.length:g} m"
            )


def _check_rows(reference: Reference, track: Track) -> None:
    if reference.kind != "file":
        return
    try:
        motion = reference.recorded
    except ConfigurationError as error:
        raise ConfigurationError(f"reference: {error}".replace("reference: reference.", "reference.")) from error
    off = (motion.x < 0) | (motion.x > track.length)
    if off.any():
        row = int(off.argmax())
        raise ConfigurationError(
            f"reference.file: {reference.file}: x = {motion.x[row]:g} m at t = {motion.t[row]:g} s: must be 0 to "
            f"plant.track.length = {track.length:g} m"
        )


def _check_reference(experiment: Experiment) -> None:
    reference, track = experiment.reference, experiment.plant.track
    if reference.kind == "profile":
        times = (reference.accelerate_until, reference.cruise_until, reference.brake_until)
        if not times[0] <= times[1] < times[2]:
            raise ConfigurationError(
                "reference.accelerate_until, cruise_until, brake_until = "
                f"{times[0]:g}, {times[1]:g}, {times[2]:g}: must be in ascending order"
            )
    if reference.kind in {"uniform", "profile"}:
        _check_jerk(experiment)
    end = _position_at(experiment.duration, reference)
    if end > track.length:
        raise ConfigurationError(
            f"reference.speed, simulation.duration: the reference ends at {end:g} m, "
            f"must be <= plant.track.length = {track.length:g} m"
        )


@lru_cache
def _position_at(t: float, reference: Reference) -> float:
    """Reference position in m; cached, as the scenarios of an ensemble share their reference."""
    return float(setpoint(t, reference).x)


def _check_jerk(experiment: Experiment) -> None:
    reference = experiment.reference
    if reference.jerk_limit is None:
        return
    speed, allowed = cruise_speed(reference), experiment.duration
    if reference.kind == "profile":
        allowed = min(reference.accelerate_until, reference.brake_until - reference.cruise_until)
    if least_duration(speed, reference.jerk_limit) > allowed * (1 + 1e-12):
        raise ConfigurationError(
            f"reference.jerk_limit = {reference.jerk_limit:g}: must be >= {4 * speed / allowed**2:.4g} m/s^3, "
            f"to change the speed by {speed:g} m/s in {allowed:g} s"
        )


def check_substeps(experiment: Experiment, solver: Solver) -> None:
    """Raise `ConfigurationError` if the plant of an experiment needs more sub-steps than a solver has."""
    simulation, plant, limits = experiment.simulation, experiment.plant, experiment.controller.limits
    integrator, substeps = solver
    needed = solver_of(experiment).substeps
    if not is_automatic(experiment):
        needed = stable_substeps(plant, simulation, integrator, limits)
    if substeps < needed:
        raise ConfigurationError(
            f"simulation.substeps = {substeps}: must be >= {needed} for {integrator} at "
            f"simulation.sample_time = {simulation.sample_time:g} s ({stiffest_mode(plant, integrator, limits)})"
        )


def memory_room() -> float:
    """Half of this machine's memory in bytes; infinite where the system does not tell its size."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2 if hasattr(os, "sysconf") else math.inf


def check_memory(samples: int, stride: int, columns: int) -> None:
    """Raise `ConfigurationError` if the rows of a run would take more than half of this machine's memory."""
    bytes_needed = 2 * 8 * columns * samples / stride if stride else 0  # once as rows, once as columns
    if bytes_needed > (room := memory_room()):
        least_stride = math.ceil(stride * bytes_needed / room)
        raise ConfigurationError(
            f"stride = {stride}: must be >= {least_stride}, to keep the rows of {samples} samples within half of the "
            "memory"
        )
