"""Preview: setpoints of some times ahead, which a part of the controller may ask for.

A setpoint alone tells how a motion goes on: with its acceleration. What comes from outside is how the motion departs
from that. A cruise does not depart from it, and so needs no preview to be one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions.setpoint import Setpoint, later
from dualwinch.model.quantities.quantity import Mark, Quantity


@dataclass(frozen=True)
class Departures:
    """How a motion departs, at k times ahead, from going on with its acceleration: vectors (k,)."""

    x: Annotated[Any, Quantity("m", "departure of the reference position from speed and acceleration now")]
    v: Annotated[Any, Quantity("m/s", "departure of the reference speed from acceleration now")]
    a: Annotated[Any, Quantity("m/s^2", "departure of the reference acceleration from that now")]


def no_departures(times: Sequence[float]) -> Departures:
    """A motion that goes on as it is."""
    return Departures(*(np.zeros(len(times)) for _ in range(3)))


@dataclass(frozen=True)
class Previewed(Setpoint):
    """A setpoint, and those of some times ahead."""

    known: Annotated[Mapping[float, Setpoint], Mark.CONTENT] = field(default_factory=dict)

    def ahead(self, by: float) -> Setpoint:
        """Where the vehicle should be a time in s later.

        Raises:
            ConfigurationError: nobody asked for that time.
        """
        if by not in self.known:
            asked = ", ".join(f"{time:g}" for time in self.known) or "none"
            raise ConfigurationError(f"setpoint.ahead({by}): must be a time of the part's preview, {asked}")
        return self.known[by]


def previewed(setpoint: Setpoint, times: Sequence[float], departures: Departures | None = None) -> Previewed:
    """A setpoint with those of some times ahead.

    Args:
        setpoint: of now.
        times: ahead, in s.
        departures: of those times, floats or symbols; default: the motion goes on as it is.
    """
    known = {}
    for index, time in enumerate(times):
        point = later(setpoint, time)
        if departures is not None:
            by = departures.x[index], departures.v[index], departures.a[index]
            point = Setpoint(point.x + by[0], point.v + by[1], point.a + by[2])
        known[time] = point
    return Previewed(setpoint.x, setpoint.v, setpoint.a, known)
