"""Optimisers by name. A new one is a new file with `ask` and `tell`, and one line here."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import unknown
from dualwinch.tuning.optimisers.cma import CmaSearch
from dualwinch.tuning.optimisers.sampler import GP, NSGA2, NSGA3, QMC, RANDOM, TPE, SamplerSearch
from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.space import Point


class Optimiser(Protocol):
    """Proposes candidates and learns from their evaluations."""

    def ask(self, count: int) -> list[Point]:
        """Candidates to evaluate next, 1 to `count` of them."""
        ...

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Learn from evaluations of its own proposals and of others."""
        ...


Method = Callable[[TrainingSet, int], Optimiser]
"""Makes an optimiser for a problem from a seed."""

METHODS: dict[str, Method] = {
    "cmaes": CmaSearch,
    "tpe": partial(SamplerSearch, TPE),
    "gp": partial(SamplerSearch, GP),
    "nsga2": partial(SamplerSearch, NSGA2),
    "nsga3": partial(SamplerSearch, NSGA3),
    "qmc": partial(SamplerSearch, QMC),
    "random": partial(SamplerSearch, RANDOM),
}
"""Every method by its name."""

ONE_OBJECTIVE = ("cmaes",)
"""Methods for a single objective."""


def check_method(method: str, objectives: int) -> None:
    """Check the name of a method and its number of objectives.

    Raises:
        ConfigurationError: unknown name, or a method for a single objective only.
    """
    if method not in METHODS:
        raise ConfigurationError(f"--method {method}: {unknown('method', method, METHODS)}")
    if method in ONE_OBJECTIVE and objectives > 1:
        raise ConfigurationError(f"--method {method}: takes a single objective; use nsga2, nsga3 or tpe for several")


def optimiser(method: str, prepared: TrainingSet, seed: int) -> Optimiser:
    """The optimiser of a name.

    Raises:
        ConfigurationError: unknown name, a method for a single objective only, or one whose library is missing.
    """
    check_method(method, len(prepared.problem.objectives))
    return METHODS[method](prepared, seed)
