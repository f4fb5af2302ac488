"""What a batch is asked for, checked before anything runs: names, shapes, every row's ranges, scenarios that fit."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.controller import Controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Leaf, Mark, nearest
from dualwinch.model.quantities.tree import leaves, rules, with_leaves
from dualwinch.simulation.check import check
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators.solver import solver_of
from dualwinch.simulation.loop.structure import Structure, described_parameters, structure_of

Floats = NDArray[np.float64]

BOUNDS = {"gt": np.greater, "ge": np.greater_equal, "lt": np.less, "le": np.less_equal}
"""Bound of a constraint of `annotated_types` → what holds between a value and it."""


def check_batch(names: Sequence[str], values: Floats, scenarios: Sequence[Experiment | Scenario]) -> None:
    """Raise `ConfigurationError` where a batch cannot be run as asked; see `simulation.batch.rollout.rollout`."""
    if not scenarios:
        raise ConfigurationError("scenarios: must be at least one experiment")
    experiments = [given.experiment if isinstance(given, Scenario) else given for given in scenarios]
    first, structure = experiments[0], structure_of(experiments[0])
    described = described_parameters(structure)
    known = [name for name, leaf in described.items() if Mark.TIMING not in leaf.marks]
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown parameter '{name}'; did you mean '{nearest(name, known)}'?")
    if values.ndim != 2 or values.shape[1] != len(names):
        raise ConfigurationError(f"parameters: shape {values.shape} must be (n, {len(names)}), a column for each name")
    columns = dict(zip(names, values.T, strict=True))
    _check_bounds(columns, described)
    for number, (scenario, experiment) in enumerate(zip(scenarios, experiments, strict=True)):
        try:
            check(experiment)
            _check_draws([name for name in names if Mark.SCALES_DRAWS in described[name].marks], experiment)
        except ConfigurationError as error:
            where = f"scenario {scenario.index}" if isinstance(scenario, Scenario) else f"scenarios[{number}]"
            raise ConfigurationError(f"{where}: {error}") from error
        if structure_of(experiment) != structure or experiment.samples != first.samples:
            raise ConfigurationError(f"scenarios[{number}]: must have the structure and the length of scenarios[0]")
    _check_together(columns, experiments, structure)


def _check_bounds(columns: Mapping[str, Floats], described: Mapping[str, Leaf]) -> None:
    """Each value's own range, whole columns at a time."""
    for name, column in columns.items():
        leaf = described[name]
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


def _check_draws(names: Iterable[str], experiment: Experiment) -> None:
    """What is drawn is drawn for the scenario, and without any there is nothing to scale."""
    given = leaves(experiment)
    for name in names:
        if given[name] == 0:
            raise ConfigurationError(f"{name} = 0: must be > 0 where it varies (without it nothing is drawn)")


def _check_together(columns: Mapping[str, Floats], experiments: Sequence[Experiment], structure: Structure) -> None:
    """Rules between values: rows that break one are shown to `check`, which has the words for it."""
    described = described_parameters(structure)
    whole_plant = any(name.startswith("plant.") for name in columns)
    checked: set[Controller] = set()
    for number, experiment in enumerate(experiments):
        if experiment.controller in checked and not whole_plant:
            continue
        checked.add(experiment.controller)
        suspect = np.full(len(next(iter(columns.values()))), whole_plant) if columns else np.zeros(0, bool)
        varied = with_leaves(experiment.controller, columns, "controller.")
        for _, group, rule in rules(varied):
            suspect |= ~np.asarray(rule.holds(group))
        for row in np.flatnonzero(suspect):
            where = f"parameters[{row}]" + (f" in scenarios[{number}]" if len(experiments) > 1 else "")
            changed = with_leaves(experiment, {name: _typed(described[name], c[row]) for name, c in columns.items()})
            try:
                check(changed)
                _check_substeps(changed, structure)
            except ConfigurationError as error:
                raise ConfigurationError(f"{where}: {error}") from error


def _check_substeps(experiment: Experiment, structure: Structure) -> None:
    """A row's own ropes may ask for more sub-steps than the scenarios'."""
    needed = solver_of(experiment).substeps
    if needed > structure.substeps:
        raise ConfigurationError(
            f"simulation.substeps = {structure.substeps}: must be >= {needed} for ropes as stiff as these"
        )


def _typed(leaf: Leaf, value: float) -> float | int:
    return math.floor(value) if leaf.kind is int else float(value)
