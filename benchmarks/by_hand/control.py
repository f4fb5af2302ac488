"""One sample of the controller and of the figures of merit."""

from math import exp, tanh
from typing import Any, NamedTuple

from benchmarks.by_hand.compilable import compilable
from benchmarks.by_hand.parameters import Parameters
from benchmarks.by_hand.plant import Constants, Motion, tensions
from dualwinch.simulation.metrics.metrics import Accumulators


class Memory(NamedTuple):
    """State of the controller."""

    Z_a: float
    d_hat: float
    filtered: float
    e2_previous: float
    a_previous: float
    integral_1: float
    integral_2: float


class Sums(NamedTuple):
    """Running sums behind the figures of merit, in the order of `simulation.metrics.metrics.Accumulators`."""

    sum_abs: float
    max_abs: float
    sum_square: float
    steady_samples: float
    steady_sum_abs: float
    steady_max_abs: float
    steady_sum_square: float
    saturated: float
    torque_saturated: float
    slack: float
    peak: float
    least: float
    sum_change: float
    F1_previous: float
    F2_previous: float
    work: float
    sum_torque_rate: float
    sum_torque_square: float
    tau_1_previous: float
    tau_2_previous: float


IDLE = Memory(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""The controller before the first sample."""

NOTHING = Sums(**vars(Accumulators()))
"""The sums before the first sample."""

RULES = (
    (1.0, 1.0, 1.0, 1.0, 1.0),
    (0.75, 0.5, 0.5, 0.5, 0.75),
    (0.5, 0.25, 0.0, 0.25, 0.5),
    (0.75, 0.5, 0.5, 0.5, 0.75),
    (1.0, 1.0, 1.0, 1.0, 1.0),
)
"""Singletons of the fuzzy rules."""


@compilable
def clip(value: float, lower: float, upper: float) -> float:
    """The value, limited to [lower, upper]."""
    return min(max(value, lower), upper)


@compilable
def fuzzy(error: float, rate: float) -> float:
    """Triangular labels with product inference: a bilinear interpolation in the rule table."""
    a, b = 2 * (clip(error, -1.0, 1.0) + 1), 2 * (clip(rate, -1.0, 1.0) + 1)
    i, j = min(int(a), 3), min(int(b), 3)
    a -= i
    b -= j
    return (1 - a) * ((1 - b) * RULES[i][j] + b * RULES[i][j + 1]) + a * (
        (1 - b) * RULES[i + 1][j] + b * RULES[i + 1][j + 1]
    )


@compilable
def winch(
    command: float,
    tension: float,
    alpha: float,
    to_torque: float,
    swing: float,
    kp: float,
    ki: float,
    integral: float,
    p: Parameters,
) -> tuple[float, float, float]:
    """Motor torque in N m, the integral for the next sample and 1 where the torque is at its limit."""
    error = command - tension
    following = integral + p.sample_time * error
    wanted = to_torque * command + swing * alpha + kp * error + ki * following
    torque = clip(wanted, to_torque * p.tension_min, to_torque * p.tension_max)
    return (torque, following, 0.0) if torque == wanted else (torque, integral, 1.0)


@compilable
def control(
    k: int, motion: Motion, reference: Any, memory: Memory, sums: Sums, p: Parameters, c: Constants
) -> tuple[float, float, Memory, Sums]:
    """One sample of the whole controller and of the figures of merit.

    Args:
        k: number of the sample.
        motion: the plant's state.
        reference: position, speed, acceleration and the flag of the steady state, (4,).
        memory: the controller's state.
        sums: running sums so far.
        p: parameters.
        c: constants of the plant.

    Returns:
        Both motor torques in N m, the next controller state and sums.
    """
    v, a_ref, steady = motion[1], reference[2], reference[3]
    F1, F2 = tensions(motion, c)
    e1, e2 = motion[0] - reference[0], v - reference[1]

    d_tilde = (e2 - memory.e2_previous) / p.sample_time - memory.a_previous - memory.d_hat if k > 0 else 0.0
    change = p.sample_time / (p.filter_time + p.sample_time) * (d_tilde - memory.filtered)
    filtered = memory.filtered + change
    L1 = p.l0 + p.kf * fuzzy(filtered / p.error_scale, change / p.sample_time / p.rate_scale)
    d_hat = memory.d_hat + (1 - exp(-L1 * p.sample_time)) * d_tilde

    mass = p.nominal_mass + p.nominal_added_mass
    drag = 0.5 * p.nominal_drag_coefficient * p.water_density * p.drag_area
    resistance = p.nominal_friction_coefficient * p.normal_force * tanh(v * c.per_friction_velocity)
    resistance += drag * v * abs(v)
    ratio, smooth, z = p.p / p.q, p.smoothing * p.smoothing, e2 + p.gamma * memory.Z_a
    surface = e1 + z * (z * z + smooth) ** ((ratio - 1) / 2) / p.beta
    terminal = p.beta / ratio * e2 * (e2 * e2 + smooth) ** ((1 - ratio) / 2)
    reaching = p.eta * surface + p.k * clip(surface / p.phi, -1.0, 1.0)
    u = mass * (a_ref - terminal - reaching - d_hat) + resistance - p.gamma_force * memory.Z_a
    limit = p.tension_max - p.tension_min
    u_sat = clip(u, -limit, limit)

    wanted_1, wanted_2 = (p.preload + u_sat) / 2, (p.preload - u_sat) / 2
    excess_1 = clip(wanted_1, p.tension_min, p.tension_max) - wanted_1
    excess_2 = clip(wanted_2, p.tension_min, p.tension_max) - wanted_2
    command_1 = clip(wanted_1 + excess_2, p.tension_min, p.tension_max)
    command_2 = clip(wanted_2 + excess_1, p.tension_min, p.tension_max)
    to_torque_1, to_torque_2 = p.drum_radius_1 / p.gear_ratio_1, p.drum_radius_2 / p.gear_ratio_2
    alpha_1, alpha_2 = a_ref / p.drum_radius_1, -a_ref / p.drum_radius_2
    swing_1, swing_2 = p.inertia_1 / p.gear_ratio_1, p.inertia_2 / p.gear_ratio_2
    tau_1, integral_1, limited_1 = winch(
        command=command_1,
        tension=F1,
        alpha=alpha_1,
        to_torque=to_torque_1,
        swing=swing_1,
        kp=p.kp_1,
        ki=p.ki_1,
        integral=memory.integral_1,
        p=p,
    )
    tau_2, integral_2, limited_2 = winch(
        command=command_2,
        tension=F2,
        alpha=alpha_2,
        to_torque=to_torque_2,
        swing=swing_2,
        kp=p.kp_2,
        ki=p.ki_2,
        integral=memory.integral_2,
        p=p,
    )

    size, square = abs(e1), e1 * e1
    saturated, slack = 1.0 if u_sat != u else 0.0, 1.0 if F1 <= 0 or F2 <= 0 else 0.0
    jump = abs(F1 - sums.F1_previous) + abs(F2 - sums.F2_previous) if k > 0 else 0.0
    turn = abs(tau_1 - sums.tau_1_previous) + abs(tau_2 - sums.tau_2_previous) if k > 0 else 0.0
    power = abs(p.gear_ratio_1 * tau_1 * motion[3]) + abs(p.gear_ratio_2 * tau_2 * motion[5])
    following = Memory(
        Z_a=memory.Z_a + p.sample_time * (-p.k_a * memory.Z_a + (u - u_sat)),
        d_hat=d_hat,
        filtered=filtered,
        e2_previous=e2,
        a_previous=(u_sat - resistance) / mass - a_ref,
        integral_1=integral_1,
        integral_2=integral_2,
    )
    summed = Sums(
        sum_abs=sums.sum_abs + size,
        max_abs=max(sums.max_abs, size),
        sum_square=sums.sum_square + square,
        steady_samples=sums.steady_samples + steady,
        steady_sum_abs=sums.steady_sum_abs + steady * size,
        steady_max_abs=max(sums.steady_max_abs, steady * size),
        steady_sum_square=sums.steady_sum_square + steady * square,
        saturated=sums.saturated + saturated,
        torque_saturated=sums.torque_saturated + max(limited_1, limited_2),
        slack=sums.slack + slack,
        peak=max(sums.peak, F1, F2),
        least=min(sums.least, F1, F2),
        sum_change=sums.sum_change + jump,
        F1_previous=F1,
        F2_previous=F2,
        work=sums.work + p.sample_time * power,
        sum_torque_rate=sums.sum_torque_rate + turn / p.sample_time,
        sum_torque_square=sums.sum_torque_square + tau_1 * tau_1 + tau_2 * tau_2,
        tau_1_previous=tau_1,
        tau_2_previous=tau_2,
    )
    return tau_1, tau_2, following, summed
