"""Scenarios of a batch, grouped: by what they share, to be checked as columns, and by structure, to be run.

Scenarios that share an experiment and differ in plain numbers alone are a `ScenarioGroup`: their numbers are columns,
which are checked as a whole; only members that may be out of range are shown to `prepare`, whose message names what is
wrong. What one compiled loop can run is of one structure (`by_structure`).
"""

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.controller import Controller
from dualwinch.model.disturbance import given_signals
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import COMPARISONS, Leaf, Mark, Rule, bound_of, unknown
from dualwinch.model.quantities.tree import leaves, rules, with_leaves
from dualwinch.simulation.experiment import EngineName, Experiment
from dualwinch.simulation.loop.closed_loop import starts
from dualwinch.simulation.loop.structure import (
    described_parameters,
    is_automatic,
    parameters_of,
    solver_of,
    structure_of,
    symbolic_parts,
)
from dualwinch.simulation.prepare import fastest_swing, prepare, substeps_for
from dualwinch.simulation.progress import Progress
from dualwinch.simulation.scenario import Scenario

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Scenarios = Sequence[Experiment | Scenario]

IN_COMMON = frozenset({Mark.TIMING, Mark.SHAPES_CODE})
"""Marks of numbers that are the same in a whole group."""

OF_SIGNALS = frozenset({Mark.SCALES_DRAWS, Mark.DRAWN_AHEAD})
"""Marks of numbers from which random signals follow: in common too, where it shapes code whether they are zero."""

GROUPS_IN_COMMON = ("controller.", "reference.", "metrics.", "plant.track.length", "plant.track.rope_offset")
"""What the keys of others begin with: of what a controller believes, and of where a run goes, more follows."""


@dataclass(frozen=True, eq=False)
class ScenarioGroup:
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


def scenario_groups(scenarios: Scenarios) -> list[ScenarioGroup]:
    """Scenarios as groups; mostly there is one.

    Words, and numbers from which more follows than what they are in the compiled code and in random signals, are the
    same in a group.

    Raises:
        ConfigurationError: such a value is out of its range; the message names the scenario.
    """
    found: list[ScenarioGroup] = []
    for places in _grouped(range(len(scenarios)), map(_likeness, scenarios)):
        first = scenarios[places[0]]
        if isinstance(first, Experiment):
            found.append(ScenarioGroup(np.array(places), first, None, frozenset(), {}))
        else:
            found += _of_draws({place: given for place in places if isinstance(given := scenarios[place], Scenario)})
    return found


