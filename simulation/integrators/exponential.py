"""Exponential integrator for this plant: exact rope–drum oscillations, slack events located, slow forces at mid-step.

Over a sub-step the vehicle has a constant mean acceleration, rope lengths and slow forces are those at mid-step, and
winch friction is linearised at its start. A taut rope and its drum are then a linear oscillator, whose flow is known in
closed form for any frequency; with a slack rope the drum moves freely. The impulses of both ropes are linear in the
mean acceleration, which follows from the vehicle's momentum balance. Where a rope goes slack or tight within a
sub-step, that moment is located and the rest of the sub-step follows the other law.

Where neither rope can go slack within a sample and dry friction is nearly linear, one step spans the whole sample
(`taut_step`). That holds most of the time; start-up, slack and the first centimetres of a hard start take sub-steps.

Every formula is derived in docs/accuracy.md and cited here by its number there.

Second order in the sub-step, also through slack. Accurate while a sub-step spans less than a third of an oscillation
(without slack: one), and stable up to two. Not a general exponential Runge–Kutta method: it is specific to the
Kelvin–Voigt rope.
"""

from dualwinch.model.disturbance import vortex_frequency
from dualwinch.model.plant import PlantState, vehicle_acceleration
from dualwinch.model.ropes import compliance, crept, kelvin_voigt, rope_lengths
from dualwinch.model.scalar import Scalar, absolute, maximum, minimum, reciprocals, where
from dualwinch.model.vehicle import inertia, slope_force
from dualwinch.model.winch import FRICTION_SPEED, Winding, friction_slope, friction_torque, total_inertia, winding
from dualwinch.simulation.integrators.oscillator import Oscillator
from dualwinch.simulation.integrators.problem import Motion, Problem


def exponential(problem: Problem, motion: Motion, t: Scalar, h: Scalar) -> Motion:
    """Motion after a step of length h in s from the time t in s."""
    return exponential_step(problem, motion, t, h, slack=problem.plant.rope_slack)[0]


def _slow_acceleration(problem: Problem, t: Scalar, x: Scalar, v: Scalar, phase: Scalar) -> Scalar:
    """Acceleration of the vehicle in m/s² due to everything but the ropes."""
    vehicle, track = problem.plant.vehicle, problem.plant.track
    return vehicle_acceleration(v, -slope_force(x, vehicle, track), problem.environment_at(t, v, phase), vehicle)


def exponential_step(problem: Problem, motion: Motion, t: Scalar, h: Scalar, *, slack: bool) -> tuple[Motion, Scalar]:
    """The motion after one step (Eq. 16–19), and a number that is positive only if taut ropes stay taut (Eq. 27).

    From t in s over h in s. The slow acceleration is evaluated at the mid-step speed, which is predicted with that of
    the last step. If ropes cannot go slack (`slack` is False), the result is valid where the number is positive.
    """
    plant, state = problem.plant, motion.plant
    drum_1, drum_2 = winding(state.theta_1, plant.winch_1), winding(state.theta_2, plant.winch_2)
    rope_1, rope_2 = _oscillators(problem, state, (drum_1, drum_2), t, h, slack)
    (fixed_1, slope_1), (fixed_2, slope_2) = rope_1.mean_pull(), rope_2.mean_pull()
    mass = inertia(plant.vehicle)

    yielding = 1 / (mass / h**2 + slope_1 + slope_2)
    by_ropes, share = (fixed_1 - fixed_2) * yielding, mass * yielding

    def mean_acceleration(slow: Scalar) -> Scalar:
        """In m/step², by the momentum balance mass a = mass slow + mean_pull_1(a) − mean_pull_2(a) (Eq. 16)."""
        return by_ropes + share * slow

    middle_v = state.v + 1 / (2 * h) * mean_acceleration(motion.slow)  # Eq. 17
    frequency = vortex_frequency(middle_v, problem.disturbance, plant.vehicle)
    middle_x = state.x + h / 2 * state.v
    slow = _slow_acceleration(problem, t + h / 2, middle_x, middle_v, motion.phase + h / 2 * frequency)
    a = mean_acceleration(slow)
    stretch_1, rate_1, pull_1 = rope_1.end(a)
    stretch_2, rate_2, pull_2 = rope_2.end(a)

    jump = h**2 * (slow + (pull_1 - pull_2) / mass) - a if slack else 0.0  # Eq. 19: where a rope went slack or tight
    steps = h * state.v + a  # speed at the end in m/step, without the above
    x = state.x + h * state.v + a / 2
    (longer_1, creeping_1), (longer_2, creeping_2) = crept(t + h, plant.creep_1), crept(t + h, plant.creep_2)
    theta_1, radius_1 = _turned(drum_1, stretch_1 + x + longer_1)
    theta_2, radius_2 = _turned(drum_2, stretch_2 - x + longer_2)
    following = PlantState(
        x=x + jump / 2,
        v=state.v + 1 / h * (a + jump),
        theta_1=theta_1,
        omega_1=1 / (radius_1 * h) * (rate_1 + steps + h * creeping_1),
        theta_2=theta_2,
        omega_2=1 / (radius_2 * h) * (rate_2 - steps + h * creeping_2),
    )
    clearance = minimum(rope_1.clearance(a), rope_2.clearance(a))
    return Motion(following, motion.phase + h * frequency, slow), clearance


