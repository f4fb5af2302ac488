"""Anti-saturation system: integrates the force beyond its limits (paper Section 3.1.2, E8, A10)."""

from dataclasses import dataclass
from typing import Annotated

from dualwinch.model.quantities.quantity import NonNegative, Quantity, Tunable
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class AuxiliaryGains:
    """Gains of the anti-saturation system; the paper's single gamma cannot have both units (E8)."""

    gamma: Annotated[
        NonNegative,
        Quantity("m/(N s^2)", "weight of Z_a in the sliding surface", "A10"),
        Tunable(1e-8, 1e-3, of="1/plant.vehicle.mass"),
    ] = 1e-5
    gamma_force: Annotated[
        NonNegative, Quantity("1/s", "weight of Z_a in the force", "A10"), Tunable(1e-6, 10, standard=False)
    ] = 1e-5
    k_a: Annotated[NonNegative, Quantity("1/s", "decay rate of Z_a", "A10"), Tunable(0.01, 100)] = 1.0


def auxiliary_update(Z_a: Scalar, excess: Scalar, gains: AuxiliaryGains, sample_time: Scalar) -> Scalar:
    """Z_a in N s at the next sample, driven by the saturation excess u − u_sat in N."""
    return Z_a + sample_time * (-gains.k_a * Z_a + excess)