def _of_draws(drawn: Mapping[int, Scenario]) -> Iterator[ScenarioGroup]:
    """The groups of draws of one experiment, by their places, in which the same values are words."""
    place, first = next(iter(drawn.items()))
    shaped = _having(first, place, [key for key, value in first.draws.items() if not _is_number(value)])
    plain = plain_numbers(shaped)
    columns = [key for key in first.draws if key in plain]
    others = [key for key in first.draws if key not in plain]
    for places in _grouped(drawn, (tuple(given.draws[key] for key in others) for given in drawn.values())):
        yield ScenarioGroup(
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
    """Keys of an experiment's numbers in which scenarios of a group may differ."""
    others = (*GROUPS_IN_COMMON, *(f"disturbance.{name}." for name in given_signals(experiment.disturbance)))
    if is_automatic(experiment):
        others += ("plant.",)
    return frozenset(
        key
        for key, leaf in describe_parts(experiment).items()
        if leaf.kind in {float, int} and not leaf.optional
        if leaf.marks.isdisjoint(IN_COMMON) and not key.startswith(others)
        if Mark.SHAPES_CODE_AT_ZERO not in leaf.marks or leaf.marks.isdisjoint(OF_SIGNALS)
    )


def doubtful(group: ScenarioGroup) -> Flags:
    """(members,) whether each is to be looked at by itself."""
    if not group.columns:
        return np.ones(len(group.members), bool)
    try:
        prepare(group.experiment)
    except ConfigurationError:  # its members may be sound all the same
        return np.ones(len(group.members), bool)
    known, doubts = describe_parts(group.experiment), np.zeros(len(group.members), bool)
    for key, column in group.columns.items():
        doubts |= out_of_range(known[key], column)
    if not doubts.any():
        for doubt in _doubts(group):
            doubts |= doubt
    return doubts


def _doubts(group: ScenarioGroup) -> Iterator[Any]:
    """What one column alone does not determine: rules, sub-steps, states to start from."""
    parts = symbolic_parts(group.experiment, group.columns)
    for name in ("plant", "sensors", "actuator", "disturbance"):
        for _, owner, rule in rules(getattr(parts, name), f"{name}."):
            yield breaks(rule, owner)
    simulation = group.experiment.simulation
    if not is_automatic(group.experiment):
        integrator = solver_of(group.experiment).integrator
        yield ~(substeps_for(fastest_swing(parts.plant), simulation, integrator) <= simulation.substeps)
    first = starts(structure_of(group.experiment), group.vectors, group.experiment.reference.start)
    yield ~np.isfinite(first).all(axis=1)


def breaks(rule: Rule, group: Any) -> Any:
    """Where values of a group whose fields may be arrays break a rule; everywhere, where it is one of scalars alone."""
    try:
        return ~np.asarray(rule.holds(group), bool)
    except ValueError:  # the truth of an array
        return True


def out_of_range(leaf: Leaf, column: NDArray[Any]) -> Flags:
    """(values,) whether each is no finite number within the bounds of a leaf."""
    wrong = ~np.isfinite(column)
    for constraint in leaf.constraints:
        wrong |= ~COMPARISONS[type(constraint)][1](column, bound_of(constraint))
    if leaf.kind is int and column.dtype.kind not in "iu":
        wrong |= column != np.rint(column)
    return wrong


def check_batch(names: Sequence[str], values: Floats, scenarios: Scenarios) -> list[ScenarioGroup]:
    """The scenarios of a batch, checked, as groups.

    Raises:
        ConfigurationError: it cannot be run as asked; see `simulation.batch.rollout.rollout`.
    """
    if not scenarios:
        raise ConfigurationError("scenarios: must be at least one experiment")
    groups = scenario_groups(scenarios)
    first = groups[0].experiment
    structure = structure_of(first)
    described = described_parameters(structure)
    known = [name for name, leaf in described.items() if Mark.TIMING not in leaf.marks]
    for name in names:
        if name not in known:
            raise ConfigurationError(unknown("parameter", name, known))
    check_shape(names, values)
    columns = dict(zip(names, values.T, strict=True))
    _check_bounds(columns, described)
    scaling = [name for name in names if Mark.SCALES_DRAWS in described[name].marks]
    for group in groups:
        check_group(group, scenarios, scaling)
        if structure_of(group.experiment) != structure or group.experiment.samples != first.samples:
            place = group.members[0]
            raise ConfigurationError(f"scenarios[{place}]: must have the structure and the length of scenarios[0]")
    _check_together(columns, groups, scenarios, structure)
    return groups


def check_shape(names: Sequence[str], values: Floats) -> None:
    """Raise `ConfigurationError` where values are not sets with a value for each name."""
    if values.ndim != 2 or values.shape[1] != len(names):
        raise ConfigurationError(f"parameters: shape {values.shape} must be (n, {len(names)}), a column for each name")


def check_group(group: ScenarioGroup, scenarios: Scenarios, scaling: Iterable[str] = ()) -> None:
    """Members in doubt are shown to `prepare`, which has the words for what is wrong with them."""
    for place in group.members[doubtful(group)]:
        try:
            prepare(experiment_of(scenarios[place]))
        except ConfigurationError as error:
            raise ConfigurationError(f"{name_of(scenarios[place], place)}: {error}") from error
    for name in scaling:
        values = group.columns[name] if name in group.columns else leaves(group.experiment)[name]
        silent = np.broadcast_to(values == 0, len(group.members))
        if silent.any():  # what is drawn is drawn for the scenario, and without any there is nothing to scale
            place = group.members[silent.argmax()]
            where = name_of(scenarios[place], place)
            raise ConfigurationError(f"{where}: {name} = 0: must be > 0 where it varies (without it nothing is drawn)")


def _check_bounds(columns: Mapping[str, Floats], described: Mapping[str, Leaf]) -> None:
    """Each value's own range, whole columns at a time."""
    for name, column in columns.items():
        leaf = described[name]
        wrong, allowed = out_of_range(leaf, column), leaf.allowed or "finite"
        if leaf.kind is int:
            allowed = f"a whole number {leaf.allowed}".strip()
        elif leaf.kind is bool:
            wrong |= (column != 0) & (column != 1)
            allowed = "0 or 1"
        if wrong.any():
            row = int(wrong.argmax())
            raise ConfigurationError(f"parameters[{row}]: {name} = {column[row]:g}: must be {allowed}")


def _check_together(
    columns: Mapping[str, Floats], groups: Sequence[ScenarioGroup], scenarios: Scenarios, structure: Experiment
) -> None:
    """Rules between values: rows that break one are shown to `prepare`, which has the words for it."""
    if not columns:
        return
    rows = len(next(iter(columns.values())))
    whole_plant = any(name.startswith("plant.") for name in columns)
    if whole_plant:  # ropes, drums and loads of each scenario
        suspects = [(place, range(rows)) for place in range(len(scenarios))]
    else:
        first = {group.experiment.controller: group.members[0] for group in reversed(groups)}
        suspects = [(place, _breaking(controller, columns)) for controller, place in first.items()]
    described = described_parameters(structure)
    for place, chosen in suspects:
        for row in chosen:
            where = f"parameters[{row}]" + (f" in scenarios[{place}]" if len(scenarios) > 1 else "")
            values = {
                name: math.floor(column[row]) if described[name].kind is int else float(column[row])
                for name, column in columns.items()
            }
            changed = with_leaves(experiment_of(scenarios[place]), values)
            try:
                prepare(changed)
                _check_substeps(changed, structure)
            except ConfigurationError as error:
                raise ConfigurationError(f"{where}: {error}") from error


def _breaking(controller: Controller, columns: Mapping[str, Floats]) -> Iterable[int]:
    """Rows that break a rule of a controller."""
    broken = np.zeros(len(next(iter(columns.values()))), bool)
    for _, owner, rule in rules(with_leaves(controller, columns, "controller.")):
        broken |= breaks(rule, owner)
    return np.flatnonzero(broken)


def _check_substeps(experiment: Experiment, structure: Experiment) -> None:
    """A row's own ropes may ask for more sub-steps than the scenarios'."""
    needed = solver_of(experiment).substeps
    given = structure.simulation.substeps
    if needed > given:
        raise ConfigurationError(f"simulation.substeps = {given}: must be >= {needed} for ropes as stiff as these")


def by_structure(
    scenarios: Scenarios, progress: Progress, *, alike: bool = True
) -> Iterator[tuple[NDArray[np.int64], Scenarios, Progress]]:
    """Scenarios that one compiled loop runs: those of one structure, length, sample time and engine.

    The sub-steps are part of the structure: they follow from the laws of the ropes.

    Args:
        scenarios: of a batch.
        progress: called with the share of the batch that is done.
        alike: whether structures may differ in their sub-steps only.

    Yields:
        Their places in the batch, the scenarios, and what is called with the share of them that is done.

    Raises:
        ConfigurationError: scenarios differ in more than their sub-steps, and may not.
    """
    places: dict[tuple[Experiment, int, float, EngineName], list[int]] = {}
    for group in scenario_groups(scenarios):
        experiment, simulation = group.experiment, group.experiment.simulation
        shape = structure_of(experiment), experiment.samples, simulation.sample_time, simulation.engine
        places.setdefault(shape, []).extend(group.members.tolist())
    shapes = [(with_leaves(shape[0], {"simulation.substeps": 1}), *shape[1:-1]) for shape in places]
    for shape, indices in zip(shapes, places.values(), strict=True):
        if alike and shape != shapes[0]:
            where = f"scenarios[{indices[0]}]"
            raise ConfigurationError(
                f"{where}: must have the structure and the length of scenarios[0], and its sample time"
            )
    done = 0
    for indices in places.values() or [[]]:

        def report(share: float, before: int = done, count: int = len(indices)) -> None:
            progress((before + share * count) / len(scenarios))

        yield np.array(indices, np.int64), [scenarios[index] for index in indices], report
        done += len(indices)
