"""Friction with a bristle state: Dahl's model, and the LuGre model derived from it.

A bristle of deflection z follows a motion of speed v until it slides at its limit::

    dz/dt = v − |v| z/limit

With a constant limit this is Dahl's model: a force proportional to z traces a hysteresis loop. With a limit by
Stribeck's curve, and damping in addition to the stiffness, it is the LuGre model.

References: Dahl, *A Solid Friction Model*, The Aerospace Corporation, TOR-0158(3107-18)-1 (1968); Canudas de Wit,
Olsson, Åström and Lischinsky, *A New Model for Control of Systems with Friction*, IEEE Transactions on Automatic
Control 40 (1995).
"""

from dualwinch.model.scalar import Scalar, absolute, maximum

LEAST_LIMIT = 1e-12
"""Floor of the limit, a divisor: without friction the limit is zero."""


def bristle_rate(deflection: Scalar, speed: Scalar, limit: Scalar, step: Scalar) -> Scalar:
    """Mean rate of a bristle's deflection over a step in s at constant speed; for a step of 0, dz/dt itself.

    In fast motion a bristle settles within a fraction of an integration step. The step is therefore implicit (backward
    Euler): stable for every step, always within the limits, and exact in the steady state. The deflection is that at
    its beginning; the speed is in units of the deflection per second.
    """
    sliding, bound = absolute(speed), maximum(limit, LEAST_LIMIT)
    return (speed * bound - sliding * deflection) / (bound + sliding * step)
