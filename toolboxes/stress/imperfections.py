"""Imperfections: the differences between an ensemble and its base, in groups that are scaled together."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from dualwinch.toolbox import (
    ConfigurationError,
    Controller,
    Ensemble,
    Experiment,
    Leaf,
    Mark,
    Scenario,
    description,
    ensembles,
    leaves,
    physics,
    preparation,
    structures,
    tree,
    with_leaves,
)
from dualwinch.toolboxes.stress.limits import SHARE, unit_of, with_unit

MACHINE = ("plant.", "disturbance.", "sensors.", "actuator.", "simulation.")
"""Prefixes of the keys of a machine and its environment. A key elsewhere is an imperfection only if it is drawn."""

METHOD = frozenset({"simulation.substeps", ensembles.SEED_KEY})
"""Keys besides `Mark.TIMING` of the numerical method, not of the machine."""

NUMBERED = re.compile(r"_[12](?=[._]|$)")
"""The number of a rope or winch in a key."""

ALL = "all together"
"""Name of all imperfections at once."""


@dataclass(frozen=True)
class Imperfection:
    """Keys that are scaled together.

    Attributes:
        name: their key without the numbers of ropes and winches, such as ``plant.winch.drum_radius``, or `ALL`.
        keys: of the values, those of both ropes or winches.
    """

    name: str
    keys: tuple[str, ...]

    @property
    def label(self) -> str:
        """The name in words, such as ``winch drum radius``."""
        words = self.name.removesuffix(".kind")
        return (words.partition(".")[2] or words).replace(".", " ").replace("_", " ")


def union(base: Ensemble, ensemble: Ensemble) -> Ensemble:
    """The ensemble on top of a base: with the base's distributions for all keys that the ensemble does not draw.

    Raises:
        ConfigurationError: gains are drawn; a stress test needs fixed ones.
    """
    together = {**base.distributions, **ensemble.distributions}
    for key in together:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: is drawn in an ensemble; a stress test needs fixed gains")
    return Ensemble(ensemble.name, ensemble.description, ensemble.experiment, together)


def imperfections(base: Ensemble, ensemble: Ensemble) -> tuple[Imperfection, ...]:
    """Imperfections of an ensemble (`union`) that its base lacks, in the order of the keys.

    An imperfection is a number that is drawn or set differently, a switch, or a part of another kind with all its
    numbers. Keys that differ only in the number of a rope or winch form one imperfection. Excluded are motion, metrics,
    numerical method, and shape parameters (`Mark.SHAPE_PARAMETER`).

    Raises:
        ConfigurationError: there are none.
    """
    base_values, ensemble_values = leaves(base.experiment), leaves(ensemble.experiment)
    descriptions = description.describe_parts(ensemble.experiment)
    kinds = [
        key
        for key, leaf in descriptions.items()
        if Mark.PART in leaf.marks and base_values.get(key) != ensemble_values[key]
    ]
    groups: dict[str, list[str]] = {}
    for key, leaf in descriptions.items():
        distribution = ensemble.distributions.get(key)
        if not (_scalable(key, leaf, distribution) and _differs(key, distribution, base, base_values, ensemble_values)):
            continue
        owner = next(
            (kind for kind in kinds if key not in base_values and key.startswith(kind.rpartition(".")[0] + ".")), key
        )
        groups.setdefault(NUMBERED.sub("", owner), []).append(key)
    if not groups:
        raise ConfigurationError(
            f"ensemble '{ensemble.name}': has no imperfection that its base '{base.name}' lacks; give another base"
        )
    return tuple(Imperfection(name, tuple(keys)) for name, keys in groups.items())


def all_together(single: tuple[Imperfection, ...]) -> Imperfection:
    """All imperfections as one."""
    return Imperfection(ALL, tuple(key for imperfection in single for key in imperfection.keys))


def _scalable(key: str, leaf: Leaf, distribution: ensembles.Drawn | None) -> bool:
    if key in METHOD or not leaf.marks.isdisjoint({Mark.TIMING, Mark.PARTS, Mark.SHAPE_PARAMETER}):
        return False
    if distribution is not None:
        return True
    if not key.startswith(MACHINE):
        return False
    return leaf.kind in {float, int, bool} or Mark.PART in leaf.marks


def _differs(
    key: str,
    distribution: ensembles.Drawn | None,
    base: Ensemble,
    base_values: Mapping[str, Any],
    ensemble_values: Mapping[str, Any],
) -> bool:
    if distribution != base.distributions.get(key):
        return True
    follows = distribution is None or distribution.relative
    return follows and base_values.get(key) != ensemble_values[key]


SHAPING = {Mark.SHAPES_CODE, Mark.SHAPES_CODE_AT_ZERO}
"""Marks of numbers that may need more sub-steps than the ensemble has."""

MOST_SUBSTEPS = 16
"""Largest number of sub-steps per sample of a size: more would take longer than all other sizes together."""

SWITCHED_AT = 1.0
"""Size from which a switch, or a part, has the ensemble's value; there are no intermediate ones."""


