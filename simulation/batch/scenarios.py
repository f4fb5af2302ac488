"""Group the scenarios of a batch: by common experiment, to check them as columns, and by structure, to run them.

Scenarios that share an experiment and differ only in plain numbers form a `ScenarioGroup`: these numbers are columns,
which are checked as a whole. Only members that may be invalid are passed to `prepare`, whose message names the error.
Scenarios of one structure run in one compiled loop (`by_structure`).
"""

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
    ADAPTIVE,
    MOST_SUBSTEPS,
    LoopStructure,
    Solver,
    is_automatic,
    parameters_of,
    power_of_two,
    solver_of,
    structure_of,
    substeps_for,
    symbolic_parts,
)
from dualwinch.simulation.prepare import check_substeps, prepare
from dualwinch.simulation.progress import Progress
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.sensors import DELAYS, delays_beyond_memory

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Scenarios = Sequence[Experiment | Scenario]

IN_COMMON = frozenset({Mark.TIMING, Mark.SHAPES_CODE})
"""Marks of numbers that are equal within a group."""

OF_SIGNALS = frozenset({Mark.SCALES_DRAWS, Mark.DRAWN_AHEAD})
"""Marks of numbers that affect random signals: equal within a group if code depends on whether they are zero."""

GROUPS_IN_COMMON = ("controller.", "reference.", "metrics.", "plant.track.length", "plant.track.rope_offset")
"""Prefixes of further keys with equal values within a group: the nominal plant or the motion depends on them."""


@dataclass(frozen=True, eq=False)
class ScenarioGroup:
    """Scenarios that share an experiment and differ in plain numbers.

    Attributes:
        members: their indices in the batch, (n,).
        experiment: their common experiment; numbers in which they differ are placeholders.
        nominal: the plant their controllers were designed for; None: that of the experiment.
        drawn_keys: keys of all drawn values.
        columns: key → the members' own numbers, (n,).
    """

    members: NDArray[np.int64]
    experiment: Experiment
    nominal: Plant | None
    drawn_keys: frozenset[str]
    columns: dict[str, NDArray[Any]]

    @cached_property
    def numbers(self) -> dict[str, float]:
        """`parameters_of` the experiment."""
        return parameters_of(self.experiment, self.nominal)

    @cached_property
    def vectors(self) -> NDArray[np.float64]:
        """Parameter vectors of all members, (n, parameters)."""
        vectors = np.tile(np.array(list(self.numbers.values())), (len(self.members), 1))
        for number, key in enumerate(self.numbers):
            if key in self.columns:
                vectors[:, number] = self.columns[key]
        return vectors


def scenario_groups(scenarios: Scenarios) -> list[ScenarioGroup]:
    """Group scenarios; most batches are one group.

    Within a group, words are equal, and so are numbers that affect more than compiled code and random signals.

    Raises:
        ConfigurationError: a value of these is out of its range; the message names the scenario.
    """
    groups: list[ScenarioGroup] = []
    for places in _grouped(range(len(scenarios)), map(_group_key, scenarios)):
        scenario = scenarios[places[0]]
        if isinstance(scenario, Experiment):
            groups.append(ScenarioGroup(np.array(places), scenario, None, frozenset(), {}))
        else:
            groups += _of_draws({place: draw for place in places if isinstance(draw := scenarios[place], Scenario)})
    return groups


def _of_draws(drawn: Mapping[int, Scenario]) -> Iterator[ScenarioGroup]:
    """Groups of draws of one experiment, given by their indices in the batch; the same keys have words as values.

    Which numbers are zero is equal within a group where zero leaves code out.
    """
    place, example = next(iter(drawn.items()))
    worded = [key for key, value in example.draws.items() if not _is_number(value)]
    descriptions = describe_parts(_having(example, place, worded))
    shaping = [
        key for key in example.draws if key in descriptions and Mark.SHAPES_CODE_AT_ZERO in descriptions[key].marks
    ]
    patterns = (tuple(draw.draws[key] != 0 for key in shaping) for draw in drawn.values())
    for members in list(_grouped(drawn, patterns)):
        plain = plain_numbers(_having(drawn[members[0]], members[0], [*worded, *shaping]))
        columns = [key for key in example.draws if key in plain]
        shaping_keys = [key for key in example.draws if key not in plain]
        for places in _grouped(members, (tuple(drawn[place].draws[key] for key in shaping_keys) for place in members)):
            group = ScenarioGroup(
                members=np.array(places),
                experiment=_having(drawn[places[0]], places[0], {*shaping_keys, *shaping}),
                nominal=example.nominal,
                drawn_keys=frozenset(example.draws),
                columns={key: np.array([drawn[place].draws[key] for place in places]) for key in columns},
            )
            yield from _by_substeps(group)


