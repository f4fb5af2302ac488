"""What acted on the vehicle along the track and is in no log, as a signal that experiments take."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.signals import Signal
from dualwinch.simulation.results.content import Content

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Force:
    """A force over the time of a log.

    Attributes:
        log: its name.
        t: (n,) in s.
        force: (n,) in N: what would have acted on the vehicle were there neither current nor a changing load on the
            rail; vortices, which the model has, do not count.
        deviation: (n,) standard deviation in N, the machine being as it was found.
    """

    log: str
    t: Floats
    force: Floats
    deviation: Floats

    @property
    def signal(self) -> Signal:
        """As ``disturbance.force`` takes it; current and changing rail load are in it already."""
        return Signal.from_arrays(self.t, self.force, unit="N")

    @property
    def content(self) -> Content:
        """As a file holds it."""
        quantities = {"t": Quantity("s", "time"), "force": Quantity("N", "force on the vehicle along the track")}
        return Content({"t": self.t, "force": self.force}, quantities, {"log": self.log})
