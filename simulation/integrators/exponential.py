"""Exponential integrator made for this plant: exact rope–drum oscillations, located slack, slow forces at mid-step.

Over a sub-step the vehicle has one mean acceleration, rope lengths and slow forces are those at mid-step, and winch
friction is linear about its value at the start. A taut rope and its drum are then a linear oscillator whose flow is
known in closed form, however fast it swings; a slack one flies freely. The impulses of both ropes are linear in the
mean acceleration, which follows from the vehicle's momentum balance. Where a rope goes slack or tight within a
sub-step, that moment is located and the rest of the sub-step follows the other law.

Second order in the sub-step, through slack too. Accurate while a sub-step holds less than a third of an oscillation
(without slack: one), and stable up to two. Not to be confused with a general exponential Runge–Kutta method: it knows
the Kelvin–Voigt rope.
"""

from model.disturbance import vortex_frequency
from model.plant import PlantState, tensions, vehicle_acceleration
from model.rope import Rope, rope_lengths, stiffness
from model.scalar import Scalar, minimum
from model.vehicle import inertia
from model.winch import Winch, friction_slope, friction_torque
from simulation.integrators.oscillator import Oscillator
from simulation.integrators.problem import Motion, Problem


def exponential(problem: Problem, motion: Motion, substeps: int) -> Motion:
    """Motion at the end of the sample."""
    return _advance(problem, motion, substeps, problem.plant.rope_slack)[0]


def exponential_taut(problem: Problem, motion: Motion, substeps: int) -> tuple[Motion, Scalar]:
    """Motion at the end of the sample if no rope goes slack, and a number that is positive where none does.

    There it equals `exponential` to the last bit, at half the cost.
    """
    return _advance(problem, motion, substeps, slack=False)


def _advance(problem: Problem, motion: Motion, substeps: int, slack: bool) -> tuple[Motion, Scalar]:
    h = problem.duration / substeps
    F1, F2 = tensions(motion.plant, problem.plant)
    environment = problem.environment_at(problem.t, motion.plant.v, motion.phase)
    acceleration = vehicle_acceleration(motion.plant.v, F1 - F2, environment, problem.plant.vehicle)
    clearance = 1.0
    for index in range(substeps):
        motion, acceleration, least = _substep(problem, motion, acceleration, problem.t + index * h, h, slack)
        clearance = minimum(clearance, least)
    return motion, clearance


def _substep(
    problem: Problem, motion: Motion, last_acceleration: Scalar, t: Scalar, h: Scalar, slack: bool
) -> tuple[Motion, Scalar, Scalar]:
    """One sub-step of length h from the time t (s).

    Returns:
        The motion after it, the mean acceleration over it in m/s², and the ropes' clearance from going slack.
    """
    plant, state, torques = problem.plant, motion.plant, problem.torques
    middle_x, middle_v = state.x + h / 2 * state.v, state.v + h / 2 * last_acceleration
    frequency = vortex_frequency(middle_v, problem.disturbance, plant.vehicle)
    environment = problem.environment_at(t + h / 2, middle_v, motion.phase + h / 2 * frequency)
    slow = vehicle_acceleration(middle_v, 0.0, environment, plant.vehicle)

    length_1, length_2 = rope_lengths(middle_x, plant.track)
    radius_1, radius_2 = plant.winch_1.drum_radius, plant.winch_2.drum_radius
    rope_1 = _oscillator(
        radius_1 * state.theta_1 - state.x,
        radius_1 * state.omega_1 - state.v,
        -1.0,
        state.omega_1,
        torques.tau_1,
        stiffness(length_1, plant.rope_1),
        plant.rope_1,
        plant.winch_1,
        slack,
        h,
    )
    rope_2 = _oscillator(
        radius_2 * state.theta_2 + state.x,
        radius_2 * state.omega_2 + state.v,
        1.0,
        state.omega_2,
        torques.tau_2,
        stiffness(length_2, plant.rope_2),
        plant.rope_2,
        plant.winch_2,
        slack,
        h,
    )

    # the vehicle's momentum balance: h mass a = h mass slow + impulse_1(a) − impulse_2(a)
    momentum = h * inertia(plant.vehicle)
    (fixed_1, slope_1), (fixed_2, slope_2) = rope_1.impulse(), rope_2.impulse()
    a = (momentum * slow + fixed_1 - fixed_2) / (momentum - slope_1 + slope_2)
    stretch_1, rate_1, impulse_1 = rope_1.end(a)
    stretch_2, rate_2, impulse_2 = rope_2.end(a)

    x, v = state.x + h * (state.v + h / 2 * a), state.v + h * a
    mean = slow + (impulse_1 - impulse_2) / momentum  # differs from a where a rope went slack or tight
    following = PlantState(
        x=x + h**2 / 2 * (mean - a),
        v=v + h * (mean - a),
        theta_1=(stretch_1 + x) / radius_1,
        omega_1=(rate_1 + v) / radius_1,
        theta_2=(stretch_2 - x) / radius_2,
        omega_2=(rate_2 - v) / radius_2,
    )
    clearance = minimum(rope_1.clearance(a), rope_2.clearance(a))
    return Motion(following, motion.phase + h * frequency), mean, clearance


def _oscillator(
    stretch: Scalar,
    rate: Scalar,
    sign: float,
    omega: Scalar,
    torque: Scalar,
    spring: Scalar,
    rope: Rope,
    winch: Winch,
    slack: bool,
    h: Scalar,
) -> Oscillator:
    """One rope and its drum; `sign` is that of the vehicle's position in the stretch."""
    radius, drag = winch.drum_radius, friction_slope(omega, winch) / winch.inertia
    motor = winch.gear_ratio * torque - friction_torque(omega, winch)
    return Oscillator(
        stretch=stretch,
        rate=rate,
        drive=radius / winch.inertia * motor + drag * rate,
        lever=sign * (1 + drag * h / 2),
        spring=spring,
        damper=rope.damping,
        mobility=radius**2 / winch.inertia,
        drag=drag,
        h=h,
        slack=slack,
    )
