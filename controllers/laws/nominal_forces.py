"""What a law compensates by its nominal model (paper Section 3.1.4)."""

from dataclasses import dataclass

from dualwinch.model.plant import Plant
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import drag, friction, inertia


@dataclass(frozen=True)
class NominalForces:
    """Mass and resistance of the nominal model."""

    mass: Scalar
    resistance: Scalar


def nominal_forces(v: Scalar, d: Scalar, nominal: Plant) -> NominalForces:
    """Mass in kg and resistance F_f + F_w in N of the nominal model at the speed v in m/s, less a known disturbance.

    `d` is its acceleration in m/s².
    """
    vehicle = nominal.vehicle
    mass = inertia(vehicle)
    return NominalForces(mass, friction(v, vehicle) + drag(v, vehicle) - mass * d)
