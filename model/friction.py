"""Friction with memory: bristles that bend before they slide (Dahl's model, and the LuGre model that follows from it).

A bristle of deflection z follows a motion of speed v until it slides at its limit::

    dz/dt = v − |v| z/limit

With a limit that stays, that is Dahl's model: a force in proportion to z rises from one side of a hysteresis loop to
the other. With a limit that depends on the speed by Stribeck's curve, and a damping beside the stiffness, it is LuGre.

References: Dahl, *A Solid Friction Model*, The Aerospace Corporation, TOR-0158(3107-18)-1 (1968); Canudas de Wit,
Olsson, Åström and Lischinsky, *A New Model for Control of Systems with Friction*, IEEE Transactions on Automatic
Control 40 (1995).
"""

from dualwinch.model.scalar import Scalar, absolute, maximum

LEAST_LIMIT = 1e-12
"""Floor under a limit that is divided by: without friction bristles bend by nothing."""


def bristle_rate(deflection: Scalar, speed: Scalar, limit: Scalar, step: Scalar) -> Scalar:
    """Rate of a bristle's deflection, its mean over a step in s at one speed; of a step of 0, dz/dt itself.

    In fast motion a bristle settles far quicker than a step of an integrator is long: it is taken implicitly (backward
    Euler), which is stable whatever the step, never leaves the limits, and exact where it has settled.

    Args:
        deflection: z at the beginning of the step.
        speed: v, in units of the deflection a second.
        limit: of the deflection.
        step: in s.
    """
    sliding, most = absolute(speed), maximum(limit, LEAST_LIMIT)
    return (speed * most - sliding * deflection) / (most + sliding * step)
