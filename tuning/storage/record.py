"""An evaluation as a trial of Optuna, and back."""

from typing import TYPE_CHECKING, Any

from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.space import ContinuousDimension, Space

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution

ORIGIN, OUTCOMES, SCENARIOS = "origin", "outcomes", "scenarios"
"""Names of user attributes, beside one for each statistic, such as ``mean.mse [m^2]``."""


def distributions(space: Space) -> "dict[str, BaseDistribution]":
    """The space as Optuna writes it."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    return {
        dimension.name: FloatDistribution(dimension.lower, dimension.upper, log=dimension.log)
        if isinstance(dimension, ContinuousDimension)
        else CategoricalDistribution(dimension.choices)
        for dimension in space.dimensions
    }


def attributes(evaluation: Evaluation) -> dict[str, Any]:
    """What is kept of an evaluation as user attributes, named and with units."""
    statistics = {f"{name} [{evaluation.units[name]}]": value for name, value in evaluation.statistics.items()}
    own = {ORIGIN: evaluation.candidate.origin, OUTCOMES: evaluation.outcomes, SCENARIOS: evaluation.scenarios}
    return own | statistics


def finished_trial(evaluation: Evaluation, space: Space) -> "optuna.trial.FrozenTrial":
    """An evaluation as a trial that is complete, or pruned; never failed."""
    from optuna.trial import TrialState, create_trial

    return create_trial(
        state=TrialState.PRUNED if evaluation.pruned else TrialState.COMPLETE,
        values=list(evaluation.objectives),
        params=dict(evaluation.point),
        distributions=distributions(space),
        user_attrs=attributes(evaluation),
        constraints=evaluation.violations,
        intermediate_values={evaluation.scenarios: evaluation.objectives[0]} if evaluation.pruned else None,
    )


def evaluation_of(trial: "optuna.trial.FrozenTrial") -> Evaluation:
    """The evaluation that a finished trial records."""
    from optuna.trial import TrialState

    kept = dict(trial.user_attrs)
    candidate = Candidate(dict(trial.params), kept.get(ORIGIN, ""))
    titled = {name: title for title in kept if (name := title.partition(" [")[0]).count(".") == 1}
    return Evaluation(
        candidate=candidate,
        objectives=tuple(trial.values or ()),
        violations=dict(trial.constraints),
        statistics={name: kept[title] for name, title in titled.items()},
        outcomes=kept.get(OUTCOMES, {}),
        scenarios=kept.get(SCENARIOS, 0),
        pruned=trial.state == TrialState.PRUNED,
        number=trial.number,
        units={name: title[len(name) + 2 : -1] for name, title in titled.items()},
    )
