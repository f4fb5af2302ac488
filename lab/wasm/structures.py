"""The structures that the lab offers, each a module of its own."""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.lab.wasm.settings import Settings
from dualwinch.model.quantities.part import Registry
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case

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

HEAVY = "site"
"""The machine whose ropes have mass and sag and whose winches are heavy: the ensemble's nominal one."""

HEAVY_ESTIMATORS = ("lowpass", "self-calibrating-kalman")

DAMPING = 164.0
"""Damping of its drums in N m s/rad: that of ropes which end in their wave impedance (docs/site.md)."""

SUBSTEPS = 10
"""Steps of the integrator in a sample there: twice what its own numbers need, for lighter ropes."""


@cache
def heavy_machine() -> Experiment:
    """The paper's Case 4 on the heavy machine, its drums damped."""
    plant = load_ensemble(HEAVY).experiment.plant
    damping = {f"controller.winch_{number}.damping": DAMPING for number in (1, 2)}
    return with_leaves(replace(case(4), plant=plant), damping | {"simulation.substeps": SUBSTEPS})


@dataclass(frozen=True)
class LabStructure:
    """A structure of the lab.

    Attributes:
        settings: key of a choice → what is chosen.
        base: gives every other value; the paper's Case 2.
        machine: name of a machine of another structure than the paper's; empty: the paper's.
    """

    settings: tuple[tuple[str, Any], ...]
    base: Experiment = field(default_factory=Experiment)
    machine: str = ""

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
        words += [word for word in ("" if self.chosen[SLACK] else "two-sided", self.machine) if word]
        return "+".join([self.chosen[LAW], *words])

    @property
    def label(self) -> str:
        """What people call it."""
        usual, parts = leaves(Experiment()), [POSITION_LAWS.find(self.chosen[LAW]).label]
        others = [key for key in (ESTIMATOR, COORDINATION) if self.chosen[key] != usual[key]]
        parts += [REGISTRIES[key].find(self.chosen[key]).label for key in others]
        parts += ["" if self.chosen[SLACK] else "ropes that push", f"machine {self.machine}" if self.machine else ""]
        return ", ".join(filter(None, parts))


def structures() -> tuple[LabStructure, ...]:
    """Every structure of the lab, the paper's first."""
    values = leaves(Experiment())
    usual = {key: values[key] for key in (LAW, ESTIMATOR, COORDINATION, SLACK)}
    changes = [{LAW: law} for law in POSITION_LAWS]
    changes += [{LAW: law, ESTIMATOR: estimator} for law in FILTERED for estimator in FILTERS]
    changes += [{COORDINATION: kind} for kind in COORDINATIONS if kind != usual[COORDINATION]]
    changes += [{SLACK: False}]
    found = [LabStructure(tuple((usual | change).items())) for change in changes]
    heavy = [tuple((usual | {ESTIMATOR: estimator}).items()) for estimator in HEAVY_ESTIMATORS]
    return (*found, *(LabStructure(settings, heavy_machine(), HEAVY) for settings in heavy))