def _by_substeps(group: ScenarioGroup) -> Iterator[ScenarioGroup]:
    """Split a group by the sub-steps of the adaptive integrator: members that need more than the common experiment.

    Each of them has as many as it would have alone, whatever else is in the batch.
    """
    simulation = group.experiment.simulation
    numbers = [0] * len(group.members)
    if simulation.integrator == ADAPTIVE and not is_automatic(group.experiment):
        numbers = _more_substeps(group).tolist()
    for places in _grouped(range(len(numbers)), numbers):
        if not (number := numbers[places[0]]):
            experiment = group.experiment
        else:
            experiment = replace(group.experiment, simulation=replace(simulation, substeps=number))
        columns = {key: column[places] for key, column in group.columns.items()}
        yield replace(group, members=group.members[places], experiment=experiment, columns=columns)


def _more_substeps(group: ScenarioGroup) -> NDArray[np.int64]:
    """(members,) sub-steps, a power of two, where the common experiment's are too few; 0 elsewhere.

    Members without a valid number of them get 0: `check_group` names what is wrong.
    """
    experiment, more = group.experiment, np.zeros(len(group.members), np.int64)
    try:
        solver, plant = solver_of(experiment), symbolic_parts(experiment, group.columns).plant
        with np.errstate(all="ignore"):
            needed = substeps_for(plant, experiment.simulation, solver.integrator, experiment.controller.limits)
    except (ConfigurationError, ArithmeticError):
        return more
    needed = np.broadcast_to(needed, len(group.members))
    stiff = (needed > solver.substeps) & (needed <= MOST_SUBSTEPS)
    more[stiff] = [power_of_two(math.ceil(number)) for number in needed[stiff]]
    return more


def _grouped(places: Iterable[int], keys: Iterable[Hashable]) -> Iterable[list[int]]:
    groups: dict[Hashable, list[int]] = {}
    for place, key in zip(places, keys, strict=True):
        groups.setdefault(key, []).append(place)
    return groups.values()


def _group_key(given: Experiment | Scenario) -> Hashable:
    if isinstance(given, Experiment):
        return id(given)
    draws = (key if _is_number(value) else (key, value) for key, value in given.draws.items())
    return id(given.base), id(given.nominal), *draws


def _having(scenario: Scenario, place: int, keys: Iterable[str]) -> Experiment:
    """The experiment of a scenario with only some of its draws."""
    try:
        return with_leaves(scenario.base, {key: scenario.draws[key] for key in keys})
    except ConfigurationError as error:
        raise ConfigurationError(f"{name_of(scenario, place)}: {error}") from error


def _is_number(value: Any) -> bool:
    return isinstance(value, (float, int)) and not isinstance(value, bool)


def experiment_of(given: Experiment | Scenario) -> Experiment:
    """The experiment of a scenario, or the experiment itself."""
    return given.experiment if isinstance(given, Scenario) else given


def name_of(given: Experiment | Scenario, place: int) -> str:
    """Name of a scenario of a batch in error messages."""
    return f"scenario {given.index}" if isinstance(given, Scenario) else f"scenarios[{place}]"


def plain_numbers(experiment: Experiment) -> frozenset[str]:
    """Keys of an experiment's numbers in which scenarios of a group may differ."""
    prefixes = (*GROUPS_IN_COMMON, *(f"disturbance.{name}." for name in given_signals(experiment.disturbance)))
    if is_automatic(experiment):
        prefixes += ("plant.",)
    return frozenset(
        key
        for key, leaf in describe_parts(experiment).items()
        if leaf.kind in {float, int} and not leaf.optional
        if leaf.marks.isdisjoint(IN_COMMON) and not key.startswith(prefixes)
        if Mark.SHAPES_CODE_AT_ZERO not in leaf.marks or leaf.marks.isdisjoint(OF_SIGNALS)
    )


