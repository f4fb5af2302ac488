"""Steady-state Kalman filter for position and speed, from position, wheel speed and both drum encoders.

The states are position x, speed v and a disturbance acceleration d, modelled as a random walk::

    dx/dt = v,   dv/dt = (F_1 - F_2 - F_f(v) - F_w(v))/M + d,   dd/dt = r + white noise

The input is the pull of the *measured* tensions. The last command would be a poor substitute: it reaches the motor
late, the ropes follow it with oscillations, and it is limited. The noise of the tensions is harmless, as it is
integrated: 10 N on each rope are 1.4e-6 m/s in a sample of 1 ms.

A taut rope turns its drum encoder into a precise position sensor: ``R_1 theta_1 = x + stretch_1`` and
``R_2 theta_2 = stretch_2 - x`` with ``stretch_i = F_i length_i/(E_i A_i)`` from the measured tension (paper Section
2.2, E1, without damping). The encoder of a slack rope has no information and is left out.

All three positions measure the same state, so they are combined into one measurement, weighted by their inverse
variances. The gain solves the discrete Riccati equation (`model.matrix`); it depends on parameters alone. It is optimal
while all sensors are in use and the noise is white, which is not quite true for a position rounded to 1 mm: its noise
level must include the rounding.

The rate r is for disturbances that change within seconds, such as vortices: without it the estimates of disturbance and
speed lag by 1/bandwidth. It integrates the corrections of d, times `ramp` and the bandwidth. Without a speed sensor the
poles p of the filter are then the roots of ``s⁴ + 2 s³ + 2 s² + s + ramp = 0`` with s = p/bandwidth, all stable for
ramp < 3/4.

A sensor that is late by a delay reads the state of that time ago. It is compared with the present state taken back to
that time by the filter's own motion (retrodiction; Bar-Shalom, Update with out-of-sequence measurements in tracking,
IEEE Transactions on Aerospace and Electronic Systems 38, 2002, without the process noise since then)::

    x(t - delay) = x - delay v + delay²/2 a,    v(t - delay) = v - delay a

with the acceleration a of the prediction. The rows of the measurement matrix in the Riccati equation are those of this
motion, so that the filter stays stable however late the sensors are.

With a probability of false alarms (`GateGains.false_alarm`) readings of position and speed that the prediction makes
improbable are not used while both encoders confirm it (`controllers.estimators.innovation_gate`).

Position laws that compensate the forces of a nominal model can use the estimated disturbance: `compensation` is the
share of it that they add to these forces. The rest is left to an observer of the law, which knows the commands but not
the tensions.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import annotated_types as at

from dualwinch.controllers.estimators.innovation_gate import (
    GateGains,
    Gates,
    Witness,
    gated,
    is_improbable,
    position_gated,
)
from dualwinch.controllers.parts import Context, Estimate, Estimator, Measurement
from dualwinch.model.matrix import Matrix, diagonal, plus, riccati, solve, times, transpose
from dualwinch.model.plant import DisturbanceInputs, Plant, vehicle_acceleration
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Tunable, UnitInterval
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import compliance, kelvin_voigt, rope_lengths
from dualwinch.model.scalar import Scalar, absolute, both, present, where
from dualwinch.model.winch import tension_beyond_sheaves


@dataclass(frozen=True)
class KalmanGains:
    """Noise levels and bandwidth of the filter.

    Only ratios of the noise levels matter: the random walk of the disturbance is scaled with them, so that the
    filter's poles without a speed sensor and a ramp are those of a third-order Butterworth filter of this bandwidth.
    """

    position_noise: Annotated[
        Positive,
        Quantity("m", "assumed standard deviation of the position, rounding included", "assumption"),
        Tunable(5e-5, 5e-3, standard=False),
    ] = 6e-4
    speed_noise: Annotated[
        Positive, Quantity("m/s", "assumed standard deviation of the speed", "assumption"), Tunable(1e-4, 5e-2)
    ] = 2e-3
    encoder_noise: Annotated[
        Positive,
        Quantity("m", "assumed standard deviation of a position from encoder and stretch", "assumption"),
        Tunable(1e-6, 1e-2),
    ] = 1e-4
    bandwidth: Annotated[
        Positive, Quantity("rad/s", "bandwidth of the disturbance estimate", "assumption"), Tunable(1, 200)
    ] = 20.0
    ramp: Annotated[
        NonNegative,
        at.Le(0.7),
        Quantity("1", "gain on the disturbance's rate over the bandwidth; 0: no rate", "assumption"),
        Tunable(0, 0.7, log=False),
    ] = 0.0
    position_delay: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("s", "time by which the position reading is taken to be late", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    speed_delay: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("s", "time by which the speed reading is taken to be late", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    encoder_delay: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("s", "time by which the drums' angles are taken to be late", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    compensation: Annotated[
        UnitInterval,
        Quantity("1", "share of the estimated disturbance that the position law compensates", "assumption"),
        Tunable(0, 1, log=False),
    ] = 0.0
    speed_sensor: Annotated[
        bool,
        Quantity("", "whether the filter reads a speed sensor; else the speed is that of position and encoders", ""),
    ] = True

    @property
    def silent(self) -> frozenset[str]:
        """Names of measurements that are not read."""
        return frozenset() if self.speed_sensor else frozenset({"v"})

    def speed_innovation(self, reading: Scalar, v: Scalar) -> Scalar:
        """Innovation of a reading of the speed in m/s against the predicted v; 0 without a sensor."""
        return reading - v if self.speed_sensor else 0.0


@dataclass(frozen=True)
class KalmanState:
    """Predicted state of the next sample; encoders are zeroed at x = 0, at rest."""

    x: Annotated[Scalar, Quantity("m", "predicted position"), Mark.POSITION] = 0.0
    v: Annotated[Scalar, Quantity("m/s", "predicted speed"), Mark.SPEED] = 0.0
    d: Annotated[Scalar, Quantity("m/s^2", "predicted disturbance acceleration")] = 0.0
    rate: Annotated[Scalar, Quantity("m/s^3", "predicted rate of the disturbance")] = 0.0
    gates: Any = NO_STATE


@dataclass(frozen=True)
class KalmanEstimate(Estimate):
    """Output of the filter, with its complete estimate."""

    x_est: Annotated[Scalar, Quantity("m", "estimated position")] = 0.0
    v_est: Annotated[Scalar, Quantity("m/s", "estimated speed")] = 0.0
    d_est: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration, regardless of compensation")] = 0.0
    position_used: Annotated[Scalar, Quantity("1", "1 where the reading of the position sensor is accepted")] = 1.0
    speed_used: Annotated[Scalar, Quantity("1", "1 where the reading of the speed sensor is accepted")] = 1.0


def initial_motion(gate: GateGains) -> KalmanState:
    """At rest at the start of the run, with gates where false alarms have a probability."""
    return KalmanState(gates=Gates() if gate.false_alarm else NO_STATE)


DOUBLINGS = 18
"""Doubling steps: the gain is that after 2^18 samples."""


class SteadyFilter(NamedTuple):
    """The steady-state filter: its gain as in `kalman_gain`, and the variance in m²/s² of the predicted speed."""

    gain: Matrix
    speed_variance: Scalar


def kalman_gain(gains: KalmanGains, sample_time: Scalar, encoders: bool = True) -> Matrix:
    """Gain (3 × 2) of position, speed and disturbance on the innovations of position and speed (`steady_filter`)."""
    gain = steady_filter(gains, sample_time, encoders, gains.speed_sensor).gain
    return gain if gains.speed_sensor else tuple((of_position, 0.0) for (of_position,) in gain)


def steady_filter(
    gains: KalmanGains, sample_time: Scalar, encoders: bool = True, speed_sensor: bool = True
) -> SteadyFilter:
    """The filter with all sensors, or without encoders or speed sensor.

    Computed in units of the sample time in s and of the combined position noise, in which all numbers have similar
    sizes. The position is that of all three sensors combined, or that of the position sensor without the `encoders`.
    """
    motion: Matrix = ((1.0, 1.0, 0.5), (0.0, 1.0, 1.0), (0.0, 0.0, 1.0))
    walk = (gains.bandwidth * sample_time) ** 6
    covariance: Matrix = tuple(
        tuple(walk * share for share in row)
        for row in ((1 / 20, 1 / 8, 1 / 6), (1 / 8, 1 / 3, 1 / 2), (1 / 6, 1 / 2, 1.0))
    )
    position_variance = 1 / sum(_information(gains)) if encoders else gains.position_noise**2
    speed_variance = gains.speed_noise**2 * sample_time**2 / position_variance
    noise = (1.0, speed_variance) if speed_sensor else (1.0,)
    rows = _observation(gains, sample_time, encoders)[: len(noise)]
    information = times(transpose(rows), diagonal(*(1 / variance for variance in noise)), rows)
    h = riccati(transpose(motion), information, covariance, DOUBLINGS)
    observed = times(h, transpose(rows))
    innovation = plus(times(rows, observed), diagonal(*noise))
    gain = transpose(solve(innovation, transpose(observed)))
    scaled = tuple(
        (of_position / sample_time**order, *(of_speed * sample_time ** (1 - order) for of_speed in of_speeds))
        for order, (of_position, *of_speeds) in enumerate(gain)
    )
    return SteadyFilter(scaled, h[1][1] * position_variance / sample_time**2)


def _observation(gains: KalmanGains, sample_time: Scalar, encoders: bool) -> Matrix:
    """Rows of the measurement matrix, of position and speed: that of late sensors on the present state."""
    position, *drums = _information(gains)
    lateness: Scalar = gains.position_delay / sample_time if present(gains.position_delay) else 0.0
    if encoders and (present(gains.position_delay) or present(gains.encoder_delay)):
        total = position + sum(drums)
        lateness = (position * gains.position_delay + sum(drums) * gains.encoder_delay) / (total * sample_time)
    late_speed = gains.speed_delay / sample_time if present(gains.speed_delay) else 0.0
    return (1.0, -lateness, lateness**2 / 2), (0.0, 1.0, -late_speed)


def _information(gains: KalmanGains) -> tuple[Scalar, Scalar, Scalar]:
    """Information of position sensor, encoder 1 and encoder 2 on the position, in 1/m²."""
    encoder = 1 / gains.encoder_noise**2
    return 1 / gains.position_noise**2, encoder, encoder


def timely(
    state: KalmanState, measurement: Measurement, gains: KalmanGains, nominal: Plant, age: Scalar = 0.0
) -> Measurement:
    """The measurement with the readings of late sensors taken to the present by the predicted motion.

    Its innovations are those of the late readings against the predicted state taken back to their time. The reading of
    the position is older by an `age` in s.
    """
    delays = gains.position_delay, gains.speed_delay, gains.encoder_delay
    if not any(map(present, (*delays, age))):
        return measurement
    pull = pull_on_vehicle(measurement, state.v, nominal)
    acceleration = vehicle_acceleration(state.v, pull, DisturbanceInputs(), nominal.vehicle) + state.d
    readings: dict[str, Scalar] = {}
    if present(gains.position_delay) or present(age):
        readings["x"] = measurement.x + _way(state.v, acceleration, gains.position_delay + age)
    if present(gains.speed_delay):
        readings["v"] = measurement.v + gains.speed_delay * acceleration
    if present(gains.encoder_delay):
        way = _way(state.v, acceleration, gains.encoder_delay)
        readings["theta_1"] = measurement.theta_1 + way / nominal.winch_1.drum_radius
        readings["theta_2"] = measurement.theta_2 - way / nominal.winch_2.drum_radius
    return replace(measurement, **readings)


def pull_on_vehicle(measurement: Measurement, v: Scalar, nominal: Plant) -> Scalar:
    """Net pull of the ropes on the vehicle in N from the measured tensions, at the speed v in m/s."""
    pull_1, pull_2 = (
        tension_beyond_sheaves(tension, side.direction * v / side.winch.drum_radius, side.winch)
        for side, tension in zip(nominal.sides, (measurement.F1, measurement.F2), strict=True)
    )
    return pull_1 - pull_2


def _way(v: Scalar, acceleration: Scalar, delay: Scalar) -> Scalar:
    """Way in m of the last `delay` s, at the speed in m/s and the acceleration in m/s² of now."""
    return delay * (v - delay / 2 * acceleration)


def witnesses(
    state: KalmanState, now: Measurement, nominal: Plant, context: Context, spreads: tuple[Scalar, Scalar]
) -> tuple[Witness, Witness]:
    """Both encoders, with the variances in m² of their positions' lasting errors.

    The nominal plant has the present calibration. A rope counts as slack far below ``context.limits.tension_min``.
    """
    encoders, taut = [], context.limits.taut
    measured = (now.F1, now.theta_1), (now.F2, now.theta_2)
    lengths = rope_lengths(state.x, nominal.track)
    for side, length, (F, theta), spread in zip(nominal.sides, lengths, measured, spreads, strict=True):
        wound = side.winch.drum_radius * theta - F * compliance(length, kelvin_voigt(side.rope))
        encoders.append(Witness(side.direction * wound - state.x, taut < F, spread, F))
    return encoders[0], encoders[1]


def with_gated_position(
    state: KalmanState,
    now: Measurement,
    encoders: tuple[Witness, Witness],
    gains: KalmanGains,
    gate: GateGains,
    context: Context,
) -> tuple[KalmanState, Scalar]:
    """The state with its gates after a reading of the position, and whether the encoders confirm the prediction."""
    if not isinstance(state.gates, Gates):
        return state, 1.0
    position, *drums = _information(gains)
    ((of_x, _), *_) = kalman_gain(gains, context.sample_time)
    gates, is_confirmed = position_gated(
        state.gates,
        now.x - state.x,
        encoders,
        gate,
        sensor=gains.position_noise**2,
        encoder=gains.encoder_noise**2,
        memory=of_x * position / (position + sum(drums)),
        sample_time=context.sample_time,
    )
    return replace(state, gates=gates), is_confirmed


def filter_motion(
    state: KalmanState,
    measurement: Measurement,
    gains: KalmanGains,
    nominal: Plant,
    context: Context,
    gate: GateGains,
    is_confirmed: Scalar = 1.0,
) -> tuple[KalmanState, KalmanEstimate]:
    """One sample: correct the predicted state by the measurement, and predict the next.

    The nominal plant has the present calibration. The gate of the position has been asked (`with_gated_position`), that
    of the speed is here.
    """
    position, *drums = _information(gains)
    total, now = position + sum(drums), timely(state, measurement, gains, nominal)
    gain, predicted = kalman_gain(gains, context.sample_time), state
    of_position, encoders = now.x - state.x, witnesses(state, now, nominal, context, (0.0, 0.0))
    if isinstance(state.gates, Gates):
        of_position = where(state.gates.position.rejected, 0.0, of_position)
        if gains.speed_sensor:
            predicted, gain = with_gated_speed(
                state, gain, now.v, encoders, is_confirmed, gains, gate, context.sample_time
            )
    of_x = position / total * of_position
    for information, encoder in zip(drums, encoders, strict=True):
        of_x += information / total * where(encoder.taut, encoder.off, 0.0)
    innovations = of_x, gains.speed_innovation(now.v, predicted.v)
    return corrected(predicted, measurement, innovations, gain, gains, nominal, context.sample_time)


def with_gated_speed(
    state: KalmanState,
    gain: Matrix,
    reading: Scalar,
    encoders: tuple[Witness, Witness],
    is_confirmed: Scalar,
    gains: KalmanGains,
    gate: GateGains,
    sample_time: Scalar,
    spread: Scalar = 0.0,
) -> tuple[KalmanState, Matrix]:
    """The state with its gates after the wheel's reading in m/s, and the gain with the wheel or without.

    The wheel is rejected only where the encoders confirm the prediction, and not after a push, which stretches the
    ropes: the vehicle's speed by the tighter one, its encoder and its load cell, is improbable then, and nearer to the
    wheel's than to the prediction. (A rope that sags follows a push only later.) Of the speed, whose gain on its
    innovation is the gate's memory, what the estimate followed of the wheel is taken back, of the disturbance in
    proportion. The spread is the variance of the reading's lasting error.
    """
    gates, innovation, (encoder_1, encoder_2) = state.gates, reading - state.v, encoders
    complete, coasting = (steady_filter(gains, sample_time, speed_sensor=there) for there in (True, False))
    (_, _), (_, memory), (_, of_d) = complete.gain
    used = complete.speed_variance + gains.speed_noise**2
    speed = gated(
        gates.speed,
        innovation,
        used=used,
        unused=coasting.speed_variance + gains.speed_noise**2 + spread,
        lasting=0.0,
        memory=memory,
        false_alarm=gate.false_alarm,
    )
    here_1, here_2 = state.x + encoder_1.off, state.x + encoder_2.off
    displacement = where(encoder_1.pull > encoder_2.pull, here_1 - gates.last_1, here_2 - gates.last_2)
    rope = gates.rope + memory * (displacement / sample_time - state.v - gates.rope)
    wheel = gates.wheel + memory * (innovation - gates.wheel)
    is_moved = is_improbable(rope, memory / (2 - memory) * used, gate.false_alarm)
    is_pushed = both(is_moved, absolute(wheel - rope) < absolute(rope))
    rejected = both(speed.rejected, both(is_confirmed, 1 - is_pushed))
    followed = gates.followed + memory * (innovation - gates.followed)
    back = where(rejected, gates.followed, 0.0)
    learnt = back * of_d / memory
    gain = tuple(
        (where(rejected, alone, of_x), where(rejected, 0.0, of_v))
        for (of_x, of_v), (alone,) in zip(gain, coasting.gain, strict=True)
    )
    following = replace(
        gates,
        speed=replace(speed, rejected=rejected),
        followed=where(rejected, 0.0, followed),
        wheel=wheel,
        rope=rope,
        last_1=here_1,
        last_2=here_2,
    )
    predicted = replace(
        state,
        v=state.v - back,
        d=state.d - learnt,
        rate=state.rate - gains.ramp * gains.bandwidth * learnt,
        gates=following,
    )
    return predicted, gain


def corrected(
    state: KalmanState,
    measurement: Measurement,
    innovations: tuple[Scalar, Scalar],
    gain: Matrix,
    gains: KalmanGains,
    nominal: Plant,
    sample_time: Scalar,
) -> tuple[KalmanState, KalmanEstimate]:
    """The state corrected by innovations of position in m and speed in m/s with a `kalman_gain`, and the next one.

    Returns:
        The next state, and the measurement with estimated position and speed and the disturbance to compensate.
    """
    (x_x, x_v), (v_x, v_v), (d_x, d_v) = gain
    of_x, of_v = innovations
    x = state.x + x_x * of_x + x_v * of_v
    v = state.v + v_x * of_x + v_v * of_v
    learnt = d_x * of_x + d_v * of_v
    d, rate = state.d + learnt, state.rate + gains.ramp * gains.bandwidth * learnt
    pull = pull_on_vehicle(measurement, v, nominal)
    acceleration = vehicle_acceleration(v, pull, DisturbanceInputs(), nominal.vehicle) + d
    following = replace(
        state,
        x=x + sample_time * v + sample_time**2 / 2 * acceleration,
        v=v + sample_time * acceleration,
        d=d + sample_time * rate,
        rate=rate,
    )
    better = {"x": x, "v": v, "d": gains.compensation * d, "x_est": x, "v_est": v, "d_est": d}
    if isinstance(gates := state.gates, Gates):
        better |= {"position_used": 1 - gates.position.rejected, "speed_used": 1 - gates.speed.rejected}
    return following, KalmanEstimate(**vars(measurement) | better)


@dataclass(frozen=True)
class MotionFilter(Estimator):
    """What filters of the vehicle's motion have in common."""

    kalman: KalmanGains = field(default_factory=KalmanGains)

    @property
    def silent(self) -> frozenset[str]:
        """Names of measurements that may be missing."""
        return self.kalman.silent


@dataclass(frozen=True)
class Kalman(MotionFilter):
    """The filter, its gains and its gate."""

    trust: GateGains = field(default_factory=GateGains)

    kind: ClassVar = "kalman"
    label: ClassVar = "Kalman filter"

    def initial_state(self) -> KalmanState:
        """At rest at the start of the run."""
        return initial_motion(self.trust)

    def step(
        self, state: KalmanState, measurement: Measurement, setpoint: Setpoint, context: Context
    ) -> tuple[KalmanState, KalmanEstimate]:
        """One sample of the filter."""
        now = timely(state, measurement, self.kalman, context.nominal)
        uncalibrated = self.kalman.encoder_noise**2
        encoders = witnesses(state, now, context.nominal, context, (uncalibrated, uncalibrated))
        state, is_confirmed = with_gated_position(state, now, encoders, self.kalman, self.trust, context)
        return filter_motion(state, measurement, self.kalman, context.nominal, context, self.trust, is_confirmed)
