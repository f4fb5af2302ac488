"""Scenarios with imperfections of any size: as far from the base as the ensemble is, times a factor.

Base and ensemble draw a value from the same random stream, so that they meet the same quantile of their distributions
in the same scenario. A value of size s is ``base + s (ensemble - base)``: the base at 0, the ensemble at 1. So the
spread of a distribution about the base's value is multiplied by s, and so is the distance of a value that is set. Two
scenarios of the same number differ in the size alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from dualwinch.controllers.controller import Controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.check import check
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.stress.imperfection import Imperfection, believed

SWITCHED_AT = 1.0
"""Size from which on a switch is thrown, or a part is of the ensemble's kind: there is nothing in between."""


def between(leaf: Leaf, base: Any, ensemble: Any, size: float) -> Any:
    """A value of some size: that of the base at 0, that of the ensemble at 1, and on from there.

    Whole numbers are rounded. Counts a turn become fewer, as it is their step that grows. What is no number is there
    from size `SWITCHED_AT` on.
    """
    if size == 1 or base == ensemble:
        return ensemble
    if leaf.kind not in {int, float} or base is None or ensemble is None:
        return ensemble if size >= SWITCHED_AT else base
    if counts(leaf):
        step = _step(base) + size * (_step(ensemble) - _step(base))
        return max(round(1 / step), 1) if step > 0 else 0
    value = base + size * (ensemble - base)
    return round(value) if leaf.kind is int else value


def counts(leaf: Leaf) -> bool:
    """Whether a number says into how many steps something is divided; 0 is without steps."""
    return leaf.kind is int and Mark.READS_IN_STEPS in leaf.marks


def _step(number: int) -> float:
    return 1 / number if number else 0.0


@dataclass(frozen=True)
class Scaling:
    """The scenarios of a base and of an ensemble, and all between and beyond.

    Attributes:
        base: at size 0; its own imperfections are in every scenario.
        ensemble: at size 1 of all imperfections, as by `union`.
        single: the imperfections.
        count: number of scenarios.
        seed: of the draws.
    """

    base: Ensemble
    ensemble: Ensemble
    single: tuple[Imperfection, ...]
    count: int
    seed: int

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Of all that is scaled."""
        return tuple(key for imperfection in self.single for key in imperfection.keys)

    @cached_property
    def known(self) -> dict[str, Leaf]:
        """What every key is, of the base and of the ensemble."""
        return {**describe_parts(self.base.experiment), **describe_parts(self.ensemble.experiment)}

    @cached_property
    def _start(self) -> Ensemble:
        """The base with all of the ensemble that is no imperfection: motion, metrics, method, courses."""
        values, keys = leaves(self.base.experiment), set(self.keys)
        own = {key: values[key] for key in self.keys if key in values}
        drawn = {key: drawn for key, drawn in self.ensemble.distributions.items() if key not in keys}
        drawn |= {key: drawn for key, drawn in self.base.distributions.items() if key in keys}
        return replace(self.base, experiment=with_leaves(self.ensemble.experiment, own), distributions=drawn)

    @cached_property
    def _bases(self) -> dict[Controller, Experiment]:
        """Controller → the base's experiment with it: the same of all scenarios and sizes."""
        return {}

    def _base_with(self, controller: Controller) -> Experiment:
        if controller not in self._bases:
            self._bases[controller] = replace(self._start.experiment, controller=controller)
        return self._bases[controller]

    @cached_property
    def _ends(self) -> list[tuple[Scenario, dict[str, Any], dict[str, Any]]]:
        """Every scenario of the base, with its values there and in the ensemble."""
        starts, ends = (drawn.chosen(range(self.count), self.seed) for drawn in (self._start, self.ensemble))
        return [(start, self._of(start), self._of(end)) for start, end in zip(starts, ends, strict=True)]

    def _of(self, scenario: Scenario) -> dict[str, Any]:
        values = leaves(scenario.experiment)
        return {key: values[key] for key in self.keys if key in values}

    def values(self, index: int, sizes: Mapping[str, float]) -> dict[str, Any]:
        """What is scaled in a scenario.

        Args:
            index: number of the scenario.
            sizes: key → size; 0 where it is not given.
        """
        _, base, ensemble = self._ends[index]
        return self._between(base, ensemble, sizes)

    def _between(
        self, base: Mapping[str, Any], ensemble: Mapping[str, Any], sizes: Mapping[str, float]
    ) -> dict[str, Any]:
        keys = [key for key in self.keys if key in base or key in ensemble]
        return {
            key: between(self.known[key], base.get(key), ensemble.get(key), sizes.get(key, 0.0))
            for key in keys
            if key in base or sizes.get(key, 0.0) >= SWITCHED_AT
        }

    def scenario(
        self, index: int, controller: Controller, sizes: Mapping[str, float], nominal: Plant | None = None
    ) -> Scenario:
        """One scenario.

        Whatever its sizes, all that may be scaled is among its draws: so every scenario is run by the same compiled
        code, unless it asks for another structure.

        Args:
            index: its number.
            controller: with the gains.
            sizes: key → size; 0 where it is not given.
            nominal: the plant the controller was designed for, where it is known (`nominal`).

        """
        draws = self._ends[index][0].draws | self.values(index, sizes)
        return Scenario(index, self._base_with(controller), nominal or self.nominal(sizes), draws)

    def switched(self, imperfection: Imperfection) -> bool:
        """Whether an imperfection is there or not, with nothing in between."""
        values = leaves(self.base.experiment)
        return not any(self.known[key].kind in {int, float} and key in values for key in imperfection.keys)

    def compiled(self, imperfection: Imperfection) -> bool:
        """Whether each size of an imperfection is compiled code of its own."""
        return any(Mark.SHAPES_CODE in self.known[key].marks for key in imperfection.keys)

    def scenarios(self, controller: Controller, sizes: Mapping[str, float]) -> list[Scenario]:
        """All of them."""
        nominal = self.nominal(sizes)
        return [self.scenario(index, controller, sizes, nominal) for index in range(self.count)]

    def nominal(self, sizes: Mapping[str, float]) -> Plant:
        """The plant a controller was designed for: it knows what is set, and not what is drawn."""
        ours, theirs = believed(self._start.experiment), believed(self.ensemble.experiment)
        mixed = self._between(ours, theirs, sizes)
        return with_leaves(self._start.experiment.plant, mixed, "plant.")

    def obstacle(self, sizes: Mapping[str, float]) -> str:
        """What is wrong with some sizes, in one line; empty where all their scenarios are allowed."""
        for index in range(self.count):
            values = self.values(index, sizes)
            for key in sizes:
                if key in values and not self.known[key].admits(values[key]):
                    return f"{key}: must be {self.known[key].wanted}"
            try:
                check(self.scenario(index, self._start.experiment.controller, sizes).experiment)
            except ConfigurationError as error:
                return str(error)
        return ""
