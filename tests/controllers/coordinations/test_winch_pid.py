import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.coordinations.differential_tension import TensionLoops, follow_tensions
from dualwinch.controllers.coordinations.winch_pid import DrumMotion, WinchGains, WinchState, governed, winch_step
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import Track
from dualwinch.model.winch import Winch

tensions = st.floats(0, 9000)


def step(
    state: WinchState,
    command: float,
    tension: float,
    alpha_d: float = 0.0,
    gains: WinchGains | None = None,
    slip: float = 0.0,
    drift: float = 0.0,
) -> tuple[WinchState, float, float]:
    context = Context(Plant(), Limits(), 1e-3)
    return winch_step(
        state, command, tension, DrumMotion(alpha_d, slip, drift), Winch(), gains or WinchGains(), context
    )


@given(tensions, tensions, st.floats(-1e6, 1e6), st.floats(-1, 1))
def test_torque_is_within_what_the_tension_limits_allow(
    command: float, tension: float, integral: float, alpha_d: float
) -> None:
    _, torque, _ = step(WinchState(integral=integral), command, tension, alpha_d)
    assert 0.8 / 36 * 200 <= torque <= 0.8 / 36 * 6000


def test_feedforward_holds_the_tension_and_accelerates_the_drum() -> None:
    _, torque, _ = step(WinchState(), 3000.0, 3000.0, 2.0)
    assert torque == pytest.approx(0.8 / 36 * 3000 + 1.8 / 36 * 2)


def test_too_little_tension_gives_more_torque() -> None:
    """E10: the error is command minus tension."""
    assert step(WinchState(), 3000.0, 2900.0)[1] > step(WinchState(), 3000.0, 3000.0)[1]


@given(tensions, tensions, st.floats(-1e5, 1e5))
def test_integral_is_kept_only_while_the_torque_is_not_clipped(command: float, tension: float, integral: float) -> None:
    after, _, saturated = step(WinchState(integral=integral), command, tension)
    grown = integral + 1e-3 * (command - tension)
    assert after.integral == (integral if saturated else grown)


def test_the_integral_acts_in_its_own_sample() -> None:
    gains = WinchGains(kp=0.0, ki=1.0)
    assert step(WinchState(), 3000.0, 2900.0, gains=gains)[1] == pytest.approx(0.8 / 36 * 3000 + 0.1)


def test_derivative_is_zero_at_the_first_sample_only() -> None:
    gains = WinchGains(kp=0.0, ki=0.0, kd=1e-4)
    state, torque, _ = step(WinchState(), 3000.0, 2990.0, gains=gains)
    assert torque == pytest.approx(0.8 / 36 * 3000)
    _, torque, _ = step(state, 3000.0, 2980.0, gains=gains)
    assert torque == pytest.approx(0.8 / 36 * 3000 + 1e-4 * 10 / 1e-3)


def test_damping_acts_against_the_drum_below_the_lower_limit_of_what_follows_the_tension() -> None:
    gains = WinchGains(kp=0.0, ki=0.0, damping=100.0)
    _, still, _ = step(WinchState(), 3000.0, 3000.0, gains=gains)
    _, torque, _ = step(WinchState(), 3000.0, 3000.0, gains=gains, slip=0.1)
    assert torque - still == pytest.approx(-10.0)
    least = 0.8 / 36 * 200
    for opposing, expected in ((3.0, least - 3.0), (-3.0, least + 3.0), (50.0, 0.0)):
        after, torque, saturated = step(WinchState(), 200.0, 200.0, gains=gains, slip=opposing / 100)
        assert torque == pytest.approx(expected)
        assert (after.integral, saturated) == (0.0, False)
    _, torque, _ = step(WinchState(), 6000.0, 6000.0, gains=gains, slip=-0.03)
    assert torque == pytest.approx(0.8 / 36 * 6000)