def between(leaf: Leaf, base: Any, ensemble: Any, size: float) -> Any:
    """Interpolate a value linearly: the base's at size 0, the ensemble's at 1, extrapolated beyond.

    Whole numbers are rounded. Counts per turn decrease with size, because their step is interpolated. A value that is
    no number is the ensemble's from size `SWITCHED_AT` on.
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
    """Whether a number is a number of steps that a quantity is resolved into; 0: not quantised."""
    return leaf.kind is int and Mark.READS_IN_STEPS in leaf.marks


def _step(number: int) -> float:
    return 1 / number if number else 0.0


@dataclass(frozen=True)
class ScaledEnsemble:
    """Scenarios interpolated between a base and an ensemble, and extrapolated beyond.

    Attributes:
        base: at size 0; its own imperfections are in every scenario.
        ensemble: at size 1 of all imperfections, from `union`.
        single: the imperfections.
        count: number of scenarios.
        seed: of the draws.
        controllers: with which runs must be able to start; default: that of the base.
    """

    base: Ensemble
    ensemble: Ensemble
    single: tuple[Imperfection, ...]
    count: int
    seed: int
    controllers: tuple[Controller, ...] = ()

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """All scaled keys."""
        return tuple(key for imperfection in self.single for key in imperfection.keys)

    @cached_property
    def known(self) -> dict[str, Leaf]:
        """Description of every key of the base and of the ensemble."""
        return {
            **description.describe_parts(self.base.experiment),
            **description.describe_parts(self.ensemble.experiment),
        }

    @cached_property
    def _start(self) -> Ensemble:
        """The base with all of the ensemble that is no imperfection: motion, metrics, method, shape parameters."""
        values, keys = leaves(self.base.experiment), set(self.keys)
        unscaled = {key: values[key] for key in self.keys if key in values}
        distributions = {
            key: distribution for key, distribution in self.ensemble.distributions.items() if key not in keys
        }
        distributions |= {key: distribution for key, distribution in self.base.distributions.items() if key in keys}
        return replace(
            self.base, experiment=with_leaves(self.ensemble.experiment, unscaled), distributions=distributions
        )

    @cached_property
    def _bases(self) -> dict[Controller, Experiment]:
        """Controller → the base's experiment with it, shared by all scenarios and sizes."""
        return {}

    @cached_property
    def _ends(self) -> list[tuple[Scenario, dict[str, Any], dict[str, Any]]]:
        """Every scenario of the base, with the scaled values there and in the ensemble."""
        starts, ends = (drawn_from.chosen(range(self.count), self.seed) for drawn_from in (self._start, self.ensemble))
        return [(start, self._of(start), self._of(end)) for start, end in zip(starts, ends, strict=True)]

    def _of(self, scenario: Scenario) -> dict[str, Any]:
        values = leaves(scenario.experiment)
        return {key: values[key] for key in self.keys if key in values}

    def values(self, index: int, sizes: Mapping[str, float]) -> dict[str, Any]:
        """Scaled key → its value in the scenario of a number; sizes are by key, by default 0."""
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
        self, index: int, controller: Controller, sizes: Mapping[str, float], nominal: physics.Plant | None = None
    ) -> Scenario:
        """The scenario of a number; `nominal` is the plant for which the controller was designed, if already known.

        At every size, all scaled keys are among its draws, so that the same compiled code runs all scenarios of the
        same structure.
        """
        draws = self._ends[index][0].draws | self.values(index, sizes) | self._substeps(sizes)
        if controller not in self._bases:
            self._bases[controller] = replace(self._start.experiment, controller=controller)
        return Scenario(index, self._bases[controller], nominal or self.nominal(sizes), draws)

    def _substeps(self, sizes: Mapping[str, float]) -> dict[str, Any]:
        """The number of sub-steps that all scenarios of given sizes need, if it is more than the ensemble's.

        A light drum or a very light rope swings faster than those of the ensemble. Beyond `MOST_SUBSTEPS` the obstacle
        states the required number.
        """
        shaping = {key: size for key, size in sizes.items() if not self.known[key].marks.isdisjoint(SHAPING)}
        cache = self._needed_substeps
        shape = tuple(sorted(shaping.items()))
        if shape not in cache:
            simulation, needed = self._start.experiment.simulation, 0.0
            for index in range(self.count):
                values = self._ends[index][0].draws | self.values(index, sizes)
                plant = {key: value for key, value in values.items() if key.startswith("plant.")}
                experiment = with_leaves(self._start.experiment, plant)
                if structures.is_automatic(experiment):
                    break
                integrator = structures.solver_of(experiment).integrator
                try:
                    limits = experiment.controller.limits
                    substeps = float(structures.substeps_for(experiment.plant, simulation, integrator, limits))
                except ArithmeticError:
                    substeps = math.inf
                if not math.isfinite(substeps):  # values not allowed; `prepare` gives the reason
                    break
                needed = max(needed, substeps)
            power = 1 << math.ceil(math.log2(max(needed, 1)))
            cache[shape] = min(power, MOST_SUBSTEPS) if needed > simulation.substeps else simulation.substeps
        substeps_needed = cache[shape]
        return (
            {}
            if substeps_needed == self._start.experiment.simulation.substeps
            else {"simulation.substeps": substeps_needed}
        )

    @cached_property
    def _needed_substeps(self) -> dict[tuple[tuple[str, float], ...], int]:
        """Sizes of the keys with marks `SHAPING` → sub-steps."""
        return {}

    def switched(self, imperfection: Imperfection) -> bool:
        """Whether an imperfection is a switch or a part, without intermediate sizes."""
        values = leaves(self.base.experiment)
        return not any(self.known[key].kind in {int, float} and key in values for key in imperfection.keys)

    def compiled(self, imperfection: Imperfection) -> bool:
        """Whether each size of an imperfection needs its own compiled code."""
        return any(Mark.SHAPES_CODE in self.known[key].marks for key in imperfection.keys)

    def stiffens(self, imperfection: Imperfection) -> bool:
        """Whether small sizes of an imperfection may swing faster than large ones: keys with marks `SHAPING`."""
        return any(not self.known[key].marks.isdisjoint(SHAPING) for key in imperfection.keys)

    def scenarios(self, controller: Controller, sizes: Mapping[str, float]) -> list[Scenario]:
        """All scenarios."""
        nominal = self.nominal(sizes)
        return [self.scenario(index, controller, sizes, nominal) for index in range(self.count)]

    def nominal(self, sizes: Mapping[str, float]) -> physics.Plant:
        """The plant for which a controller was designed: with the values that are set, without the draws."""
        base, ensemble = (leaves(each.experiment.plant, "plant.") for each in (self._start, self.ensemble))
        mixed = self._between(base, ensemble, sizes)
        return with_leaves(self._start.experiment.plant, mixed, "plant.")

    def obstacle(self, sizes: Mapping[str, float]) -> str:
        """Error of given sizes in one line; empty if all their scenarios are allowed."""
        for index in range(self.count):
            values = self.values(index, sizes)
            for key in sizes:
                if key in values and not self.known[key].admits(values[key]):
                    return f"{key}: must be {self.known[key].wanted}"
            try:
                for controller in self.controllers or (self._start.experiment.controller,):
                    preparation.prepare(self.scenario(index, controller, sizes).experiment)
            except ConfigurationError as error:
                return str(error)
        return ""


