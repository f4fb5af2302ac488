"""Set values of an experiment by key, checking type and range; errors name the key.

Former names of keys (`RENAMED`) are accepted everywhere.
"""

import fnmatch
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import lru_cache
from pathlib import Path
from typing import Any

from dualwinch.model.arguments import instance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe, describe_parts, owners
from dualwinch.model.quantities.part import Part, registries
from dualwinch.model.quantities.quantity import Leaf, Mark, unknown
from dualwinch.model.quantities.tree import leaves, validated, with_leaves
from dualwinch.model.reference import KEYS_OF_KIND, Reference
from dualwinch.simulation.experiment import Experiment

RENAMED = {"controller.calibration.spread": "controller.calibration.deviation", "disturbance.seed": "simulation.seed"}
"""Former key → present key."""


def current(key: str) -> str:
    """The present name of a key."""
    return RENAMED.get(key, key)


def known_keys() -> dict[str, Leaf]:
    """Every configuration key of all registered parts → its metadata."""
    return dict(_known_keys(tuple(tuple(registry.values()) for registry in registries())))


@lru_cache(maxsize=4)
def _known_keys(parts: tuple[tuple[type[Part], ...], ...]) -> dict[str, Leaf]:  # noqa: ARG001 # key of the cache
    return describe(Experiment)


def override(experiment: Experiment, values: Mapping[str, Any]) -> Experiment:
    """A copy of an experiment with some values set.

    Args:
        experiment: source of all other values.
        values: dotted key → value, e.g. ``{"plant.vehicle.mass": 1.1e4}``; ``*`` stands for any part of a key, as in
            ``plant.rope_*.damping``, and a key without it is an exception to such a pattern. Another kind of a part,
            such as another ``controller.kind``, brings its own default gains and keeps the gains that both kinds share.

    Raises:
        ConfigurationError: an unknown key, a value of the wrong type or out of range, or a gain of a part that the
            experiment does not have.

    Example:
        >>> import dualwinch as dw
        >>> heavier = dw.override(dw.case(4), {"plant.vehicle.mass": 1.2e4, "controller.observer.l0": 20.0})
        >>> heavier.plant.vehicle.mass
        12000.0
        >>> dw.override(dw.case(4), {"plant.rope_*.modulus": 7e10}).plant.rope_2.modulus
        70000000000.0
    """
    values = _without_patterns(experiment, values)
    experiment, idle = with_settings(experiment, values)
    for key in idle:
        choice, kinds = owners(Experiment, key)
        whose, here = " or ".join(f'"{kind}"' for kind in kinds), leaves(experiment)[choice]
        if isinstance(here, tuple):
            among = ", ".join(f'"{kind}"' for kind in here)
            raise ConfigurationError(f"{key}: belongs to {whose}, which is not among {choice} = [{among}]")
        raise ConfigurationError(f'{key}: belongs to {choice} = {whose}, here it is "{here}"')
    check_reference_keys(experiment, values)
    return experiment


def _without_patterns(experiment: Experiment, values: Mapping[str, Any]) -> Mapping[str, Any]:
    """The values by the experiment's own keys, in place of patterns.

    Raises:
        ConfigurationError: a pattern that no key matches.
    """
    patterns = [key for key in values if "*" in str(key)]
    if not patterns:
        return values
    keys, expanded = list(leaves(experiment)), dict[str, Any]()
    for pattern in patterns:
        matching = fnmatch.filter(keys, pattern)
        if not matching:
            raise ConfigurationError(
                f"{pattern}: no key of the experiment is like this; dualwinch config prints all keys"
            )
        expanded |= dict.fromkeys(matching, values[pattern])
    return expanded | {key: value for key, value in values.items() if key not in patterns}