def suspect_members(group: ScenarioGroup) -> Flags:
    """(members,) whether each needs a check of its own."""
    if not group.columns:
        return np.ones(len(group.members), bool)
    try:
        prepare(group.experiment)
    except ConfigurationError:  # its members may be valid nevertheless
        return np.ones(len(group.members), bool)
    descriptions, suspect = describe_parts(group.experiment), np.zeros(len(group.members), bool)
    for key, column in group.columns.items():
        suspect |= out_of_range(descriptions[key], column)
    if not suspect.any():
        for violated in _violations(group):
            suspect |= violated
    return suspect


def _violations(group: ScenarioGroup) -> Iterator[Any]:
    """Checks that involve several columns: rules, sub-steps, initial states; (members,) each, true where violated."""
    parts = symbolic_parts(group.experiment, group.columns)
    for name in ("plant", "sensors", "actuator", "disturbance"):
        for _, owner, rule in rules(getattr(parts, name), f"{name}."):
            yield violates(rule, owner)
    simulation = group.experiment.simulation
    yield from delays_beyond_memory(parts.sensors, simulation.sample_time).values()
    if not is_automatic(group.experiment):
        solver = solver_of(group.experiment)
        limits = group.experiment.controller.limits
        yield ~(substeps_for(parts.plant, simulation, solver.integrator, limits) <= solver.substeps)
    start_states = starts(structure_of(group.experiment), group.vectors, group.experiment.reference.start)
    yield ~np.isfinite(start_states).all(axis=1)


def violates(rule: Rule, group: Any) -> Any:
    """Where fields of a group, which may be arrays, violate a rule; True if the rule cannot be evaluated on arrays."""
    try:
        return ~np.asarray(rule.holds(group), bool)
    except ValueError:  # the truth of an array
        return True


def out_of_range(leaf: Leaf, column: NDArray[Any]) -> Flags:
    """(values,) whether each is not finite or outside the bounds of a leaf."""
    wrong = ~np.isfinite(column)
    for constraint in leaf.constraints:
        wrong |= ~COMPARISONS[type(constraint)][1](column, bound_of(constraint))
    if leaf.kind is int and column.dtype.kind not in "iu":
        wrong |= column != np.rint(column)
    return wrong


def check_batch(names: Sequence[str], values: Floats, scenarios: Scenarios) -> list[ScenarioGroup]:
    """Check a batch and group its scenarios.

    Raises:
        ConfigurationError: see `simulation.batch.rollout.rollout`.
    """
    if not scenarios:
        raise ConfigurationError("scenarios: must be at least one experiment")
    groups = scenario_groups(scenarios)
    experiment = groups[0].experiment
    structure = structure_of(experiment)
    described = structure.parameters
    parameters = [name for name, leaf in described.items() if Mark.TIMING not in leaf.marks]
    for name in names:
        if name not in parameters:
            raise ConfigurationError(unknown("parameter", name, parameters))
    check_shape(names, values)
    columns = dict(zip(names, values.T, strict=True))
    _check_bounds(columns, described)
    scaling = [name for name in names if Mark.SCALES_DRAWS in described[name].marks]
    for group in groups:
        check_group(group, scenarios, scaling)
        if structure_of(group.experiment) != structure or group.experiment.samples != experiment.samples:
            place = group.members[0]
            raise ConfigurationError(f"scenarios[{place}]: must have the structure and the length of scenarios[0]")
    _check_together(columns, groups, scenarios, structure)
    return groups


def check_shape(names: Sequence[str], values: Floats) -> None:
    """Raise `ConfigurationError` unless values have the shape (n, names)."""
    if values.ndim != 2 or values.shape[1] != len(names):
        raise ConfigurationError(f"parameters: shape {values.shape} must be (n, {len(names)}), a column for each name")


def check_group(group: ScenarioGroup, scenarios: Scenarios, scaling: Iterable[str] = ()) -> None:
    """Pass suspect members to `prepare`, whose error names the invalid value."""
    for place in group.members[suspect_members(group)]:
        try:
            member = experiment_of(scenarios[place])
            prepare(member)
            check_substeps(member, solver_of(group.experiment))
        except ConfigurationError as error:
            raise ConfigurationError(f"{name_of(scenarios[place], place)}: {error}") from error
    for name in scaling:
        values = group.columns[name] if name in group.columns else leaves(group.experiment)[name]
        silent = np.broadcast_to(values == 0, len(group.members))
        if silent.any():  # signals are drawn for the scenario; without any there is nothing to scale
            place = group.members[silent.argmax()]
            where = name_of(scenarios[place], place)
            raise ConfigurationError(f"{where}: {name} = 0: must be > 0 where it varies (without it nothing is drawn)")


