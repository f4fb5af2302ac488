"""An evaluation as a trial of Optuna, and back."""

from typing import TYPE_CHECKING, Any

from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.space import ContinuousDimension, Space

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution

ORIGIN, OUTCOMES, SCENARIOS = "origin", "outcomes", "scenarios"
"""Names of user attributes, beside one for each statistic, such as ``mean.mse [m^2]``."""

EVALUATION = "evaluation"
"""In a database: the user attribute that has all of these as one table, as each attribute takes a transaction."""


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

    kept = trial.user_attrs | trial.user_attrs.get(EVALUATION, {})
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


def finish(study: "optuna.Study", trial: "optuna.Trial", evaluation: Evaluation) -> None:
    """Finish a trial that was asked for with its evaluation, in as few transactions as there can be."""
    from optuna.trial import TrialState

    trial.set_user_attr(EVALUATION, attributes(evaluation))
    for name, violation in evaluation.violations.items():
        trial.set_constraint(name, violation)
    if evaluation.pruned:
        trial.report(evaluation.objectives[0], evaluation.scenarios)
        study.tell(trial, state=TrialState.PRUNED, skip_if_finished=True)
    else:
        study.tell(trial, list(evaluation.objectives), skip_if_finished=True)


def first_candidates(problem: TuningProblem) -> list[Candidate]:
    """What a study tries first: the paper's gains where its law is tuned, and the start."""
    paper, start = problem.paper_point, problem.start
    papers = [] if paper is None else [Candidate(paper, "paper")]
    return papers + ([Candidate(start, "start")] if start != paper else [])
