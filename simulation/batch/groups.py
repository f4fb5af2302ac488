"""Batches whose scenarios take different numbers of sub-steps, as the laws of their ropes ask for: run one by one."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.family import Scenarios, experiment_of, families
from dualwinch.simulation.integrators.solver import is_automatic, solver_of
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.results.outcomes import WORDS

Progress = Callable[[float], None] | None


class Interruptible(Protocol):
    """A result of a batch."""

    @property
    def interrupted(self) -> bool: ...  # noqa: D102


Result = TypeVar("Result", bound=Interruptible)


def run_in_groups(run: Callable[[Scenarios, Progress], Result], scenarios: Scenarios, progress: Progress) -> Result:
    """The result of a batch, of groups of scenarios with the same sub-steps each: no pair depends on its neighbours.

    Args:
        run: gives the result of scenarios that go together; a dataclass of arrays (n, m, ...) and dictionaries of such.
        scenarios: m of them.
        progress: called now and then with the share that is done.

    Raises:
        ConfigurationError: scenarios of different groups do not go together.
    """
    groups: dict[int, list[int]] = {}
    for family in families(scenarios):
        experiment = family.experiment
        substeps = solver_of(experiment).substeps if is_automatic(experiment) else 0
        groups.setdefault(substeps, []).extend(family.members.tolist())
    if len(groups) <= 1:
        return run(scenarios, progress)
    _check_together(scenarios, [indices[0] for indices in groups.values()])
    results, done = [], 0
    for indices in groups.values():
        if results and results[-1].interrupted:
            results.append(_left_out(results[-1], len(indices)))
            continue

        def report(share: float, before: int = done, count: int = len(indices)) -> None:
            if progress:
                progress((before + share * count) / len(scenarios))

        results.append(run([scenarios[index] for index in indices], report))
        done += len(indices)
    return _merged(results, list(groups.values()))


def _check_together(scenarios: Scenarios, indices: list[int]) -> None:
    experiments = [experiment_of(scenarios[index]) for index in indices]
    shapes = [(replace(structure_of(experiment), substeps=0), experiment.samples) for experiment in experiments]
    for index, shape in zip(indices, shapes, strict=True):
        if shape != shapes[0]:
            raise ConfigurationError(f"scenarios[{index}]: must have the structure and the length of scenarios[0]")


def _left_out(result: Any, count: int) -> Any:
    """The result of scenarios that an interrupt left out, shaped like another."""

    def emptied(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: emptied(table) for name, table in value.items()}
        if not isinstance(value, np.ndarray):
            return value
        nothing = WORDS[Outcome.NOT_RUN] if value.dtype.kind == "U" else np.nan
        return np.full((len(value), count, *value.shape[2:]), nothing, value.dtype)

    return replace(result, **{f.name: emptied(getattr(result, f.name)) for f in fields(result)})


def _merged(results: list[Result], groups: list[list[int]]) -> Result:
    """Results of groups as one, the scenarios in their order."""
    order = np.argsort(np.concatenate(groups))

    def joined(values: list[Any]) -> Any:
        if isinstance(values[0], np.ndarray):
            return np.concatenate(values, axis=1)[:, order]
        if isinstance(values[0], dict):
            return {name: joined([value[name] for value in values]) for name in values[0]}
        return any(values) if isinstance(values[0], bool) else values[0]

    first: Any = results[0]
    return type(first)(**{f.name: joined([getattr(result, f.name) for result in results]) for f in fields(first)})
