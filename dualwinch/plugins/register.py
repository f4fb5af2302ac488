"""Parts of your own get the names that files and command lines know."""

from collections.abc import Iterator
from typing import Any, TypeVar

import dualwinch.simulation.ensembles.ensemble  # noqa: F401  registries that no experiment holds
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import check_keys, every_leaf
from dualwinch.model.quantities.origin import named
from dualwinch.model.quantities.part import Part, Registry, base_of
from dualwinch.model.quantities.wrong_parts import check_defaults
from dualwinch.simulation.experiment import Experiment

PartType = TypeVar("PartType", bound=type[Part])


def register(part: PartType) -> PartType:
    """Give a part of your own its kind in files and on command lines; also a decorator.

    From then on it is what a built-in part is: ``controller.kind = "mine"`` in files, ``--set``, `dualwinch.override`
    and searches for gains. Without it, objects of the class work all the same, from Python.

    Args:
        part: a frozen dataclass that subclasses `PositionLaw`, `Estimator`, `Coordination` or another base of parts.
            Defined again, as by a notebook's cell that runs again, it takes the place of what it was.

    Returns:
        The same class.

    Raises:
        ConfigurationError: the class cannot be a part, or its kind or one of its keys is taken by another.
    """
    if not (isinstance(part, type) and issubclass(part, Part)):
        shown = part.__name__ if isinstance(part, type) else repr(part)
        raise ConfigurationError(f"{shown}: must be a class that subclasses {_bases()}")
    if part.registry is None:
        raise ConfigurationError(f"{named(part)}: must subclass {_bases()}")

    def instead(owner: type) -> bool:
        """Whether another stands in the same table, and is never there together with it."""
        return not part.table() and issubclass(owner, base_of(part))

    with part.registry.with_part(part):
        leaves = list(every_leaf(Experiment))
        own = {leaf.key: leaf for owner, leaf in leaves if owner is part}
        if own:
            check_defaults(part)
        check_keys(part, own, ((owner, leaf) for owner, leaf in leaves if owner is not part and not instead(owner)))
    return part


def registries() -> Iterator[Registry[Any]]:
    """Every registry there is."""
    yield from (base.registry for base in Part.__subclasses__() if base.registry is not None)


def _bases() -> str:
    names = [base.__name__ for base in Part.__subclasses__() if base.registry is not None]
    return f"{', '.join(names[:-1])} or {names[-1]}"
