"""Imperfections: what an ensemble has and another does not, in groups that are scaled together."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import SEED_KEY, Drawn, Ensemble
from dualwinch.simulation.experiment import Experiment

MACHINE = ("plant.", "disturbance.", "sensors.", "actuator.", "simulation.")
"""What the keys of a machine and of what acts on it begin with. Elsewhere only what is drawn is an imperfection."""

METHOD = frozenset({"simulation.substeps", SEED_KEY})
"""Keys beside `Mark.TIMING` that say how a run is computed, and nothing of the machine."""

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
    """The ensemble on top of a base: what the base draws and the ensemble does not say is drawn as well.

    Raises:
        ConfigurationError: gains are drawn; both are to have those that are asked about.
    """
    together = {**base.distributions, **ensemble.distributions}
    for key in together:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: is drawn in an ensemble; a stress test needs the gains as they are")
    return Ensemble(ensemble.name, ensemble.description, ensemble.experiment, together)


def imperfections(base: Ensemble, ensemble: Ensemble) -> tuple[Imperfection, ...]:
    """What an ensemble (`union`) has and its base does not, in the order of the keys.

    An imperfection is a number that is drawn or set otherwise, a switch, or a part of another kind with all its own
    numbers. Keys that differ only in the number of a rope or winch are one. Motion, metrics and method are none, nor is
    how an imperfection comes and goes (`Mark.COURSE`).

    Raises:
        ConfigurationError: there are none.
    """
    ours, theirs = leaves(base.experiment), leaves(ensemble.experiment)
    known = describe_parts(ensemble.experiment)
    kinds = [key for key, leaf in known.items() if Mark.PART in leaf.marks and ours.get(key) != theirs[key]]
    groups: dict[str, list[str]] = {}
    for key, leaf in known.items():
        drawn = ensemble.distributions.get(key)
        if not (_scalable(key, leaf, drawn) and _differs(key, drawn, base, ours, theirs)):
            continue
        owner = next((kind for kind in kinds if key not in ours and key.startswith(kind.rpartition(".")[0] + ".")), key)
        groups.setdefault(NUMBERED.sub("", owner), []).append(key)
    if not groups:
        raise ConfigurationError(
            f"ensemble '{ensemble.name}': has no imperfection that its base '{base.name}' lacks; give another base"
        )
    return tuple(Imperfection(name, tuple(keys)) for name, keys in groups.items())


def all_together(single: tuple[Imperfection, ...]) -> Imperfection:
    """All imperfections as one."""
    return Imperfection(ALL, tuple(key for imperfection in single for key in imperfection.keys))


def _scalable(key: str, leaf: Leaf, drawn: Drawn | None) -> bool:
    if key in METHOD or not leaf.marks.isdisjoint({Mark.TIMING, Mark.PARTS, Mark.COURSE}):
        return False
    if drawn is not None:
        return True
    if not key.startswith(MACHINE):
        return False
    return leaf.kind in {float, int, bool} or Mark.PART in leaf.marks


def _differs(key: str, drawn: Drawn | None, base: Ensemble, ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> bool:
    if drawn != base.distributions.get(key):
        return True
    follows = drawn is None or drawn.relative
    return follows and ours.get(key) != theirs[key]


def believed(experiment: Experiment) -> dict[str, Any]:
    """The values of the plant that a controller was designed for, by their keys in the experiment."""
    return leaves(experiment.plant, "plant.")
