"""What a storage keeps of a study beside its trials, and whether it is the study that is asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.space import Space, space_from
from dualwinch.tuning.storage.noted_parts import check_parts
from dualwinch.tuning.storage.store import SearchBudget

if TYPE_CHECKING:
    import optuna

DEFINITION, BUDGET, OBJECTIVES = "dualwinch definition", "dualwinch budget", "objectives"
"""User attributes of a study: what is tuned, how far, and what the values of a trial are."""


def titles(objectives: Sequence[Statistic]) -> list[str]:
    """What the values of a trial are, with units."""
    return [f"{statistic.name} [{statistic.unit}]" for statistic in objectives]


def begun(
    study: str,
    storage: "optuna.storages.BaseStorage",
    problem: TuningProblem,
    definition: Mapping[str, Any],
    budget: SearchBudget,
) -> "optuna.Study":
    """A study that is there, and the one that is asked for; else one that is new.

    The definition is written last: a study without one, whose process was killed before that, is begun anew.

    Raises:
        ConfigurationError: it has another definition.
    """
    import optuna

    directions = [optuna.study.StudyDirection.MINIMIZE] * len(problem.objectives)
    there = optuna.create_study(study_name=study, storage=storage, directions=directions, load_if_exists=True)
    theirs = there.user_attrs
    if not there.get_trials(deepcopy=False) and set(theirs) <= {BUDGET, OBJECTIVES} and there.directions == directions:
        there.set_user_attr(BUDGET, asdict(budget))
        there.set_user_attr(OBJECTIVES, titles(problem.objectives))
        there.set_user_attr(DEFINITION, dict(definition))
    else:
        known = theirs.get(DEFINITION)
        space = space_from((known or {}).get("space", []))
        check_definition(study, definition, known, (problem.space, space))
    return there


def check_definition(
    study: str, ours: Mapping[str, Any], theirs: Mapping[str, Any] | None, spaces: tuple[Space, Space]
) -> None:
    """Refuse to mix two problems in one study.

    Args:
        study: the study's name.
        ours: the definition asked for.
        theirs: the definition in the storage; ``None``: it is not a study of this program.
        spaces: both spaces.

    Raises:
        ConfigurationError: they differ; the message says in what.
    """
    if theirs is None:
        raise ConfigurationError(f"--study {study}: exists, and is none of this program; choose another name")
    check_parts(study, ours.get("parts", []), theirs.get("parts", []))
    difference = spaces[0].difference(spaces[1])
    if difference:
        raise ConfigurationError(f"--study {study}: has another space: {difference}; choose another name")
    for key, value in ours.items():
        if key not in {"space", "parts"} and value != theirs.get(key):
            shown = f": {value!r} here, {theirs.get(key)!r} there" if len(repr(value)) < 100 else ""
            raise ConfigurationError(f"--study {study}: was begun with another {key}{shown}; choose another name")


def check_resume(study: str, count: int, *, resume: bool) -> None:
    """Refuse to go on with a study by accident.

    Raises:
        ConfigurationError: there are trials and nobody asked to go on.
    """
    if count and not resume:
        raise ConfigurationError(f"--study {study}: has {count} trials; go on with --resume, or choose another name")
