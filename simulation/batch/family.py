"""Families: scenarios of a batch that share an experiment and differ in columns of plain numbers."""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.disturbance import given_signals
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators.solver import is_automatic
from dualwinch.simulation.loop.structure import parameters_of

Scenarios = Sequence[Experiment | Scenario]

IN_COMMON = frozenset({Mark.TIMING, Mark.SHAPES_CODE, Mark.SHAPES_CODE_AT_ZERO})
"""Marks of numbers that are the same in a whole family."""

GROUPS_IN_COMMON = ("controller.", "reference.", "metrics.", "plant.track.")
"""What the keys of others begin with: of what a controller believes, and of where a run goes, more follows."""


@dataclass(frozen=True, eq=False)
class Family:
    """Scenarios that share an experiment and differ in plain numbers.

    Attributes:
        members: their places in the batch, (n,).
        experiment: what they share; where they differ it has the numbers of none of them.
        nominal: the plant that their controllers were designed for; None: that of the experiment.
        drawn: keys of all that was drawn.
        columns: key → the members' own numbers, (n,).
    """

    members: NDArray[np.int64]
    experiment: Experiment
    nominal: Plant | None
    drawn: frozenset[str]
    columns: dict[str, NDArray[Any]]

    @cached_property
    def numbers(self) -> dict[str, float]:
        """What `parameters_of` gives of the experiment."""
        return parameters_of(self.experiment, self.nominal)

    @cached_property
    def vectors(self) -> NDArray[np.float64]:
        """The same of every member, in that order, (n, parameters)."""
        vectors = np.tile(np.array(list(self.numbers.values())), (len(self.members), 1))
        for number, key in enumerate(self.numbers):
            if key in self.columns:
                vectors[:, number] = self.columns[key]
        return vectors

    @property
    def groups(self) -> dict[str, Any]:
        """Field of an experiment → the group there, with columns for its numbers."""
        held = {field.name: getattr(self.experiment, field.name) for field in fields(Experiment)}
        return {
            name: with_leaves(group, self.columns, f"{name}.") for name, group in held.items() if is_dataclass(group)
        }


def families(scenarios: Scenarios) -> list[Family]:
    """Scenarios as families; mostly there is one.

    Words, and numbers from which more follows than what they are in the compiled code and in random signals, are the
    same in a family.

    Raises:
        ConfigurationError: such a value is out of its range; the message names the scenario.
    """
    found: list[Family] = []
    for places in _grouped(range(len(scenarios)), map(_likeness, scenarios)):
        first = scenarios[places[0]]
        if isinstance(first, Experiment):
            found.append(Family(np.array(places), first, None, frozenset(), {}))
        else:
            found += _of_draws({place: given for place in places if isinstance(given := scenarios[place], Scenario)})
    return found


def _of_draws(drawn: Mapping[int, Scenario]) -> Iterator[Family]:
    """The families of draws of one experiment, by their places, in which the same values are words."""
    place, first = next(iter(drawn.items()))
    shaped = _having(first, place, [key for key, value in first.draws.items() if not _is_number(value)])
    plain = plain_numbers(shaped)
    columns = [key for key in first.draws if key in plain]
    others = [key for key in first.draws if key not in plain]
    for places in _grouped(drawn, (tuple(given.draws[key] for key in others) for given in drawn.values())):
        yield Family(
            members=np.array(places),
            experiment=_having(drawn[places[0]], places[0], others),
            nominal=first.nominal,
            drawn=frozenset(first.draws),
            columns={key: np.array([drawn[place].draws[key] for place in places]) for key in columns},
        )


def _grouped(places: Iterable[int], likeness: Iterable[Hashable]) -> Iterable[list[int]]:
    groups: dict[Hashable, list[int]] = {}
    for place, like in zip(places, likeness, strict=True):
        groups.setdefault(like, []).append(place)
    return groups.values()


def _likeness(given: Experiment | Scenario) -> Hashable:
    if isinstance(given, Experiment):
        return id(given)
    draws = (key if _is_number(value) else (key, value) for key, value in given.draws.items())
    return id(given.base), id(given.nominal), *draws


def _having(scenario: Scenario, place: int, keys: Iterable[str]) -> Experiment:
    """The experiment of a scenario with some of its draws alone."""
    try:
        return with_leaves(scenario.base, {key: scenario.draws[key] for key in keys})
    except ConfigurationError as error:
        raise ConfigurationError(f"{name_of(scenario, place)}: {error}") from error


def _is_number(value: Any) -> bool:
    return isinstance(value, (float, int)) and not isinstance(value, bool)


def experiment_of(given: Experiment | Scenario) -> Experiment:
    """What is simulated."""
    return given.experiment if isinstance(given, Scenario) else given


def name_of(given: Experiment | Scenario, place: int) -> str:
    """What an error calls a scenario of a batch."""
    return f"scenario {given.index}" if isinstance(given, Scenario) else f"scenarios[{place}]"


def plain_numbers(experiment: Experiment) -> frozenset[str]:
    """Keys of an experiment's numbers in which scenarios of a family may differ."""
    others = (*GROUPS_IN_COMMON, *(f"disturbance.{name}." for name in given_signals(experiment.disturbance)))
    if is_automatic(experiment):
        others += ("plant.",)
    return frozenset(
        key for key, leaf in describe_parts(experiment).items() if _is_plain(leaf) and not key.startswith(others)
    )


def _is_plain(leaf: Leaf) -> bool:
    return leaf.kind in {float, int} and not leaf.optional and leaf.marks.isdisjoint(IN_COMMON)
