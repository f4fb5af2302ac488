"""Action spaces, and the commands that actions stand for."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError

Floats = NDArray[np.float64]


class Actions:
    """Commands as actions: in their own units by name, a single one without, or all between −1 and 1.

    Attributes:
        space: of one lane: `Box` of a number, `Dict` of such, or, normalised, `Box` of a vector.
    """

    def __init__(self, limits: Mapping[str, tuple[float, float]], *, normalised: bool) -> None:
        """Make the space; limits: name of each number of a command → its lowest and highest value."""
        self._names, self._normalised = tuple(limits), normalised
        self._lower, self._upper = np.array(list(limits.values())).T
        self.space: gymnasium.Space[Any]
        if normalised:
            self.space = gymnasium.spaces.Box(-1.0, 1.0, (len(limits),), np.float64)
        elif len(limits) == 1:
            self.space = _box(*next(iter(limits.values())))
        else:
            self.space = gymnasium.spaces.Dict({name: _box(*ends) for name, ends in limits.items()})

    def commands(self, actions: Any, lanes: int) -> Floats:
        """The commands (lanes, numbers) that actions of some lanes stand for.

        Raises:
            ConfigurationError: they are none.
        """
        try:
            columns = actions if self._normalised else self._columns(actions)
            given = np.asarray(columns, dtype=np.float64).reshape(lanes, len(self._names))
        except (TypeError, ValueError, KeyError, IndexError) as error:
            raise ConfigurationError(f"action: must be of {self.space}, for each of {lanes} lanes") from error
        if not self._normalised:
            return given
        return self._lower + (given + 1) / 2 * (self._upper - self._lower)

    def _columns(self, actions: Any) -> Any:
        if len(self._names) == 1:
            return actions
        return np.stack([np.asarray(actions[name], dtype=np.float64) for name in self._names], axis=-1)


def _box(lowest: float, highest: float) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(lowest, highest, (), np.float64)
