"""What a batch is asked for, checked before anything runs: names, shapes, every row's ranges, scenarios that fit."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantity import Leaf, describe, nearest, with_leaves
from dualwinch.simulation.check import check
from dualwinch.simulation.ensembles.ensemble import TIMING, Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import parameters_of, structure_of

Floats = NDArray[np.float64]

NFTSM, COORDINATION = "controller.nftsm.", "controller.coordination."
"""What the keys of values that are bound to each other begin with."""

BOUNDS = {"gt": np.greater, "ge": np.greater_equal, "lt": np.less, "le": np.less_equal}
"""Bound of a constraint of `annotated_types` → what holds between a value and it."""


def check_batch(names: Sequence[str], values: Floats, scenarios: Sequence[Experiment | Scenario]) -> None:
    """Raise `ConfigurationError` where a batch cannot be run as asked; see `simulation.batch.rollout.rollout`."""
    if not scenarios:
        raise ConfigurationError("scenarios: must be at least one experiment")
    experiments = [one.experiment if isinstance(one, Scenario) else one for one in scenarios]
    first = experiments[0]
    known = parameters_of(first).keys() - TIMING
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown parameter '{name}'; did you mean '{nearest(name, sorted(known))}'?")
    if values.ndim != 2 or values.shape[1] != len(names):
        raise ConfigurationError(f"parameters: shape {values.shape} must be (n, {len(names)}), a column for each name")
    columns = dict(zip(names, values.T, strict=True))
    _check_bounds(columns)
    for number, (scenario, experiment) in enumerate(zip(scenarios, experiments, strict=True)):
        try:
            check(experiment)
            _check_noise(names, experiment)
        except ConfigurationError as error:
            where = f"scenario {scenario.index}" if isinstance(scenario, Scenario) else f"scenarios[{number}]"
            raise ConfigurationError(f"{where}: {error}") from error
        if structure_of(experiment) != structure_of(first) or experiment.samples != first.samples:
            raise ConfigurationError(f"scenarios[{number}]: must have the structure and the length of scenarios[0]")
    if any(name.startswith((NFTSM, COORDINATION, "plant.")) for name in names):
        _check_together(columns, experiments)


@cache
def _leaves() -> dict[str, Leaf]:
    known = describe(Experiment)
    return known | {f"nominal.{key}": leaf for key, leaf in describe(Plant).items()}


def _check_bounds(columns: Mapping[str, Floats]) -> None:
    """Each value's own range, whole columns at a time."""
    for name, column in columns.items():
        leaf = _leaves()[name]
        wrong, allowed = ~np.isfinite(column), leaf.allowed or "finite"
        for constraint in leaf.constraints:
            for word, holds in BOUNDS.items():
                bound = getattr(constraint, word, None)
                if bound is not None:
                    wrong |= ~holds(column, bound)
        if leaf.kind is int:
            wrong |= column != np.rint(column)
            allowed = f"a whole number {leaf.allowed}".strip()
        elif leaf.kind is bool:
            wrong |= (column != 0) & (column != 1)
            allowed = "0 or 1"
        if wrong.any():
            row = int(wrong.argmax())
            raise ConfigurationError(f"parameters[{row}]: {name} = {column[row]:g}: must be {allowed}")


def _check_noise(names: Iterable[str], experiment: Experiment) -> None:
    """Noise is drawn for the scenario, and for a sensor without any there is nothing to scale."""
    for name in names:
        if name.startswith("sensors.") and name.endswith("_noise"):
            given = getattr(experiment.sensors, name.removeprefix("sensors."))
            if given == 0:
                raise ConfigurationError(f"{name} = 0: must be > 0 where it varies (without it no noise is drawn)")


def _check_together(columns: Mapping[str, Floats], experiments: Sequence[Experiment]) -> None:
    """Rules between values: rows that may break one are looked at by `check`, which has the words for it."""
    rows = len(next(iter(columns.values())))
    limits = ("tension_min", "tension_max", "reserve", "preload")
    bound = (NFTSM + "p", NFTSM + "q", *(COORDINATION + name for name in limits))
    of_the_plant = any(name.startswith("plant.") for name in columns)
    seen: set[tuple[float, ...]] = set()
    for number, experiment in enumerate(experiments):
        given = parameters_of(experiment)
        own = tuple(given[name] for name in bound)
        if own in seen and not of_the_plant:
            continue
        seen.add(own)
        p, q, least, most, reserve, preload = (columns.get(name, np.full(rows, given[name])) for name in bound)
        suspect = (p % 2 == 0) | (q % 2 == 0) | (p <= q) | ~(least < most - reserve)
        suspect |= ~((2 * least < preload) & (preload < 2 * (most - reserve))) | of_the_plant
        for row in np.flatnonzero(suspect):
            changes = {name: _typed(name, column[row]) for name, column in columns.items()}
            try:
                check(with_leaves(experiment, changes))
            except ConfigurationError as error:
                where = f"parameters[{row}]" + (f" in scenarios[{number}]" if len(experiments) > 1 else "")
                raise ConfigurationError(f"{where}: {error}") from error


def _typed(name: str, value: float) -> float | int:
    return math.floor(value) if _leaves()[name].kind is int else float(value)
