"""Experiments as plain values: every key and its value, from which the experiment can be built again."""

from collections.abc import Mapping
from typing import Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark, nearest
from dualwinch.model.quantities.tree import leaves, shown, with_leaves
from dualwinch.simulation.experiment import Experiment


def rebuilt(values: Mapping[str, Any], base: Experiment) -> Experiment:
    """The experiment of which these are the `leaves`.

    Args:
        values: dotted key → value; what is missing is taken from `base`.
        base: an experiment; parts that no registry knows are taken from here.

    Raises:
        ConfigurationError: a part of a kind that is not known here, a key that is not, or a value out of range.
    """
    for key, leaf in describe_parts(base).items():
        if key in values and not {Mark.PART, Mark.PARTS}.isdisjoint(leaf.marks) and not leaf.admits(values[key]):
            raise ConfigurationError(
                f"{key} = {shown(values[key])}: no such part is registered; "
                "register it, dw.register(YourClass), or give an experiment that has it, as load_result(path, base)"
            )
    experiment = with_leaves(base, values)
    known = leaves(experiment)
    for key in values:
        if key not in known:
            raise ConfigurationError(f"unknown key '{key}'; did you mean '{nearest(key, known)}'?")
    return experiment
