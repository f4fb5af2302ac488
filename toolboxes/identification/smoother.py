"""Disturbance smoother: the unrecorded force on the vehicle, estimated at each time from all readings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import Quantity, Signal, file_formats, leaves, physics
from dualwinch.toolboxes.identification.estimate import ParameterEstimate, PredictionErrorMethod
from dualwinch.toolboxes.identification.log import Log
from dualwinch.toolboxes.identification.predictor import DISTURBANCES, per_coefficient, state_template
from dualwinch.toolboxes.identification.resample import sections_of

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SmoothedForce:
    """An unrecorded force over the time of a log.

    Attributes:
        log: its name.
        t: (n,) in s.
        force: (n,) in N: the force on the vehicle equivalent to all unrecorded disturbances, current and changes of the
            rail load included; without vortices, which are part of the model.
        deviation: (n,) standard deviation in N, given the estimated parameters.
    """

    log: str
    t: Floats
    force: Floats
    deviation: Floats

    @property
    def signal(self) -> Signal:
        """For ``disturbance.force``; it includes current and changes of the rail load."""
        return Signal.from_arrays(self.t, self.force, unit="N")

    @property
    def content(self) -> file_formats.FileContent:
        """Content of a file."""
        quantities = {"t": Quantity("s", "time"), "force": Quantity("N", "force on the vehicle along the track")}
        return file_formats.FileContent({"t": self.t, "force": self.force}, quantities, {"log": self.log})


def smoothed_force(method: PredictionErrorMethod, log: Log, estimate: ParameterEstimate) -> SmoothedForce:
    """Estimate the unrecorded force on the vehicle over a log, by the modified Bryson–Frazier smoother."""
    experiment = estimate.experiment
    filters = method.filters_of(sections_of([log], experiment, method.options.resampling, standstill=True))
    ((states, smoothed, covariances),) = filters.smooth(experiment, estimate.noise)
    (section,), vehicle, change = filters.sections, experiment.plant.vehicle, float(np.finfo(float).eps ** 0.5)
    fading = estimate.noise.process["force"].time / experiment.simulation.sample_time
    rows = slice(None, None, max(1, round(fading / 100)))  # a hundred rows for the time in which a force fades
    v = states[rows, list(leaves(state_template(method.structure))).index("motion.plant.v")]
    by = per_coefficient(vehicle)
    current, load, force = (smoothed[rows, DISTURBANCES.index(name)] for name in DISTURBANCES[:3])

    def resistance(current: Floats, load: Floats) -> Floats:
        current, load = by["current"] * current, by["normal_force_variation"] * load
        pairs = zip(v.tolist(), current.tolist(), load.tolist(), strict=True)
        return np.array(
            [physics.friction(v, vehicle, load) + physics.drag(v - current, vehicle) for v, current, load in pairs],
            float,
        )

    none = np.zeros_like(v)
    here = resistance(current, load)
    slopes = np.column_stack([
        (here - resistance(current + change, load)) / change, here - resistance(current, load + 1), none + 1,
    ])  # fmt: skip
    variance = np.einsum("ki,kij,kj->k", slopes, covariances[rows, :3, :3], slopes)
    return SmoothedForce(
        log=log.name,
        t=section.inputs[rows, 0],
        force=force + resistance(none, none) - here,
        deviation=np.sqrt(np.maximum(variance, 0.0)),
    )
