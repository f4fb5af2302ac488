"""The plant and one Runge–Kutta step of it."""

from math import pi, sin, tanh
from typing import NamedTuple, TypeAlias

from benchmarks.by_hand.compilable import compilable
from benchmarks.by_hand.parameters import Parameters

Motion: TypeAlias = tuple[float, float, float, float, float, float]
"""x, v, theta_1, omega_1, theta_2, omega_2."""


class Constants(NamedTuple):
    """What the plant's equations need of the parameters, worked out once."""

    stiffness_1: float
    stiffness_2: float
    damping_1: float
    damping_2: float
    radius_1: float
    radius_2: float
    longest_1: float
    rope_offset: float
    friction: float
    per_friction_velocity: float
    drag: float
    vortex: float
    shedding: float
    per_mass: float
    drive_1: float
    load_1: float
    drive_2: float
    load_2: float


@compilable
def constants(p: Parameters) -> Constants:
    """Work out the plant's constants."""
    return Constants(
        stiffness_1=p.modulus_1 * p.area_1,
        stiffness_2=p.modulus_2 * p.area_2,
        damping_1=p.damping_1,
        damping_2=p.damping_2,
        radius_1=p.drum_radius_1,
        radius_2=p.drum_radius_2,
        longest_1=p.track_length + p.rope_offset,
        rope_offset=p.rope_offset,
        friction=p.friction_coefficient * p.normal_force,
        per_friction_velocity=1 / p.friction_velocity,
        drag=0.5 * p.drag_coefficient * p.water_density * p.drag_area,
        vortex=p.vortex * p.vortex_amplitude,
        shedding=2 * pi * p.strouhal / p.diameter,
        per_mass=1 / (p.mass + p.added_mass),
        drive_1=p.gear_ratio_1 / p.inertia_1,
        load_1=p.drum_radius_1 / p.inertia_1,
        drive_2=p.gear_ratio_2 / p.inertia_2,
        load_2=p.drum_radius_2 / p.inertia_2,
    )


@compilable
def tensions(motion: Motion, c: Constants) -> tuple[float, float]:
    """Tensions of both ropes in N."""
    x, v, theta_1, omega_1, theta_2, omega_2 = motion
    stretch_1, stretch_2 = c.radius_1 * theta_1 - x, c.radius_2 * theta_2 + x
    length_1, length_2 = max(c.longest_1 - x, 0.05), max(x + c.rope_offset, 0.05)
    pull_1 = c.stiffness_1 / length_1 * stretch_1 + c.damping_1 * (c.radius_1 * omega_1 - v)
    pull_2 = c.stiffness_2 / length_2 * stretch_2 + c.damping_2 * (c.radius_2 * omega_2 + v)
    F1 = pull_1 if stretch_1 > 0 and pull_1 > 0 else 0.0
    F2 = pull_2 if stretch_2 > 0 and pull_2 > 0 else 0.0
    return F1, F2


@compilable
def derivative(t: float, motion: Motion, tau_1: float, tau_2: float, c: Constants) -> Motion:
    """Time derivative of the plant's state."""
    F1, F2 = tensions(motion, c)
    v = motion[1]
    friction = c.friction * tanh(v * c.per_friction_velocity)
    drag = c.drag * v * abs(v)
    vortex = c.vortex * drag * sin(c.shedding * v * t)
    return (
        v,
        (F1 - F2 - friction - drag + vortex) * c.per_mass,
        motion[3],
        c.drive_1 * tau_1 - c.load_1 * F1,
        motion[5],
        c.drive_2 * tau_2 - c.load_2 * F2,
    )


@compilable
def along(start: Motion, slope: Motion, h: float) -> Motion:
    """Where a slope leads in the time h in s."""
    return (
        start[0] + h * slope[0],
        start[1] + h * slope[1],
        start[2] + h * slope[2],
        start[3] + h * slope[3],
        start[4] + h * slope[4],
        start[5] + h * slope[5],
    )


@compilable
def rk4(t: float, start: Motion, tau_1: float, tau_2: float, h: float, c: Constants) -> Motion:
    """One step of the classical Runge–Kutta method."""
    k1 = derivative(t, start, tau_1, tau_2, c)
    k2 = derivative(t + h / 2, along(start, k1, h / 2), tau_1, tau_2, c)
    k3 = derivative(t + h / 2, along(start, k2, h / 2), tau_1, tau_2, c)
    k4 = derivative(t + h, along(start, k3, h), tau_1, tau_2, c)
    mean = (
        k1[0] + 2 * (k2[0] + k3[0]) + k4[0],
        k1[1] + 2 * (k2[1] + k3[1]) + k4[1],
        k1[2] + 2 * (k2[2] + k3[2]) + k4[2],
        k1[3] + 2 * (k2[3] + k3[3]) + k4[3],
        k1[4] + 2 * (k2[4] + k3[4]) + k4[4],
        k1[5] + 2 * (k2[5] + k3[5]) + k4[5],
    )
    return along(start, mean, h / 6)
