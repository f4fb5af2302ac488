"""Right-hand side of the plant in floats, written per rope mode so that a stiff solver sees a smooth function."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, exp, pi, sin, tanh
from types import SimpleNamespace

from scipy.optimize import root_scalar

from tests.oracle.values import Values, group

Triple = tuple[float, float, float]
"""Vehicle, drum 1, drum 2: positions (m, rad, rad), speeds or accelerations."""

Taut = tuple[bool, bool]
"""Whether rope 1 and rope 2 pull."""

Law = Callable[[float, float, float], float]
"""Pull of a two-sided rope in N from stretch in m, its rate in m/s and length in m."""

STRONG = 6000.0
"""Tension in N at which a rope of a law of its own is taken for a spring."""

Gates = tuple[float, float]
"""One number a rope: positive where it should be taut."""


@dataclass(frozen=True)
class Hold:
    """What stays constant between two samples: motor torques (N m), current (m/s), rail-load change (N)."""

    tau_1: float
    tau_2: float
    current: float = 0.0
    load: float = 0.0


class Plant:
    """Vehicle, two ropes, two winches.

    ``motion(t, position, speed, hold, taut)`` gives the accelerations with the ropes' modes held, and the gates. Both
    ropes are Kelvin–Voigt ones, or of the law that is given.
    """

    def __init__(self, values: Values, law: Law | None = None) -> None:
        self.vehicle = group(values, "plant.vehicle.")
        self.track = group(values, "plant.track.")
        self.rope_1, self.rope_2 = group(values, "plant.rope_1."), group(values, "plant.rope_2.")
        self.winch_1, self.winch_2 = group(values, "plant.winch_1."), group(values, "plant.winch_2.")
        self.drums = _Drum(self.winch_1), _Drum(self.winch_2)
        self.creep = group(values, "plant.creep_1."), group(values, "plant.creep_2.")
        self.vortex = group(values, "disturbance.")
        self.slack, self.law = bool(values["plant.rope_slack"]), law
        self.motion = _motion(self)

    def lengths(self, x: float) -> tuple[float, float]:
        """Free lengths of both ropes."""
        offset = self.track.rope_offset
        return max(self.track.length - x + offset, 0.05), max(x + offset, 0.05)

    def stiffnesses(self, x: float) -> tuple[float, float]:
        """Spring rates of both ropes."""
        length_1, length_2 = self.lengths(x)
        if self.law is not None:
            return _spring(self.law, length_1), _spring(self.law, length_2)
        return (
            self.rope_1.modulus * self.rope_1.area / length_1,
            self.rope_2.modulus * self.rope_2.area / length_2,
        )

    def pulls(self, x: float, stretch_1: float, rate_1: float, stretch_2: float, rate_2: float) -> tuple[float, float]:
        """What two-sided ropes pull."""
        if self.law is not None:
            length_1, length_2 = self.lengths(x)
            return self.law(stretch_1, rate_1, length_1), self.law(stretch_2, rate_2, length_2)
        k_1, k_2 = self.stiffnesses(x)
        return k_1 * stretch_1 + self.rope_1.damping * rate_1, k_2 * stretch_2 + self.rope_2.damping * rate_2

    def tensions(self, position: Triple, speed: Triple, t: float = 0.0) -> tuple[float, float]:
        """Tensions that two-sided ropes would have, cut where the ropes hang loose."""
        stretch_1, stretch_2, rate_1, rate_2 = _stretches(self, position, speed, t)
        pull_1, pull_2 = self.pulls(position[0], stretch_1, rate_1, stretch_2, rate_2)
        if self.slack:
            pull_1 = pull_1 if stretch_1 > 0 and pull_1 > 0 else 0.0
            pull_2 = pull_2 if stretch_2 > 0 and pull_2 > 0 else 0.0
        return pull_1, pull_2

    def taut(self, position: Triple, speed: Triple, t: float = 0.0) -> Taut:
        """The ropes' modes."""
        tension_1, tension_2 = self.tensions(position, speed, t)
        return not self.slack or tension_1 > 0, not self.slack or tension_2 > 0

    def at_rest(self, preload: float, x: float = 0.0) -> tuple[Triple, Triple]:
        """Position and speed at x with both ropes at tension preload/2."""
        if self.law is not None:
            stretch_1, stretch_2 = (_stretch(self.law, preload / 2, length) for length in self.lengths(x))
        else:
            stretch_1, stretch_2 = (preload / 2 / k for k in self.stiffnesses(x))
        drum_1, drum_2 = self.drums
        return (x, drum_1.angle(stretch_1 + x), drum_2.angle(stretch_2 - x)), (0.0, 0.0, 0.0)

    def given(self, torques: Sequence[float], position: Triple, speed: Triple, duration: float) -> list[float]:
        """What the motors give, all through a sample, instead of the torques they are asked for."""
        gains = []
        for number, winch in enumerate((self.winch_1, self.winch_2), start=1):
            turned = position[number] + speed[number] * duration / 2
            wave = sin(winch.ripple_angle + winch.ripple_waves * winch.gear_ratio * turned)
            gains.append(1 + winch.torque_error + winch.torque_ripple * wave)
        return [torque * gain for torque, gain in zip(torques, gains, strict=True)]

    def on_track(self, x: float) -> bool:
        """Whether the vehicle has not left the track."""
        overrun = self.track.rope_offset / 2
        return -overrun <= x <= self.track.length + overrun


