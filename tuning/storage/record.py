"""Records of a study in a storage: its definition, its budget, and evaluations as Optuna trials."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import another, unknown
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.space import ContinuousDimension, Space, space_from
from dualwinch.tuning.storage.parts import StudyName, check_parts
from dualwinch.tuning.storage.store import SearchBudget

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution

ORIGIN, OUTCOMES, SCENARIOS = "origin", "outcomes", "scenarios"
"""Names of user attributes, besides one for each statistic, such as ``mean.mse [m^2]``."""

EVALUATION = "evaluation"
"""In a database: the user attribute with all of these as one table, because each attribute takes a transaction."""


def distributions(space: Space) -> "dict[str, BaseDistribution]":
    """The space as Optuna distributions."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    return {
        dimension.name: FloatDistribution(dimension.lower, dimension.upper, log=dimension.log)
        if isinstance(dimension, ContinuousDimension)
        else CategoricalDistribution(dimension.choices)
        for dimension in space.dimensions
    }


def attributes(evaluation: Evaluation) -> dict[str, Any]:
    """The user attributes of an evaluation, with units in their names."""
    statistics = {f"{name} [{evaluation.units[name]}]": value for name, value in evaluation.statistics.items()}
    own = {ORIGIN: evaluation.candidate.origin, OUTCOMES: evaluation.outcomes, SCENARIOS: evaluation.scenarios}
    return own | statistics


def finished_trial(evaluation: Evaluation, space: Space) -> "optuna.trial.FrozenTrial":
    """An evaluation as a complete or pruned Optuna trial."""
    from optuna.trial import TrialState, create_trial

    return create_trial(
        state=TrialState.PRUNED if evaluation.pruned else TrialState.COMPLETE,
        values=list(evaluation.costs),
        params=dict(evaluation.point),
        distributions=distributions(space),
        user_attrs=attributes(evaluation),
        constraints=evaluation.violations,
        intermediate_values={evaluation.scenarios: evaluation.costs[0]} if evaluation.pruned else None,
    )


def evaluation_of(trial: "optuna.trial.FrozenTrial") -> Evaluation:
    """The evaluation of a finished Optuna trial."""
    from optuna.trial import TrialState

    kept = trial.user_attrs | trial.user_attrs.get(EVALUATION, {})
    candidate = Candidate(dict(trial.params), kept.get(ORIGIN, ""))
    titled = {name: title for title in kept if (name := title.partition(" [")[0]).count(".") == 1}
    return Evaluation(
        candidate=candidate,
        objectives=tuple(value if math.isfinite(value) else math.nan for value in trial.values or ()),
        violations=dict(trial.constraints),
        statistics={name: kept[title] for name, title in titled.items()},
        outcomes=kept.get(OUTCOMES, {}),
        scenarios=kept.get(SCENARIOS, 0),
        pruned=trial.state == TrialState.PRUNED,
        number=trial.number,
        units={name: title[len(name) + 2 : -1] for name, title in titled.items()},
    )


def finish(study: "optuna.Study", trial: "optuna.Trial", evaluation: Evaluation) -> None:
    """Finish an asked trial with its evaluation, in as few transactions as possible."""
    from optuna.trial import TrialState

    trial.set_user_attr(EVALUATION, attributes(evaluation))
    for name, violation in evaluation.violations.items():
        trial.set_constraint(name, violation)
    if evaluation.pruned:
        trial.report(evaluation.costs[0], evaluation.scenarios)
        study.tell(trial, state=TrialState.PRUNED, skip_if_finished=True)
    else:
        study.tell(trial, list(evaluation.costs), skip_if_finished=True)


def first_candidates(problem: TuningProblem) -> list[Candidate]:
    """First candidates of a study: the paper's gains, if its law is tuned, and the start."""
    paper, start = problem.paper_point, problem.start
    papers = [] if paper is None else [Candidate(paper, "paper")]
    return papers + ([Candidate(start, "start")] if start != paper else [])


DEFINITION, BUDGET, OBJECTIVES = "dualwinch definition", "dualwinch budget", "objectives"
"""User attributes of a study: its definition, its budget, and names of the values of a trial, with units."""


def begun(
    study: str,
    storage: "optuna.storages.BaseStorage",
    problem: TuningProblem,
    definition: Mapping[str, Any],
    budget: SearchBudget,
    file: Path | None = None,
    *,
    resume: bool,
) -> "optuna.Study":
    """Load a study, or create it if it does not exist.

    The definition is written last: a study without one, because its process was killed, is created again. Messages
    name `file`, if given.

    Raises:
        ConfigurationError: the study has another definition, or it has finished trials and `resume` is false.
    """
    import optuna
    from optuna.trial import TrialState

    name = StudyName(study, file)
    directions = [optuna.study.StudyDirection.MINIMIZE] * len(problem.objectives)
    there = optuna.create_study(study_name=study, storage=storage, directions=directions, load_if_exists=True)
    theirs = there.user_attrs
    if not there.get_trials(deepcopy=False) and set(theirs) <= {BUDGET, OBJECTIVES} and there.directions == directions:
        there.set_user_attr(BUDGET, asdict(budget))
        there.set_user_attr(OBJECTIVES, [f"{each.name} [{each.unit}]" for each in problem.objectives])
        there.set_user_attr(DEFINITION, dict(definition))
    else:
        known = theirs.get(DEFINITION)
        space = space_from((known or {}).get("space", []))
        check_definition(name, definition, known, (problem.space, space))
    count = sum(trial.state in {TrialState.COMPLETE, TrialState.PRUNED} for trial in there.get_trials(deepcopy=False))
    if count and not resume:
        raise ConfigurationError(f"{name} has {count} trials; continue with --resume, or {name.another}")
    return there


def definitions(storage: "optuna.storages.BaseStorage") -> dict[str, dict[str, Any] | None]:
    """Name of each study in a storage → its definition; ``None``: it is not a study of this program."""
    return {there.study_name: there.user_attrs.get(DEFINITION) for there in storage.get_all_studies()}


def joined_definition(study: str, storage: "optuna.storages.BaseStorage") -> dict[str, Any]:
    """The definition of a study to join.

    Raises:
        ConfigurationError: there is no such study (the message names the nearest), or it is not one of this program.
    """
    known = definitions(storage)
    if study not in known:
        raise ConfigurationError(f"--study: {unknown('study', study, sorted(known))}")
    definition = known[study]
    if definition is None:
        raise ConfigurationError(f"--study {study}: is not a study of this program")
    return definition


def check_definition(
    study: StudyName, ours: Mapping[str, Any], theirs: Mapping[str, Any] | None, spaces: tuple[Space, Space]
) -> None:
    """Check that a requested definition of a study agrees with that in the storage, and so do the spaces of both.

    Raises:
        ConfigurationError: they differ; the message names the difference. Or the storage has none: the study is not one
            of this program.
    """
    if theirs is None:
        raise ConfigurationError(f"{study} exists, but is not a study of this program; {study.another}")
    check_parts(study, ours.get("parts", []), theirs.get("parts", []))
    difference = spaces[0].difference(spaces[1])
    if difference:
        raise ConfigurationError(f"{study} has another space: {difference}; {study.another}")
    for key, value in ours.items():
        if key not in {"space", "parts"} and value != theirs.get(key):
            shown = f": {value!r} here, {theirs.get(key)!r} there" if len(repr(value)) < 100 else ""
            raise ConfigurationError(f"{study} was begun with {another(key)}{shown}; {study.another}")