def _check_bounds(columns: Mapping[str, Floats], described: Mapping[str, Leaf]) -> None:
    """Check the range of each value, column by column."""
    for name, column in columns.items():
        leaf = described[name]
        wrong, allowed = out_of_range(leaf, column), leaf.allowed or "finite"
        if leaf.kind is int:
            allowed = f"a whole number {leaf.allowed}".strip()
        elif leaf.kind is bool:
            wrong |= (column != 0) & (column != 1)
            allowed = "0 or 1"
        if Mark.SHAPES_CODE_AT_ZERO in leaf.marks:
            wrong, allowed = wrong | (column == 0), "> 0, as in the scenarios: zero leaves its effect out of the code"
        if wrong.any():
            row = int(wrong.argmax())
            raise ConfigurationError(f"parameters[{row}]: {name} = {column[row]:g}: must be {allowed}")


def _check_together(
    columns: Mapping[str, Floats], groups: Sequence[ScenarioGroup], scenarios: Scenarios, structure: LoopStructure
) -> None:
    """Check rules between values: pass rows that may break one to `prepare`, whose error names it."""
    if not columns:
        return
    rows = len(next(iter(columns.values())))
    delays = {f"sensors.{name}" for name in DELAYS}
    whole_plant = any(name.startswith("plant.") or name in delays for name in columns)
    if whole_plant:  # ropes, drums, loads and sample time of each scenario
        suspects = [(place, range(rows)) for place in range(len(scenarios))]
    else:
        place_by_controller = {group.experiment.controller: group.members[0] for group in reversed(groups)}
        suspects = [(place, _violating(controller, columns)) for controller, place in place_by_controller.items()]
    described, solver = structure.parameters, Solver(structure.integrator, structure.substeps)
    for place, suspect_rows in suspects:
        for row in suspect_rows:
            where = f"parameters[{row}]" + (f" in scenarios[{place}]" if len(scenarios) > 1 else "")
            values = {
                name: math.floor(column[row]) if described[name].kind is int else float(column[row])
                for name, column in columns.items()
            }
            changed = with_leaves(experiment_of(scenarios[place]), values)
            try:
                prepare(changed)
                check_substeps(changed, solver)
            except ConfigurationError as error:
                raise ConfigurationError(f"{where}: {error}") from error


def _violating(controller: Controller, columns: Mapping[str, Floats]) -> Iterable[int]:
    """Rows that violate a rule of a controller."""
    violated = np.zeros(len(next(iter(columns.values()))), bool)
    for _, owner, rule in rules(with_leaves(controller, columns, "controller.")):
        violated |= violates(rule, owner)
    return np.flatnonzero(violated)


def by_structure(
    scenarios: Scenarios, progress: Progress, *, alike: bool = True
) -> Iterator[tuple[NDArray[np.int64], Scenarios, Progress]]:
    """Split scenarios by compiled loop: equal structure, length, sample time and engine.

    Sub-steps are part of the structure, as they may follow from the rope laws. If `alike`, structures may
    differ in nothing else.

    Yields:
        Indices in the batch, the scenarios, and a receiver of progress for them, which reports that of the batch.

    Raises:
        ConfigurationError: scenarios differ in more than their sub-steps, though `alike`.
    """
    places: dict[tuple[LoopStructure, int, float, EngineName], list[int]] = {}
    for group in scenario_groups(scenarios):
        experiment, simulation = group.experiment, group.experiment.simulation
        shape = structure_of(experiment), experiment.samples, simulation.sample_time, simulation.engine
        places.setdefault(shape, []).extend(group.members.tolist())
    shapes = [(replace(shape[0], substeps=1), *shape[1:-1]) for shape in places]
    for shape, indices in zip(shapes, places.values(), strict=True):
        if alike and shape != shapes[0]:
            odd = sorted(shape[0].parameters.keys() ^ shapes[0][0].parameters.keys())
            difference = f"; zero or absent in one of them alone: {', '.join(odd[:4])}" if odd else ""
            raise ConfigurationError(
                f"scenarios[{indices[0]}]: must have the structure and the length of scenarios[0], and its sample time"
                f"{difference}"
            )
    finished_count = 0
    for indices in places.values() or [[]]:

        def report(share: float, before: int = finished_count, count: int = len(indices)) -> None:
            progress((before + share * count) / len(scenarios))

        yield np.array(indices, np.int64), [scenarios[index] for index in indices], report
        finished_count += len(indices)
