"""The structures of the lab, each compiled to its own module."""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any

from dualwinch.toolbox import Ensemble, Experiment, ensemble_file, leaves, paper, parts, registries, with_leaves
from dualwinch.toolboxes.lab.wasm.settings import Settings

LAW, ESTIMATOR, COORDINATION, SLACK = (
    "controller.kind",
    "controller.estimator",
    "controller.coordination.kind",
    "plant.rope_slack",
)
"""Keys of the choices."""

REGISTRIES: dict[str, parts.Registry[Any]] = {
    LAW: registries.POSITION_LAWS,
    ESTIMATOR: registries.ESTIMATORS,
    COORDINATION: registries.COORDINATIONS,
}
"""Key of a choice → registry of its parts."""

FILTERED = ("fando-nftsm", "adrc", "super-twisting")
"""Position laws that are also offered with `FILTERS`."""

FILTERS = ("kalman", "self-calibrating-kalman")

HEAVY = "site"
"""Ensemble whose nominal machine, with ropes of mass and sag and heavy winches, is offered."""

HEAVY_ESTIMATORS = ("lowpass", "self-calibrating-kalman")

HEAVY_COORDINATIONS = ("differential-tension", "proportional-tension")

DAMPING = 164.0
"""Damping of its drums in N m s/rad: the wave impedance of its ropes (docs/site.md)."""

SUBSTEPS = 10
"""Its steps of the integrator per sample: twice the necessary number, to allow for lighter ropes."""


@cache
def heavy_ensemble() -> Ensemble:
    """The ensemble of heavy machines."""
    return ensemble_file.load_ensemble(HEAVY)


@cache
def heavy_machine() -> Experiment:
    """The paper's Case 4 on the heavy machine, its drums damped."""
    plant = heavy_ensemble().experiment.plant
    damping = {f"controller.winch_{number}.damping": DAMPING for number in (1, 2)}
    return with_leaves(replace(paper.case(4), plant=plant), damping | {"simulation.substeps": SUBSTEPS})


@dataclass(frozen=True)
class LabStructure:
    """A structure of the lab.

    Attributes:
        settings: (key, option) of each choice.
        base: experiment with all other values; the paper's Case 2.
        machine: name of a machine whose structure differs from the paper's; empty: the paper's.
    """

    settings: tuple[tuple[str, Any], ...]
    base: Experiment = field(default_factory=Experiment)
    machine: str = ""

    @cached_property
    def chosen(self) -> dict[str, Any]:
        """Key → chosen option."""
        return dict(self.settings)

    @cached_property
    def experiment(self) -> Experiment:
        """The base with the chosen options."""
        return with_leaves(self.base, self.chosen)

    @cached_property
    def module(self) -> Settings:
        """Parameters of its module."""
        return Settings(self.experiment)

    @property
    def id(self) -> str:
        """Unique name: the law, then the choices that differ from the paper's structure."""
        usual = leaves(Experiment())
        words = [str(value) for key, value in self.settings if key not in {LAW, SLACK} and value != usual[key]]
        words += [word for word in ("" if self.chosen[SLACK] else "two-sided", self.machine) if word]
        return "+".join([self.chosen[LAW], *words])

    @property
    def label(self) -> str:
        """Name for users."""
        usual, parts = leaves(Experiment()), [registries.POSITION_LAWS.find(self.chosen[LAW]).label]
        differing = [key for key in (ESTIMATOR, COORDINATION) if self.chosen[key] != usual[key]]
        parts += [REGISTRIES[key].find(self.chosen[key]).label for key in differing]
        parts += ["" if self.chosen[SLACK] else "ropes that push", f"machine {self.machine}" if self.machine else ""]
        return ", ".join(filter(None, parts))


def structures() -> tuple[LabStructure, ...]:
    """Every structure of the lab, the paper's first."""
    values = leaves(Experiment())
    usual = {key: values[key] for key in (LAW, ESTIMATOR, COORDINATION, SLACK)}
    changes = [{LAW: law} for law in registries.POSITION_LAWS]
    changes += [{LAW: law, ESTIMATOR: estimator} for law in FILTERED for estimator in FILTERS]
    changes += [{COORDINATION: kind} for kind in registries.COORDINATIONS if kind != usual[COORDINATION]]
    changes += [{SLACK: False}]
    light = [LabStructure(tuple((usual | change).items())) for change in changes]
    heavy = [
        tuple((usual | {ESTIMATOR: estimator, COORDINATION: coordination}).items())
        for coordination in HEAVY_COORDINATIONS
        for estimator in HEAVY_ESTIMATORS
    ]
    return (*light, *(LabStructure(settings, heavy_machine(), HEAVY) for settings in heavy))
