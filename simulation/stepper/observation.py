"""What is observed of all runs at a sample, by name."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import UnknownNameError
from dualwinch.model.quantities.quantity import Quantity, nearest


class Observation(Mapping[str, NDArray[np.float64]]):
    """Signals of a sample, ahead of its command: ``observation["x_sensed"]`` is (batch,), one number a lane.

    Attributes:
        array: (signals, batch), the signals in their order.
        quantities: name → unit and meaning.
    """

    __slots__ = ("_rows", "array", "quantities")

    def __init__(self, array: NDArray[np.float64], rows: Mapping[str, int], quantities: Mapping[str, Quantity]) -> None:
        """Name the rows of an array: name → row."""
        self.array, self._rows, self.quantities = array, rows, quantities

    @property
    def units(self) -> dict[str, str]:
        """Name → unit."""
        return {name: quantity.unit for name, quantity in self.quantities.items()}

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """A signal of all lanes.

        Raises:
            UnknownNameError: it is not observed; the message names the nearest.
        """
        try:
            return self.array[self._rows[name]]
        except (KeyError, TypeError):
            raise UnknownNameError(
                f"signal {name!r} is not observed; did you mean '{nearest(str(name), self._rows)}'?"
            ) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        return f"Observation({len(self)} signals of {self.array.shape[1]} lanes: {', '.join(self)})"