def test_damping_of_the_common_motion_is_limited_with_the_tension_and_that_of_the_stretch_is_not() -> None:
    """Where nothing is limited, the sum is the damping of the drum against the reference."""
    gains = WinchGains(kp=0.0, ki=0.0, damping=100.0)
    for drift in (0.0, 0.02):
        assert step(WinchState(), 3000.0, 3000.0, gains=gains, slip=0.1, drift=drift)[1] == pytest.approx(
            0.8 / 36 * 3000 - 10
        )
    for drift, limit in ((-10.0, 6000.0), (10.0, 200.0)):
        _, torque, _ = step(WinchState(), 3000.0, 3000.0, gains=gains, slip=drift + 0.02, drift=drift)
        assert torque == pytest.approx(0.8 / 36 * limit - 2.0)


@given(st.floats(0, 5900), st.floats(-1, 1), st.floats(5, 100))
def test_governed_tension_of_an_undamped_drum_hardly_exceeds_its_limit(
    start: float, speed: float, frequency: float
) -> None:
    """A mass on a spring, to the largest command: from rest it would reach twice the step, governed 16 % beyond it.

    While the spring is being stretched, the governed mass has the damping ratio 1/2: from rest it overshoots by
    exp(-pi/sqrt(3)) of the step, from a speed by exp(-pi/(3 sqrt(3))) of what that would become without a governor.
    """
    limits, impedance, dt = Limits(), 1e4, 1e-4
    tension, rate, peak = start, 0.05 * speed, start
    for _ in range(round(2 * np.pi / frequency / dt)):
        command = governed(6000.0, tension, impedance * rate, 1.0, limits)
        rate += dt * frequency / impedance * (command - tension)
        tension += dt * frequency * impedance * rate
        peak = max(peak, tension)
    step, swing = 6000 - start, 0.05 * speed * impedance
    from_rest, from_speed = np.exp(-np.pi / 3**0.5), np.exp(-np.pi / 3**1.5)
    beyond = from_rest * step + from_speed * swing if speed > 0 else from_rest * np.hypot(step, swing)
    assert peak <= 6000 + 1.01 * beyond


@given(st.floats(0.05, 1), st.floats(5, 100), st.floats(0, 2))
def test_a_drum_that_takes_up_a_slack_rope_hardly_exceeds_the_limit(
    share: float, frequency: float, slack: float
) -> None:
    """A damped mass before a spring, to the largest command; its speed is known only from the tension's rate.

    It touches the spring at the speed at most that the spring alone would turn into the limit; at rest on a taut spring
    it overshoots as above.
    """
    limits, impedance, dt = Limits(), 1e4, 1e-4
    stretch, rate, peak = -slack * 6000 / (frequency * impedance), 0.0, 0.0
    for _ in range(round((2 * np.pi + 3 * slack / share) / frequency / dt)):
        tension = max(frequency * impedance * stretch, 0.0)
        command = governed(6000.0, tension, impedance * rate if tension else 0.0, share, limits)
        rate += dt * frequency / impedance * (command - tension - share * impedance * rate)
        stretch += dt * rate
        peak = max(peak, tension)
    assert peak <= (1 + np.exp(-np.pi / 3**0.5)) * 6000


def test_a_limited_command_holds_the_integral() -> None:
    """A weak drive leaves its tension below the command, for as long as the force is at its limit."""
    gains, motion = WinchGains(kp=0.0, ki=0.01, damping=100.0), DrumMotion(impedance=1e4, frequency=50.0)
    context, state = Context(Plant(), Limits(), 1e-3), WinchState()
    for _ in range(1000):
        state, _, saturated = winch_step(state, 5000.0, 2000.0, motion, Winch(), gains, context)
        assert (state.integral, saturated) == (0.0, False)
    state, *_ = winch_step(state, 2100.0, 2000.0, motion, Winch(), gains, context)
    assert state.integral == pytest.approx(1e-3 * 100)


