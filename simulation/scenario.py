"""A scenario: one draw of the uncertain values of an experiment."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

from dualwinch.model.plant import Plant
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.experiment import Experiment

Value: TypeAlias = float | int | bool | str
"""A value of an experiment."""


@dataclass(frozen=True)
class Scenario:
    """One draw of an ensemble: the drawn values. Its experiment is built from them on first use.

    Attributes:
        index: number in the ensemble, from 0.
        base: the experiment without the draws.
        nominal: the plant the controller was designed for, without the draws.
        draws: key → drawn value, ``simulation.seed`` among them.
        vertex: whether it is a vertex of the box of draws instead of a random draw.
        hard: whether it was picked for its difficulty: it counts in worst cases but not in means.
    """

    index: int
    base: Experiment
    nominal: Plant
    draws: dict[str, Value]
    vertex: bool = False
    hard: bool = False

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment with the drawn values.

        Raises:
            ConfigurationError: a drawn value is out of its range.
        """
        return with_leaves(self.base, self.draws)

    def having(self, settings: Mapping[str, Any]) -> "Scenario":
        """The scenario with other values for some keys, drawn or not.

        Raises:
            ConfigurationError: a value that the base experiment does not allow.
        """
        draws = {key: value for key, value in self.draws.items() if key not in settings}
        return replace(self, base=with_leaves(self.base, settings), draws=draws)
