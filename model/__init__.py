"""The physics: parameters, ropes, vehicle, winches, disturbances, references, and the plant they make."""

from dualwinch.model.plant import Plant, plant

__all__ = ["Plant", "plant"]
