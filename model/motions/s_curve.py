"""Changes of speed with bounded jerk: S-curves."""

from dualwinch.model.motions.setpoint import Setpoint, piece_at
from dualwinch.model.scalar import Scalar, maximum, sqrt


def least_duration(speed: Scalar, jerk_limit: Scalar) -> Scalar:
    """Shortest time in s from rest to a speed in m/s with a jerk limit in m/s³."""
    return 2 * sqrt(speed / jerk_limit)


def speed_up(t: Scalar, duration: Scalar, speed: Scalar, jerk_limit: Scalar | None) -> Setpoint:
    """Motion from rest at t = 0 to a speed in a given time, over ``speed * duration / 2`` whatever the jerk limit.

    Args:
        t: time in s, 0 to `duration`.
        duration: in s, at least `least_duration` where there is a jerk limit.
        speed: at the end, in m/s.
        jerk_limit: slope in m/s³ of the acceleration's two ramps; ``None``: constant acceleration.
    """
    if jerk_limit is None:
        acceleration = speed / duration
        return Setpoint(acceleration * t**2 / 2, acceleration * t, acceleration)
    # ramp * (duration - ramp) * jerk_limit = speed; the root is written without a difference of nearly equal numbers
    spare = maximum(duration**2 - 4 * speed / jerk_limit, 0.0)
    ramp = 2 * speed / jerk_limit / (duration + sqrt(spare))
    acceleration, after, left = jerk_limit * ramp, t - ramp, duration - t
    rising = Setpoint(jerk_limit * t**3 / 6, jerk_limit * t**2 / 2, jerk_limit * t)
    gained = jerk_limit * ramp**2 / 2
    steady = Setpoint(
        gained * ramp / 3 + gained * after + acceleration * after**2 / 2, gained + acceleration * after, acceleration
    )
    falling = Setpoint(
        speed * duration / 2 - speed * left + jerk_limit * left**3 / 6,
        speed - jerk_limit * left**2 / 2,
        jerk_limit * left,
    )
    return piece_at(t, ((ramp, rising), (duration - ramp, steady)), falling)
