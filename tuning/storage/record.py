"""Records of a study in a storage: its definition, its budget, and evaluations as Optuna trials."""

import math
from typing import TYPE_CHECKING

from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.space import ContinuousDimension, Space

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution

ORIGIN, OUTCOMES, SCENARIOS, STREAM = "origin", "outcomes", "scenarios", "stream"
"""Names of user attributes, besides one for each statistic, such as ``mean.mse [m^2]``."""


def distributions(space: Space) -> "dict[str, BaseDistribution]":
    """The space as Optuna distributions."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    return {
        dimension.name: FloatDistribution(dimension.lower, dimension.upper, log=dimension.log)
        if isinstance(dimension, ContinuousDimension)
        else CategoricalDistribution(dimension.choices)
        for dimension in space.dimensions
    }


def finished_trial(evaluation: Evaluation, space: Space, stream: str = "") -> "optuna.trial.FrozenTrial":
    """An evaluation as a complete or pruned Optuna trial; `stream` names the random stream of its search."""
    from optuna.trial import TrialState, create_trial

    attributes = {ORIGIN: evaluation.candidate.origin, STREAM: stream, OUTCOMES: evaluation.outcomes}
    statistics = {f"{name} [{evaluation.units[name]}]": value for name, value in evaluation.statistics.items()}
    return create_trial(
        state=TrialState.PRUNED if evaluation.pruned else TrialState.COMPLETE,
        values=list(evaluation.costs),
        params=dict(evaluation.point),
        distributions=distributions(space),
        user_attrs={**attributes, SCENARIOS: evaluation.scenarios, **statistics},
        constraints=evaluation.violations,
        intermediate_values={evaluation.scenarios: evaluation.costs[0]} if evaluation.pruned else None,
    )


def evaluation_of(trial: "optuna.trial.FrozenTrial") -> Evaluation:
    """The evaluation of a finished Optuna trial."""
    from optuna.trial import TrialState

    values = trial.user_attrs
    candidate = Candidate(dict(trial.params), values.get(ORIGIN, ""))
    titled = {name: title for title in values if (name := title.partition(" [")[0]).count(".") == 1}
    return Evaluation(
        candidate=candidate,
        objectives=tuple(value if math.isfinite(value) else math.nan for value in trial.values or ()),
        violations=dict(trial.constraints),
        statistics={name: values[title] for name, title in titled.items()},
        outcomes=values.get(OUTCOMES, {}),
        scenarios=values.get(SCENARIOS, 0),
        pruned=trial.state == TrialState.PRUNED,
        number=trial.number,
        units={name: title[len(name) + 2 : -1] for name, title in titled.items()},
    )


def finish(study: "optuna.Study", trial: "optuna.Trial", evaluation: Evaluation) -> None:
    """Finish an asked trial with its evaluation."""
    from optuna.trial import TrialState

    for name, violation in evaluation.violations.items():
        trial.set_constraint(name, violation)
    if evaluation.pruned:
        trial.report(evaluation.costs[0], evaluation.scenarios)
        study.tell(trial, state=TrialState.PRUNED)
    else:
        study.tell(trial, list(evaluation.costs))