def _stretch(law: Law, tension: float, length: float) -> float:
    return root_scalar(lambda s: law(s, 0.0, length) - tension, bracket=(0.0, length), method="brentq", xtol=1e-16).root


def _spring(law: Law, length: float) -> float:
    stretch = _stretch(law, STRONG, length)
    return (law(1.001 * stretch, 0.0, length) - law(0.999 * stretch, 0.0, length)) / (0.002 * stretch)


class _Drum:
    """A drum that may be larger than it should be, eccentric, and grow with its rope."""

    def __init__(self, winch: SimpleNamespace) -> None:
        self.true = winch.drum_radius + winch.radius_error * winch.drum_radius
        self.spiral = winch.layer_thickness / winch.layer_laps / (2 * pi)
        self.offset, self.ahead = winch.eccentricity, winch.eccentricity_angle

    def rope(self, theta: float) -> float:
        """The integral of the radius."""
        run_out = self.offset * (sin(theta + self.ahead) - sin(self.ahead))
        return self.true * theta + self.spiral * theta * theta / 2 + run_out

    def radius(self, theta: float) -> float:
        """Where the rope leaves the drum."""
        return self.true + self.spiral * theta + self.offset * cos(theta + self.ahead)

    def angle(self, rope: float) -> float:
        """The angle with so much rope."""
        around = rope / self.true
        return root_scalar(lambda theta: self.rope(theta) - rope, x0=around, x1=around + 0.01, xtol=1e-15).root


def _stretches(plant: Plant, position: Triple, speed: Triple, t: float) -> tuple[float, float, float, float]:
    (x, theta_1, theta_2), (v, omega_1, omega_2) = position, speed
    (drum_1, drum_2), (longer_1, longer_2) = plant.drums, (_longer(creep, t) for creep in plant.creep)
    longing_1, longing_2 = ((creep.elongation - _longer(creep, t)) / creep.time for creep in plant.creep)
    return (
        drum_1.rope(theta_1) - x - longer_1,
        drum_2.rope(theta_2) + x - longer_2,
        drum_1.radius(theta_1) * omega_1 - v - longing_1,
        drum_2.radius(theta_2) * omega_2 + v - longing_2,
    )


def _longer(creep: SimpleNamespace, t: float) -> float:
    return creep.elongation - creep.elongation * exp(-t / creep.time)


def _winch(winch: SimpleNamespace, drum: _Drum) -> Callable[[float, float, float, float], float]:
    inertia, ratio = winch.inertia, winch.gear_ratio
    coulomb, viscous = winch.coulomb_friction, winch.viscous_friction

    def acceleration(torque: float, force: float, theta: float, omega: float) -> float:
        opposing = drum.radius(theta) * force + coulomb * tanh(omega / 0.01) + viscous * omega
        return (ratio * torque - opposing) / inertia

    return acceleration


def _resistance(vehicle: SimpleNamespace, vortex: SimpleNamespace) -> Callable[..., float]:
    drag_factor = 0.5 * vehicle.drag_coefficient * vehicle.water_density * vehicle.drag_area
    friction, load_0, scale = vehicle.friction_coefficient, vehicle.normal_force, vehicle.friction_velocity
    shedding, share = bool(vortex.vortex), vortex.vortex_amplitude
    by_way, wave = bool(vortex.integrated_phase), 2 * pi * vortex.strouhal / vehicle.diameter

    def force(t: float, x: float, v: float, current: float, load: float) -> float:
        through_water = v - current
        total = friction * (load_0 + load) * tanh(v / scale) + drag_factor * through_water * abs(through_water)
        if shedding:  # the integral of the shedding frequency grows with the way: no state is needed
            total -= share * drag_factor * v * abs(v) * sin(wave * (x if by_way else v * t))
        return total

    return force


def _motion(plant: Plant) -> Callable[[float, Triple, Triple, Hold, Taut], tuple[Triple, Gates]]:
    mass = plant.vehicle.mass + plant.vehicle.added_mass
    resistance = _resistance(plant.vehicle, plant.vortex)
    winch_1, winch_2 = _winch(plant.winch_1, plant.drums[0]), _winch(plant.winch_2, plant.drums[1])
    pulls = plant.pulls

    def motion(t: float, position: Triple, speed: Triple, hold: Hold, taut: Taut) -> tuple[Triple, Gates]:
        x, theta_1, theta_2 = position
        v, omega_1, omega_2 = speed
        stretch_1, stretch_2, rate_1, rate_2 = _stretches(plant, position, speed, t)
        pull_1, pull_2 = pulls(x, stretch_1, rate_1, stretch_2, rate_2)
        force_1, force_2 = pull_1 if taut[0] else 0.0, pull_2 if taut[1] else 0.0
        net = force_1 - force_2 - resistance(t, x, v, hold.current, hold.load)
        accelerations = (
            net / mass,
            winch_1(hold.tau_1, force_1, theta_1, omega_1),
            winch_2(hold.tau_2, force_2, theta_2, omega_2),
        )
        return accelerations, (min(stretch_1, pull_1), min(stretch_2, pull_2))

    return motion