@pytest.mark.parametrize("rise", [-3e4, 3e4, 1e5])
def test_a_rising_tension_limits_the_command_whatever_the_rotor_does(rise: float) -> None:
    """A rope whose tension rises by dF/dt will have dF/dt/w more; the rotor, free on its gearbox, runs backwards."""
    gains, frequency, limits = WinchGains(kp=0.0, ki=0.0, damping=1.0), 50.0, Limits()
    for slip in (0.0, -0.1):
        state, torque = WinchState(), 0.0
        motion = DrumMotion(slip=slip, impedance=45.0, frequency=frequency)
        for sample in range(40):
            tension = 3000.0 + 1e-3 * rise * sample
            state, torque, _ = winch_step(
                state, 6000.0, tension, motion, Winch(), gains, Context(Plant(), limits, 1e-3)
            )
        command = min(limits.tension_max, (torque + gains.damping * slip) * 36 / 0.8)
        assert command == pytest.approx(6000 - max(rise, 0.0) / frequency, abs=10.0)


def test_proportional_gain_and_damping_fade_on_a_short_rope_where_there_is_damping() -> None:
    gains, track = WinchGains(kp=2.0, damping=100.0, fade=0.1), Track(length=50.0)
    found = [gains.on(length, track) for length in (0.5, 2.5, 5.0, 50.5)]
    assert [each.damping for each in found] == pytest.approx([10, 50, 100, 100])
    assert [each.kp for each in found] == pytest.approx([0.2, 1, 2, 2])
    assert all(each.ki == gains.ki for each in found)
    paper = WinchGains()
    assert paper.on(0.5, track) == paper


def test_winches_are_damped_by_the_lengths_of_their_own_ropes_at_the_reference() -> None:
    """Rope 2 is short at the beginning of the track, rope 1 at its end."""
    gains = WinchGains(kp=0.0, ki=0.0, damping=100.0, fade=0.1)
    for x, shares in ((0.0, (1.0, 0.1)), (25.0, (1.0, 1.0)), (50.0, (0.1, 1.0))):
        torques = []
        for speed in (0.0, 0.01):
            estimate, context = Estimate(x, 0.0, 3e3, 3e3, speed, speed, 0.0, 0.0), Context(Plant(), Limits(), 1e-3)
            setpoint = Setpoint(x, 0.0, 0.0)
            _, output = follow_tensions(TensionLoops(), (3e3, 3e3), estimate, (gains, gains), setpoint, context)
            torques.append((output.tau_1, output.tau_2))
        (still_1, still_2), (turning_1, turning_2) = torques
        assert (still_1 - turning_1, still_2 - turning_2) == pytest.approx(shares)


def test_a_lead_turns_the_phase_of_damping_forward() -> None:
    """(1 + s lead)/(1 + s lead/6) at a tenth of the sampling rate's half and below; nothing at frequency 0."""
    gains = WinchGains(kp=0.0, ki=0.0, damping=100.0, lead=3e-3)
    state, t = WinchState(), 1e-3 * np.arange(4000)
    _, still, _ = step(state, 3000.0, 3000.0, gains=gains)
    for hertz in (5.0, 20.0, 50.0):
        turns, torques = 0.1 * np.exp(2j * np.pi * hertz * t), []
        for slip in turns.real:
            state, torque, _ = step(state, 3000.0, 3000.0, gains=gains, slip=slip)
            torques.append(torque)
        answer = np.vdot(turns[2000:], still - np.array(torques[2000:])) / np.sum(np.abs(turns[2000:]) ** 2) * 2
        s = 2j * np.pi * hertz
        assert answer / 100 == pytest.approx((1 + 3e-3 * s) / (1 + 0.5e-3 * s), rel=0.12)
    for _ in range(50):
        state, _, _ = step(state, 3000.0, 3000.0, gains=gains, slip=0.1)
    assert still - step(state, 3000.0, 3000.0, gains=gains, slip=0.1)[1] == pytest.approx(10.0)


def test_a_lead_without_damping_is_nothing() -> None:
    assert step(WinchState(), 3e3, 2e3, slip=0.1, gains=WinchGains(lead=2e-3)) == step(WinchState(), 3e3, 2e3, slip=0.1)