@dataclass(frozen=True)
class ImperfectionSize:
    """Physical size of an imperfection.

    Attributes:
        low, high: least and largest deviation of a drawn value from the base's nominal value; both the value itself if
            it is set, not drawn; ``None`` if it is no number.
        unit: of both; `SHARE` for shares, such as those of the base's nominal value.
        drawn: whether it is drawn.
        text: of a value that is no number.
        nominal: nominal value, added to asymmetric deviations in text; 0 for shares.
    """

    low: float | None
    high: float | None
    unit: str
    drawn: bool
    text: str = ""
    nominal: float = 0.0

    def __str__(self) -> str:
        """Such as ``±0.2 %``, or the values, ``100 to 1000 N s/m``, if the deviations are asymmetric."""
        if self.low is None or self.high is None:
            return self.text
        if self.drawn and self.low < self.high and abs(self.low + self.high) <= 1e-9 * abs(self.high):
            (high,), unit = with_unit([self.high], self.unit)
            return f"±{high}{unit}"
        (low, high), unit = with_unit([self.nominal + self.low, self.nominal + self.high], self.unit)
        return f"{low} to {high}{unit}" if low != high else f"{high}{unit}"


def amount_of(scaling: ScaledEnsemble, imperfection: Imperfection, size: float) -> ImperfectionSize | None:
    """Physical size of an imperfection, of its value that deviates most; ``None`` for all together."""
    if imperfection not in scaling.single:
        return None
    amounts = [_of_key(scaling, key, size) for key in imperfection.keys]
    parts = [
        amount for amount, key in zip(amounts, imperfection.keys, strict=True) if Mark.PART in scaling.known[key].marks
    ]
    return max(parts or amounts, key=lambda amount: max(abs(amount.low or 0.0), abs(amount.high or 0.0)))


