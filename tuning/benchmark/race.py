"""The function `dualwinch.race`: every law tuned with one budget, and scored where nobody has been."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.toml_text import parse_assignment
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.exogenous.signals import named_seed
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.baseline import default_estimator
from dualwinch.tuning.benchmark.entries import (
    COORDINATION,
    ESTIMATOR,
    HELD_OUT,
    LAW,
    ROLLOUTS,
    BenchmarkEntry,
    BenchmarkTerms,
    EntryProblem,
    combinations,
    kinds,
)
from dualwinch.tuning.benchmark.entries import ablations as ablated
from dualwinch.tuning.benchmark.result import BenchmarkResult
from dualwinch.tuning.benchmark.run import Breaking
from dualwinch.tuning.benchmark.run import race as run
from dualwinch.tuning.optimisers import check_method, default_method
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.robustness.stress import check_stress, stress_tuned
from dualwinch.tuning.robustness.summary import by_what, where
from dualwinch.tuning.tuning_problem import configuration, definition_of, tuning_problem

OPTIONS = {LAW: "--law", ESTIMATOR: "--estimator", COORDINATION: "--coordination"}
"""Key of a part → option that chooses it."""

STRESS_SCENARIOS = 8
"""Scenarios of every size in which it is looked for what breaks gains first."""

SHOWN = 3
"""Imperfections that are named, the first that breaks gains first."""


def race(
    ensemble: str | PathLike[str] | Ensemble = "rig",
    *,
    laws: Sequence[str] | str | None = None,
    estimators: Sequence[str] | str | None = None,
    coordinations: Sequence[str] | str | None = None,
    ablations: bool = False,
    rollouts: int = ROLLOUTS,
    searches: int = 1,
    held_out: int = HELD_OUT,
    scenarios: int | None = None,
    seed: int = 0,
    settings: Sequence[str] = (),
    constraints: Sequence[str] | None = None,
    method: str | None = None,
    stress: bool = False,
    out: str | PathLike[str] | None = None,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> BenchmarkResult:
    """Tune every combination of parts with the same number of rollouts, and score all in the same unseen scenarios.

    An interrupt (Ctrl-C) keeps what is finished, and the same call with the same folder goes on with the rest. A
    later call may add entries to a folder; all that are in it take part.

    Args:
        ensemble: name or file of what scenarios are drawn from, or an ensemble of your own.
        laws: kinds of position laws, registered ones of your own among them; default: all.
        estimators: kinds of estimators, or ``all``; default: what `dualwinch.tuning_problem` takes for the ensemble.
        coordinations: kinds of coordinations, or ``all``; default: the paper's.
        ablations: whether the paper's law takes part without each of its parts, too.
        rollouts: of each search (see `dualwinch.tune`).
        searches: of each entry, by seeds of their own; more than one tell how much is luck.
        held_out: number of unseen scenarios that score.
        scenarios: that a candidate is tuned on; default: those of `dualwinch.tuning_problem`.
        seed: of all scenarios and searches.
        settings: such as ``plant.vehicle.mass=12000``, for all.
        constraints: as of `dualwinch.tuning_problem`, for all.
        method: name of the optimiser; default: that of `dualwinch.tune`.
        stress: whether it is found out what breaks the best of each first (see `dualwinch.stress`).
        out: folder that finished entries are kept in; default: nowhere.
        threads: default: one a core.
        progress: called now and then with the share that is done of what there is to do, and with what is being done.

    Returns:
        The race; it has a table as text and in a notebook, `plot` and `plot_fronts`.

    Raises:
        ConfigurationError: anything wrong with a kind, a key, a value or a constraint, parts that do not go together,
            or a folder that holds another race.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted before the first entry was finished.
    """
    drawn = ensemble if isinstance(ensemble, Ensemble) else load_ensemble(ensemble)
    for key in drawn.distributions:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: is drawn in '{drawn.name}'; a race needs the gains as they are")
    for text in settings:
        key = parse_assignment(text)[0]
        if key in OPTIONS:
            raise ConfigurationError(f"{text}: give {OPTIONS[key]}, for all kinds that are to take part")
    method = method or default_method(1)
    check_method(method, 1)
    usual = default_estimator(drawn), Controller().coordination.kind
    entries = combinations(
        kinds(laws, POSITION_LAWS, list(POSITION_LAWS)),
        kinds(estimators, ESTIMATORS, [usual[0]]),
        kinds(coordinations, COORDINATIONS, [usual[1]]),
    )
    if ablations:
        entries += ablated(*usual)
    if searches < 1:
        raise ConfigurationError(f"searches = {searches}: must be a whole number >= 1")
    entrants: dict[str, EntryProblem] = {}
    for entry in (replace(entry, search=search) for search in range(searches) for entry in entries):
        problem = _problem(entry, drawn, settings, constraints, scenarios, seed)
        entrants[entry.key] = EntryProblem(entry, problem, definition_of(problem, method))
    first = next(iter(entrants.values())).problem
    terms = BenchmarkTerms(
        ensemble=drawn.name,
        configuration=configuration(replace(first, experiment=first.paper_experiment)),
        constraints=tuple(constraint.text for constraint in first.constraints),
        method=method,
        rollouts=rollouts,
        scenarios=first.scenarios,
        held_out=held_out,
        seed=seed,
    )
    return run(
        list(entrants.values()),
        terms,
        folder=None if out is None else Path(out),
        breaking=_breaking(first, threads) if stress else None,
        threads=threads,
        told=progress,
    )


def _problem(
    entry: BenchmarkEntry,
    ensemble: Ensemble,
    settings: Sequence[str],
    constraints: Sequence[str] | None,
    scenarios: int | None,
    seed: int,
) -> TuningProblem:
    try:
        return tuning_problem(
            ensemble=ensemble,
            settings=[*settings, *(f"{key}={value}" for key, value in entry.values.items())],
            constraints=constraints,
            scenarios=scenarios,
            seed=named_seed(seed, f"search {entry.search}") if entry.search else seed,
            held=entry.held,
        )
    except ConfigurationError as error:
        raise ConfigurationError(f"{entry.key}: {error}") from error


def _breaking(problem: TuningProblem, threads: int | None) -> Breaking:
    """Tells what breaks the gains of an experiment first.

    Raises:
        ConfigurationError: there is no imperfection that the gains are not tuned for.
    """
    check_stress(problem)
    name = "given"

    def breaking(experiment: Experiment) -> tuple[dict[str, Any], ...]:
        found = stress_tuned(problem, experiment, scenarios=STRESS_SCENARIOS, name=name, threads=threads)
        if name not in found.names:  # lost without any imperfection, or the paper's own gains
            return tuple({"label": "none", "size": "", "broken": broken.words} for broken in found.lost.get(name, ()))
        return tuple(
            {
                "label": row.imperfection.label,
                "size": where(found, row, row.breaks[name]),
                "broken": by_what(row, row.breaks[name]),
            }
            for row in found.ranking[:SHOWN]
        )

    return breaking
