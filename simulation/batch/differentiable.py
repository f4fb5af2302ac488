"""Which numbers of an experiment runs can be differentiated by, and why not by others."""

from collections.abc import Iterable
from itertools import chain

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.exogenous.signal_slopes import check_shaped, shaped_by
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import described_parameters, parameters_of, structure_of


def check_differentiable(names: Iterable[str], experiment: Experiment) -> None:
    """Raise `ConfigurationError` where a run has no derivative by a number; of names that are unknown say nothing."""
    taken = described_parameters(structure_of(experiment))
    known, values = described(experiment), leaves(experiment)
    for name in names:
        if name not in known:
            continue
        reason = _reason(known[name])
        if not reason and name not in taken and not shaped_by(name):
            reason = "it has no value" if values[name] is None else "no run changes with it alone"
        if reason:
            raise ConfigurationError(f"no sensitivity to '{name}': {reason}")


def differentiable_numbers(experiment: Experiment) -> dict[str, float]:
    """Key → value of every number that runs of an experiment have a derivative by."""
    ahead = {key: value for key, value in leaves(experiment).items() if shaped_by(key)}
    found = {}
    for key, value in (parameters_of(experiment) | ahead).items():
        try:
            check_differentiable([key], experiment)
            check_shaped(experiment, key)
        except ConfigurationError:
            continue
        if value or Mark.SCALES_DRAWS not in described(experiment)[key].marks:
            found[key] = float(value)
    return found


def described(experiment: Experiment) -> dict[str, Leaf]:
    """Every key of an experiment, and of what the controller believes of its plant, with what it is."""
    return {**describe_parts(experiment), **described_parameters(structure_of(experiment))}


MARKS = {
    Mark.READS_IN_STEPS: "it rounds what is read",
    Mark.TIMING: "it sets the instants of the samples",
    Mark.SHAPES_CODE: "it is written into the compiled code",
}
"""What stands against a derivative by what is marked so."""

KINDS = {int: "it is a whole number", bool: "it is a switch", str: "it is a choice or a text", tuple: "it is a list"}
"""The same, by the type of a value."""

GROUPS = {
    "metrics.": "no run changes with it, only a figure of merit",
    "reference.": "the reference is laid out ahead of a run",
    "sensors.outage": "outages begin and end with samples",
    "controller.nominal.": "it sets what the controller believes; ask for nominal.*",
}
"""The same, by what a key begins with."""


def _reason(leaf: Leaf) -> str:
    """What stands against a derivative by a number; empty: nothing that its description says."""
    by_mark = (reason for mark, reason in MARKS.items() if mark in leaf.marks)
    by_kind = (reason for kind, reason in KINDS.items() if leaf.kind is kind)
    by_group = (reason for beginning, reason in GROUPS.items() if leaf.key.startswith(beginning))
    return next(chain(by_mark, by_kind, by_group), "")