def _turned(drum: Winding, rope: Scalar) -> tuple[Scalar, Scalar]:
    """Angle in rad and radius in m of a drum with a given length of wound rope in m at the end of a step."""
    theta = 1 / drum.base * (rope - drum.beyond_of(rope))
    return theta, drum.radius_after(theta - drum.theta)


def _oscillators(
    problem: Problem, state: PlantState, drums: tuple[Winding, Winding], t: Scalar, h: Scalar, slack: bool
) -> list[Oscillator]:
    """Both ropes with their drums (Eq. 1–4), the rope lengths and the drums' radii at mid-step.

    The unit of time is the sub-step h in s, so that rates are in m/step.
    """
    plant, oscillators = problem.plant, []
    travel = h * state.v
    lengths = rope_lengths(state.x + travel / 2, plant.track)
    speeds, torques = (state.omega_1, state.omega_2), (problem.torques.tau_1, problem.torques.tau_2)
    terms = zip(plant.sides, drums, lengths, reciprocals(*lengths), speeds, torques, strict=True)
    for side, drum, length, inverse_length, omega, torque in terms:
        winch, rope, sign = side.winch, kelvin_voigt(side.rope), -side.direction
        longer, creeping = crept(t, side.creep)
        rate = drum.radius * h * omega + sign * travel - h * creeping
        drag = h / total_inertia(winch) * friction_slope(omega, winch)
        turn = h * omega
        radius = drum.radius_after(turn / 2)
        turning = radius / total_inertia(winch) * h**2
        oscillator = Oscillator(
            stretch=drum.rope + sign * state.x - longer,
            rate=rate,
            drive=turning * winch.gear_ratio * torque
            - turning * friction_torque(omega, winch)
            + drag * rate
            + (drum.growth + turn / 2 * drum.bend) * turn**2,
            sign=sign,
            spring=rope.modulus * rope.area * inverse_length,
            compliance=compliance(length, rope),
            damper=rope.damping / h,
            stiffening=-(sign * travel) * inverse_length,
            mobility=radius**2 / total_inertia(winch) * h**2,
            drag=drag,
            slack=slack,
        )
        oscillators.append(oscillator)
    return oscillators


FRICTION_REACH = 3.0
"""Ratio of speed to friction speed beyond which friction is constant: tanh(3) = 0.995."""

RAIL_STEP, WINCH_STEP = 0.02, 0.2
"""Largest change of speed over friction speed in one step where friction is nonlinear, on the rail and in a winch."""


def taut_step(problem: Problem, motion: Motion) -> tuple[Motion, Scalar]:
    """Motion at the end of the sample in one step, and a number that is positive where that is accurate enough.

    It is where both ropes certainly stay taut (Eq. 27) and dry friction on rail and winches is nearly linear (Eq. 28).
    """
    motion_after, clearance = exponential_step(problem, motion, problem.t, problem.duration, slack=False)
    before, after, plant = motion.plant, motion_after.plant, problem.plant
    vehicle = plant.vehicle
    scale, stribeck = vehicle.friction_velocity, vehicle.stribeck_velocity
    scale = where(vehicle.stiction > 0, maximum(scale, stribeck), scale)
    straightness = _straightness(before.v, after.v, scale, RAIL_STEP)
    for winch, start, end in (
        (plant.winch_1, before.omega_1, after.omega_1),
        (plant.winch_2, before.omega_2, after.omega_2),
    ):
        with_winch = minimum(straightness, _straightness(start, end, FRICTION_SPEED, WINCH_STEP))
        straightness = where(winch.coulomb_friction > 0, with_winch, straightness)
    return motion_after, minimum(straightness, clearance) if plant.rope_slack else straightness


def _straightness(start: Scalar, end: Scalar, scale: Scalar, step: float) -> Scalar:
    """Positive where tanh(speed/scale) is nearly linear over the step: high speed, or a small change of it (Eq. 28)."""
    smaller_speed = where(start * end > 0, minimum(absolute(start), absolute(end)), 0.0)
    fast = smaller_speed / scale - FRICTION_REACH
    steady = step - absolute(end - start) / scale
    return maximum(fast, steady)
