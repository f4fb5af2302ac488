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
from model.plant import PlantState, vehicle_acceleration
from model.rope import Rope, rope_lengths
from model.scalar import Scalar, minimum, reciprocals
from model.vehicle import inertia
from model.winch import Winch, friction_slope, friction_torque
from simulation.integrators.oscillator import Oscillator
from simulation.integrators.problem import Motion, Problem


def exponential(problem: Problem, motion: Motion, t: Scalar, h: Scalar) -> Motion:
    """Motion after a step of length h in s from the time t in s."""
    return exponential_step(problem, motion, t, h, slack=problem.plant.rope_slack)[0]


def _slow_acceleration(problem: Problem, t: Scalar, v: Scalar, phase: Scalar) -> Scalar:
    """Acceleration of the vehicle in m/s² by everything but the ropes."""
    return vehicle_acceleration(v, 0.0, problem.environment_at(t, v, phase), problem.plant.vehicle)


def exponential_step(problem: Problem, motion: Motion, t: Scalar, h: Scalar, *, slack: bool) -> tuple[Motion, Scalar]:
    """The motion after one step, and a number that is positive only if taut ropes stay taut all through it.

    The speed at mid-step, where the slow acceleration is taken, follows from that of the last step.

    Args:
        problem: what is solved.
        motion: at the beginning of the step.
        t: time of its beginning in s.
        h: its length in s.
        slack: whether ropes can go slack; without, the result holds where the number is positive.
    """
    plant, state = problem.plant, motion.plant
    rope_1, rope_2 = _oscillators(problem, state, h, slack)
    (fixed_1, slope_1), (fixed_2, slope_2) = rope_1.impulse(), rope_2.impulse()
    momentum = h * inertia(plant.vehicle)

    yielding = 1 / (momentum - slope_1 + slope_2)
    by_ropes, share = (fixed_1 - fixed_2) * yielding, momentum * yielding

    def mean_acceleration(slow: Scalar) -> Scalar:
        """From the vehicle's momentum balance: h mass a = h mass slow + impulse_1(a) − impulse_2(a)."""
        return by_ropes + share * slow

    middle_v = state.v + h / 2 * mean_acceleration(motion.slow)
    frequency = vortex_frequency(middle_v, problem.disturbance, plant.vehicle)
    slow = _slow_acceleration(problem, t + h / 2, middle_v, motion.phase + h / 2 * frequency)
    a = mean_acceleration(slow)
    stretch_1, rate_1, impulse_1 = rope_1.end(a)
    stretch_2, rate_2, impulse_2 = rope_2.end(a)

    radius_1, radius_2 = plant.winch_1.drum_radius, plant.winch_2.drum_radius
    x, v = state.x + h * (state.v + h / 2 * a), state.v + h * a
    late = slow + (impulse_1 - impulse_2) / momentum - a if slack else 0.0  # where a rope went slack or tight
    following = PlantState(
        x=x + h**2 / 2 * late,
        v=v + h * late,
        theta_1=(stretch_1 + x) / radius_1,
        omega_1=(rate_1 + v) / radius_1,
        theta_2=(stretch_2 - x) / radius_2,
        omega_2=(rate_2 - v) / radius_2,
    )
    clearance = minimum(rope_1.clearance(a), rope_2.clearance(a))
    return Motion(following, motion.phase + h * frequency, slow), clearance


def _oscillators(problem: Problem, state: PlantState, h: Scalar, slack: bool) -> tuple[Oscillator, Oscillator]:
    """Both ropes with their drums, the rope lengths at mid-step."""
    plant, torques = problem.plant, problem.torques
    length_1, length_2 = rope_lengths(state.x + h / 2 * state.v, plant.track)
    closeness_1, closeness_2 = reciprocals(length_1, length_2)
    radius_1, radius_2 = plant.winch_1.drum_radius, plant.winch_2.drum_radius
    rope_1 = _oscillator(
        radius_1 * state.theta_1 - state.x,
        radius_1 * state.omega_1 - state.v,
        -1.0,
        state.omega_1,
        torques.tau_1,
        length_1,
        closeness_1,
        -state.v,
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
        length_2,
        closeness_2,
        state.v,
        plant.rope_2,
        plant.winch_2,
        slack,
        h,
    )
    return rope_1, rope_2


def _oscillator(
    stretch: Scalar,
    rate: Scalar,
    sign: float,
    omega: Scalar,
    torque: Scalar,
    length: Scalar,
    closeness: Scalar,
    lengthening: Scalar,
    rope: Rope,
    winch: Winch,
    slack: bool,
    h: Scalar,
) -> Oscillator:
    """One rope and its drum; `sign` is that of the vehicle's position in the stretch, `closeness` 1/length in 1/m."""
    radius, drag = winch.drum_radius, friction_slope(omega, winch) / winch.inertia
    motor = winch.gear_ratio * torque - friction_torque(omega, winch)
    return Oscillator(
        stretch=stretch,
        rate=rate,
        drive=radius / winch.inertia * motor + drag * rate,
        sign=sign,
        spring=rope.modulus * rope.area * closeness,
        compliance=length / (rope.modulus * rope.area),
        damper=rope.damping,
        stiffening=-lengthening * closeness,
        mobility=radius**2 / winch.inertia,
        drag=drag,
        h=h,
        slack=slack,
    )