def check_reference_keys(
    experiment: Experiment,
    values: Mapping[str, Any],
    located: Callable[[str], AbstractContextManager[None]] = lambda _: nullcontext(),
) -> None:
    """Check that values of the reference motion have an effect; defaults of another kind of motion are accepted.

    Raises:
        ConfigurationError: a key of another kind of motion.
    """
    here, default = experiment.reference, Reference()
    for key in values:
        table, _, name = current(key).rpartition(".")
        kind = next((kind for kind, names in KEYS_OF_KIND.items() if name in names), here.kind)
        if table == "reference" and kind != here.kind and getattr(here, name) != getattr(default, name):
            with located(key):
                raise ConfigurationError(f'{key}: belongs to reference.kind = "{kind}", here it is "{here.kind}"')


def with_settings(
    experiment: Experiment,
    values: Mapping[str, Any],
    located: Callable[[str], AbstractContextManager[None]] = lambda _: nullcontext(),
) -> tuple[Experiment, list[str]]:
    """A copy of an experiment with some values set, and the keys that belong to parts it does not have.

    `located` is a context that prefixes errors with the place of a key.

    Raises:
        ConfigurationError: an unknown key, or a value of the wrong type or out of range.
    """
    instance("experiment", experiment, Experiment)
    if not isinstance(values, Mapping):
        raise ConfigurationError(f"values: must be a dictionary of keys and values, not {type(values).__name__}")
    for key in values:
        instance("values", key, str, hint=" as key")
    spelling = {current(key): key for key in values}
    values = {current(key): value for key, value in values.items()}
    checked: dict[str, Any] = {}

    for described in (describe_choices, describe_parts):  # parts first: they determine which gains exist
        descriptions = described(experiment)
        for key, value in values.items():
            if key in descriptions and key not in checked:
                with located(spelling[key]):
                    checked[key] = validated(descriptions[key], value)
        experiment = with_leaves(_with_files(experiment, checked, lambda key: located(spelling[key])), checked)
    idle = [key for key in values if key not in checked]
    for key in idle:
        with located(spelling[key]):
            validated(leaf_of(key, experiment), values[key])
    return experiment, idle


def _with_files(
    experiment: Experiment, values: Mapping[str, Any], located: Callable[[str], AbstractContextManager[None]]
) -> Experiment:
    """The experiment after reading the files that some values name; errors name the key of the file."""
    descriptions = describe_parts(experiment)
    for key in values:
        if Mark.FILE in descriptions[key].marks:
            table = key.rpartition(".")[0] + "."
            with located(key):
                experiment = with_leaves(experiment, {k: v for k, v in values.items() if k.startswith(table)})
    return experiment


def from_folder(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Values of a file, with paths resolved against its folder."""
    files = {key: value for key, value in values.items() if Mark.FILE in marks_of(key) and isinstance(value, str)}
    return {**values, **{key: str(folder / value) for key, value in files.items()}}


def without_digests(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values without digests of files, which no longer hold when a setting names another file."""
    return {key: value for key, value in values.items() if Mark.DIGEST not in marks_of(key)}


def marks_of(key: str) -> frozenset[Mark]:
    """Marks of a key; none for an unknown key."""
    leaf = known_keys().get(current(key))
    return leaf.marks if leaf else frozenset()


def describe_choices(experiment: Experiment) -> dict[str, Leaf]:
    """Keys that choose parts, with their metadata."""
    kinds = {Mark.PART, Mark.PARTS}
    return {key: leaf for key, leaf in describe_parts(experiment).items() if not kinds.isdisjoint(leaf.marks)}


def leaf_of(key: str, experiment: Experiment | None = None) -> Leaf:
    """Metadata of a key, of this experiment or of any.

    Raises:
        ConfigurationError: an unknown key; the message suggests similar ones.
    """
    here, key = describe_parts(experiment) if experiment else {}, current(key)
    if leaf := here.get(key) or known_keys().get(key):
        return leaf
    names = list(dict.fromkeys((*known_keys(), *here)))
    below = [name for name in names if name.startswith(key + ".")]
    if below:
        examples = ", ".join(name.removeprefix(key + ".") for name in below[:6])
        raise ConfigurationError(f"{key} is a table; its keys are {examples}" + (", ..." if len(below) > 6 else ""))
    raise ConfigurationError(unknown("key", key, names, "; dualwinch config prints all"))
