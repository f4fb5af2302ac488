"""Which members of a family may be out of range: columns are looked at as a whole, and `check` has the words."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Rule
from dualwinch.model.quantities.tree import rules
from dualwinch.simulation.batch.family import Family
from dualwinch.simulation.check import check, fastest_swing, substeps_for
from dualwinch.simulation.integrators.solver import is_automatic
from dualwinch.simulation.loop.start import starts
from dualwinch.simulation.loop.structure import structure_of

Flags = NDArray[np.bool_]

BOUNDS = {"gt": np.greater, "ge": np.greater_equal, "lt": np.less, "le": np.less_equal}
"""Bound of a constraint of `annotated_types` → what holds between a value and it."""


def doubtful(family: Family) -> Flags:
    """(members,) whether each is to be looked at by itself."""
    if not family.columns:
        return np.ones(len(family.members), bool)
    try:
        check(family.experiment)
    except ConfigurationError:  # its members may be sound all the same
        return np.ones(len(family.members), bool)
    known, doubts = describe_parts(family.experiment), np.zeros(len(family.members), bool)
    for key, column in family.columns.items():
        doubts |= out_of_range(known[key], column)
    if not doubts.any():
        for doubt in _doubts(family):
            doubts |= doubt
    return doubts


def _doubts(family: Family) -> Iterator[Any]:
    """What cannot be told from one column alone: rules, sub-steps, states to start from."""
    groups = family.groups
    for name, group in groups.items():
        for _, owner, rule in rules(group, f"{name}."):
            yield breaks(rule, owner)
    simulation = family.experiment.simulation
    if not is_automatic(family.experiment):
        yield ~(substeps_for(fastest_swing(groups["plant"]), simulation) <= simulation.substeps)
    first = starts(structure_of(family.experiment), family.vectors)
    yield ~np.isfinite(first).all(axis=1)


def breaks(rule: Rule, group: Any) -> Any:
    """Where values of a group whose fields may be arrays break a rule; everywhere, where it is one of scalars alone."""
    try:
        return ~np.asarray(rule.holds(group), bool)
    except ValueError:  # the truth of an array
        return True


def out_of_range(leaf: Leaf, column: NDArray[Any]) -> Flags:
    """(values,) whether each is no finite number within the bounds of a leaf."""
    wrong = ~np.isfinite(column)
    for constraint in leaf.constraints:
        for word, holds in BOUNDS.items():
            bound = getattr(constraint, word, None)
            if bound is not None:
                wrong |= ~holds(column, bound)
    if leaf.kind is int and column.dtype.kind not in "iu":
        wrong |= column != np.rint(column)
    return wrong