def _of_key(scaling: ScaledEnsemble, key: str, size: float) -> ImperfectionSize:
    leaf = scaling.known[key]
    base, ensemble = (leaves(each.experiment).get(key) for each in (scaling.base, scaling.ensemble))
    distribution = scaling.ensemble.distributions.get(key)
    if distribution is None or base is None or ensemble is None or leaf.kind not in {int, float}:
        value = between(leaf, base, ensemble, size)
        if isinstance(value, bool | str) or value is None:
            return ImperfectionSize(
                None, None, "", drawn=False, text=value if isinstance(value, str) else tree.shown(value)
            )
        return ImperfectionSize(value, value, unit_of(leaf.quantity), drawn=False)
    base_distribution, ensemble_ends = scaling.base.distributions.get(key), distribution.ends(ensemble)
    base_ends = base_distribution.ends(base) if base_distribution else ()
    base_ends = base_ends if len(base_ends) == len(ensemble_ends) else [base] * len(ensemble_ends)
    ends = [between(leaf, *pair, size) - base for pair in zip(base_ends, ensemble_ends, strict=True)]
    shares = distribution.relative and base == ensemble != 0
    low, high = min(ends), max(ends)
    if shares:
        return ImperfectionSize(low / abs(base), high / abs(base), SHARE, drawn=True)
    return ImperfectionSize(low, high, unit_of(leaf.quantity), drawn=True, nominal=base)
