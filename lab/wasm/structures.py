"""The structures that the lab offers, each a module of its own."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.lab.wasm.settings import Settings
from dualwinch.model.quantities.part import Registry
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.experiment import Experiment

LAW, ESTIMATOR, COORDINATION, SLACK = (
    "controller.kind",
    "controller.estimator",
    "controller.coordination.kind",
    "plant.rope_slack",
)
"""What is chosen."""

REGISTRIES: dict[str, Registry[Any]] = {LAW: POSITION_LAWS, ESTIMATOR: ESTIMATORS, COORDINATION: COORDINATIONS}
"""What knows the parts that are chosen."""

FILTERED = ("fando-nftsm", "adrc", "super-twisting")
"""Position laws that are offered with filters, too."""

FILTERS = ("kalman", "self-calibrating-kalman")


@dataclass(frozen=True)
class LabStructure:
    """A structure of the lab.

    Attributes:
        settings: key of a choice → what is chosen.
        base: gives every other value; the paper's Case 2.
    """

    settings: tuple[tuple[str, Any], ...]
    base: Experiment = field(default_factory=Experiment)

    @cached_property
    def chosen(self) -> dict[str, Any]:
        """What is chosen, by its key."""
        return dict(self.settings)

    @cached_property
    def experiment(self) -> Experiment:
        """The base with what is chosen."""
        return with_leaves(self.base, self.chosen)

    @cached_property
    def module(self) -> Settings:
        """What its module takes."""
        return Settings(self.experiment)

    @property
    def id(self) -> str:
        """A name of its own: what differs from the paper's structure, after the law."""
        usual = leaves(Experiment())
        words = [str(value) for key, value in self.settings if key not in {LAW, SLACK} and value != usual[key]]
        return "+".join([self.chosen[LAW], *words, *([] if self.chosen[SLACK] else ["two-sided"])])

    @property
    def label(self) -> str:
        """What people call it."""
        usual, parts = leaves(Experiment()), [POSITION_LAWS.find(self.chosen[LAW]).label]
        others = [key for key in (ESTIMATOR, COORDINATION) if self.chosen[key] != usual[key]]
        parts += [REGISTRIES[key].find(self.chosen[key]).label for key in others]
        return ", ".join([*parts, *([] if self.chosen[SLACK] else ["ropes that push"])])


def structures() -> tuple[LabStructure, ...]:
    """Every structure of the lab, the paper's first."""
    values = leaves(Experiment())
    usual = {key: values[key] for key in (LAW, ESTIMATOR, COORDINATION, SLACK)}
    changes = [{LAW: law} for law in POSITION_LAWS]
    changes += [{LAW: law, ESTIMATOR: estimator} for law in FILTERED for estimator in FILTERS]
    changes += [{COORDINATION: kind} for kind in COORDINATIONS if kind != usual[COORDINATION]]
    changes += [{SLACK: False}]
    return tuple(LabStructure(tuple((usual | change).items())) for change in changes)
