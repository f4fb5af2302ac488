"""The least tracking error that any controller with the sensors of an ensemble can have: a Kalman bound.

A controller knows the position no better than the best filter does. What the filter estimates here is the deviation
from the reference; what deviates are the current, the load on the rail, and constants that are drawn once a machine:
mass, drag, friction, drum radii, encoder zeros, ropes' moduli, what winches give, the scale of the speed wheel. All
else is known to it, the forces of the ropes, vortices, sags and delays among it, and whatever it wants to do is done
at once. So the covariance of the time-varying Kalman filter (Kalman and Bucy, Journal of Basic Engineering 83, 1961)
is a lower bound of every controller's error.

``python -m benchmarks.least_error`` prints a row for each ensemble; ``--write FILE`` puts them between the marks.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import dualwinch
from benchmarks.document import command, markdown, publish
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.ropes import rope_lengths
from dualwinch.model.vehicle import drag
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.sensors import encoder_step

Floats = NDArray[np.float64]

SIDES = (1, 2)


@dataclass(frozen=True)
class Nominal:
    """Nominal values and deviations of an ensemble's machines.

    Attributes:
        ensemble: of machines.
    """

    ensemble: Ensemble

    def value(self, key: str) -> float:
        """The nominal value."""
        return float(leaves(self.ensemble.experiment)[key])

    def deviation(self, key: str, scale: float = 1.0) -> float:
        """Standard deviation of a value over the machines, as of a uniform distribution over its range."""
        drawn = self.ensemble.distributions.get(key)
        if drawn is None:
            return 0.0
        lower, upper = (scale * float(each) for each in drawn.ends(self.value(key)))
        return abs(upper - lower) / np.sqrt(12)

    def share(self, key: str) -> float:
        """The same, over the nominal value."""
        return self.deviation(key) / self.value(key) if self.value(key) else 0.0


def least_error(ensemble: Ensemble, samples: int = 10) -> tuple[float, float]:
    """RMS in m of the position's deviation over a run, and over its second half.

    Args:
        ensemble: of machines.
        samples: of 1 ms, whose noise is averaged, in one step of the filter.
    """
    known, experiment = Nominal(ensemble), ensemble.experiment
    plant, vehicle = experiment.plant, experiment.plant.vehicle
    trajectory = dualwinch.simulate(dualwinch.case(4))
    step = 1e-3 * samples
    x, v, a = (trajectory[name][::samples] for name in ("x_ref", "v_ref", "a_ref"))
    tensions = [trajectory[f"F{side}"][::samples] for side in SIDES]
    lengths = rope_lengths(x, plant.track)
    counted = float(encoder_step(plant.winch_1.gear_ratio, experiment.sensors))
    noise = (
        np.hypot(known.value("sensors.position_noise"), known.value("sensors.position_resolution") / np.sqrt(12)),
        known.value("sensors.speed_noise"),
        *(plant.winch_1.drum_radius * counted / np.sqrt(12),) * 2,
    )
    measured = np.diag(np.maximum(np.array(noise) ** 2, 1e-14) / samples)

    friction = vehicle.friction_coefficient * vehicle.normal_force
    processes = (  # what changes: its standard deviation and correlation time
        (known.value("disturbance.current_sigma"), known.value("disturbance.current_time")),
        (known.value("disturbance.normal_force_sigma"), known.value("disturbance.normal_force_time")),
        (known.value("sensors.position_drift"), known.value("sensors.position_drift_time")),
    )
    constants = np.array(
        [
            known.share("plant.vehicle.mass"),
            known.share("plant.vehicle.drag_coefficient"),
            known.share("plant.vehicle.friction_coefficient"),
            known.deviation("sensors.speed_error"),
            *(known.deviation(f"sensors.encoder_zero_{side}") for side in SIDES),
            *(known.deviation(f"plant.winch_{side}.radius_error") for side in SIDES),
            *(known.share(f"plant.rope_{side}.modulus") for side in SIDES),
            *(_give(known, side) for side in SIDES),
        ]
    )
    size, first = 2 + len(processes) + len(constants), 2 + len(processes)
    covariance = np.diag(np.r_[0.0, 0.0, [sigma**2 for sigma, _ in processes], constants**2])
    covariance[4, 4] = 0.0  # errors are counted in the sensor's frame as it is at the beginning
    transition, driven = np.eye(size), np.zeros(size)
    transition[0, 1] = step
    for row, (sigma, time) in enumerate(processes, start=2):
        left = np.exp(-step / time) if time else 1.0
        transition[row, row], driven[row] = left, sigma**2 * (1 - left**2)
    read = np.zeros((4, size))
    read[0, [0, 4]] = read[1, 1] = read[2, 0] = read[3, 0] = 1.0
    squares = np.empty(len(x))
    for now in range(len(x)):
        moving, pull = np.tanh(v[now] / vehicle.friction_velocity), step / vehicle.mass
        transition[1, 2:5] = 2 * drag(v[now], vehicle) / max(v[now], 1e-6) * pull, -friction * moving * pull, 0.0
        transition[1, first : first + 3] = (
            -step * a[now],
            -drag(v[now], vehicle) * pull,
            -friction * moving * pull,
        )
        read[1, first + 3] = v[now]
        for side in (0, 1):
            stiffness = known.value(f"plant.rope_{side + 1}.modulus") * known.value(f"plant.rope_{side + 1}.area")
            stretch = tensions[side][now] * lengths[side][now] / stiffness
            read[2 + side, first + 4 + side :: 2] = [1.0, float(x[now]), float(stretch), float(tensions[side][now])]
        gain = np.linalg.solve(read @ covariance @ read.T + measured, read @ covariance).T
        kept = np.eye(size) - gain @ read  # Joseph's form, which keeps a covariance one
        covariance = kept @ covariance @ kept.T + gain @ measured @ gain.T
        squares[now] = covariance[0, 0]
        covariance = transition @ covariance @ transition.T + np.diag(driven)
    half = len(x) // 2
    return float(np.sqrt(squares.mean())), float(np.sqrt(squares[half:].mean()))


def _give(known: Nominal, side: int) -> float:
    """Standard deviation of the rope in m that a winch gives a newton of tension."""
    drawn = known.ensemble.distributions.get(f"plant.winch_{side}.gear_stiffness")
    if drawn is None:
        return 0.0
    radius = known.value(f"plant.winch_{side}.drum_radius")
    lower, upper = (radius**2 / float(each) for each in drawn.ends(known.value(f"plant.winch_{side}.gear_stiffness")))
    return abs(upper - lower) / np.sqrt(12)


def table() -> str:
    """A row for each built-in ensemble."""
    rows = []
    for name in ("sea", "rig", "site"):
        whole, half = least_error(dualwinch.load_ensemble(name))
        rows.append([f"`{name}`", f"{1e3 * whole:.3f}", f"{1e3 * half:.3f}"])
    return markdown(["ensemble", "whole run, RMS (mm)", "second half (mm)"], rows)


def main(arguments: list[str] | None = None) -> None:
    """Print or write the table."""
    publish(command(__doc__).parse_args(arguments).write, {"least error": table()})


if __name__ == "__main__":
    main()
