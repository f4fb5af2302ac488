"""The estimator that a search starts with where nobody says which."""

from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble

OF_A_WINCH = ("drum_radius", "radius_error", "eccentricity", "layer_thickness")
OF_A_SENSOR = ("encoder_zero_1", "encoder_zero_2", "position_bias", "position_drift", "outage_length")
MISLEADING = frozenset(
    (
        *(f"plant.winch_{number}.{name}" for number in (1, 2) for name in OF_A_WINCH),
        *(f"plant.creep_{number}.elongation" for number in (1, 2)),
        *(f"sensors.{name}" for name in OF_A_SENSOR),
    )
)
"""Keys of what an estimator is misled by that takes drums and encoder zeros for exact."""


def first_estimator(ensemble: Ensemble) -> str:
    """The kind of filter for an ensemble: noisy sensors, inexact ropes, and maybe drums that nobody knows exactly."""
    known = leaves(ensemble.experiment)
    misled = any(key in ensemble.distributions for key in MISLEADING)
    misled |= any(known[key] for key in MISLEADING if not key.endswith(("drum_radius", "layer_thickness")))
    return "self-calibrating-kalman" if misled else "calibrating-kalman"
