"""What a batch is asked for, checked before anything runs: names, shapes, every row's ranges, scenarios that fit."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.controller import Controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Leaf, Mark, nearest
from dualwinch.model.quantities.tree import leaves, rules, with_leaves
from dualwinch.simulation.batch.doubts import breaks, doubtful, out_of_range
from dualwinch.simulation.batch.family import Family, Scenarios, experiment_of, families, name_of
from dualwinch.simulation.check import check
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators.solver import solver_of
from dualwinch.simulation.loop.structure import Structure, described_parameters, structure_of

Floats = NDArray[np.float64]


def check_batch(names: Sequence[str], values: Floats, scenarios: Scenarios) -> list[Family]:
    """The scenarios of a batch as families.

    Raises:
        ConfigurationError: it cannot be run as asked; see `simulation.batch.rollout.rollout`.
    """
    if not scenarios:
        raise ConfigurationError("scenarios: must be at least one experiment")
    kin = families(scenarios)
    first = kin[0].experiment
    structure = structure_of(first)
    described = described_parameters(structure)
    known = [name for name, leaf in described.items() if Mark.TIMING not in leaf.marks]
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown parameter '{name}'; did you mean '{nearest(name, known)}'?")
    check_shape(names, values)
    columns = dict(zip(names, values.T, strict=True))
    _check_bounds(columns, described)
    scaling = [name for name in names if Mark.SCALES_DRAWS in described[name].marks]
    for family in kin:
        _check_family(family, scenarios, scaling)
        if structure_of(family.experiment) != structure or family.experiment.samples != first.samples:
            place = family.members[0]
            raise ConfigurationError(f"scenarios[{place}]: must have the structure and the length of scenarios[0]")
    _check_together(columns, kin, scenarios, structure)
    return kin


def check_shape(names: Sequence[str], values: Floats) -> None:
    """Raise `ConfigurationError` where values are not sets with a value for each name."""
    if values.ndim != 2 or values.shape[1] != len(names):
        raise ConfigurationError(f"parameters: shape {values.shape} must be (n, {len(names)}), a column for each name")


def _check_family(family: Family, scenarios: Scenarios, scaling: Iterable[str]) -> None:
    """Members in doubt are shown to `check`, which has the words for what is wrong with them."""
    for place in family.members[doubtful(family)]:
        try:
            check(experiment_of(scenarios[place]))
        except ConfigurationError as error:
            raise ConfigurationError(f"{name_of(scenarios[place], place)}: {error}") from error
    for name in scaling:
        values = family.columns[name] if name in family.columns else leaves(family.experiment)[name]
        silent = np.broadcast_to(values == 0, len(family.members))
        if silent.any():  # what is drawn is drawn for the scenario, and without any there is nothing to scale
            place = family.members[silent.argmax()]
            where = name_of(scenarios[place], place)
            raise ConfigurationError(f"{where}: {name} = 0: must be > 0 where it varies (without it nothing is drawn)")


def _check_bounds(columns: Mapping[str, Floats], described: Mapping[str, Leaf]) -> None:
    """Each value's own range, whole columns at a time."""
    for name, column in columns.items():
        leaf = described[name]
        wrong, allowed = out_of_range(leaf, column), leaf.allowed or "finite"
        if leaf.kind is int:
            allowed = f"a whole number {leaf.allowed}".strip()
        elif leaf.kind is bool:
            wrong |= (column != 0) & (column != 1)
            allowed = "0 or 1"
        if wrong.any():
            row = int(wrong.argmax())
            raise ConfigurationError(f"parameters[{row}]: {name} = {column[row]:g}: must be {allowed}")


def _check_together(
    columns: Mapping[str, Floats], kin: Sequence[Family], scenarios: Scenarios, structure: Structure
) -> None:
    """Rules between values: rows that break one are shown to `check`, which has the words for it."""
    if not columns:
        return
    rows = len(next(iter(columns.values())))
    whole_plant = any(name.startswith("plant.") for name in columns)
    if whole_plant:  # ropes, drums and loads of each scenario
        suspects = [(place, range(rows)) for place in range(len(scenarios))]
    else:
        first = {family.experiment.controller: family.members[0] for family in reversed(kin)}
        suspects = [(place, _breaking(controller, columns)) for controller, place in first.items()]
    described = described_parameters(structure)
    for place, chosen in suspects:
        for row in chosen:
            where = f"parameters[{row}]" + (f" in scenarios[{place}]" if len(scenarios) > 1 else "")
            values = {name: _typed(described[name], column[row]) for name, column in columns.items()}
            changed = with_leaves(experiment_of(scenarios[place]), values)
            try:
                check(changed)
                _check_substeps(changed, structure)
            except ConfigurationError as error:
                raise ConfigurationError(f"{where}: {error}") from error


def _breaking(controller: Controller, columns: Mapping[str, Floats]) -> Iterable[int]:
    """Rows that break a rule of a controller."""
    broken = np.zeros(len(next(iter(columns.values()))), bool)
    for _, group, rule in rules(with_leaves(controller, columns, "controller.")):
        broken |= breaks(rule, group)
    return np.flatnonzero(broken)


def _check_substeps(experiment: Experiment, structure: Structure) -> None:
    """A row's own ropes may ask for more sub-steps than the scenarios'."""
    needed = solver_of(experiment).substeps
    if needed > structure.substeps:
        raise ConfigurationError(
            f"simulation.substeps = {structure.substeps}: must be >= {needed} for ropes as stiff as these"
        )


def _typed(leaf: Leaf, value: float) -> float | int:
    return math.floor(value) if leaf.kind is int else float(value)
