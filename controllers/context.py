"""What every part of a controller may know beside its own gains."""

from dataclasses import dataclass

from dualwinch.controllers.limits import Limits
from dualwinch.model.plant import Plant
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Context:
    """What all parts of a controller share.

    Attributes:
        nominal: the plant as the controller believes it to be.
        limits: preload and limits of the tensions.
        sample_time: in s.
    """

    nominal: Plant
    limits: Limits
    sample_time: Scalar
