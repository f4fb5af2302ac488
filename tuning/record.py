"""Files of a study: ``best.toml`` for simulation, and ``study.json`` with every trial and score."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dualwinch.analysis.idealisations import idealisations
from dualwinch.analysis.remarks import in_full
from dualwinch.codegen.files import atomic
from dualwinch.codegen.text import one_line
from dualwinch.model.quantities.figures import plain
from dualwinch.model.quantities.quantity import behind_number
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.tuning.problem import CERTIFICATE, CHECKS, TEST, TRAINING
from dualwinch.tuning.result import (
    TuningResult,
    contenders,
    gains_at_bounds,
    headline,
    instability,
    margin_places,
    number,
    tested,
    where,
    widen,
    worth,
)
from dualwinch.tuning.scoring.ranking import Evaluation, pareto_front
from dualwinch.tuning.scoring.test_set import ControllerScore
from dualwinch.tuning.space import space_to_record

BEST = "--config best.toml"
"""Options that select the best gains, in the folder of the two files."""


def write_best(path: str | Path, tuned: TuningResult, toml: str, facts: Mapping[str, Any], typed: str = BEST) -> None:
    """Write the best's experiment, `toml`, as a configuration file, with its provenance in comments.

    `facts` are further provenance by name, such as code version and date. `typed` are the options that select the best
    gains in the file's folder, for commands in notes.
    """
    problem, verdict = tuned.problem, tuned.verdict
    best, scored = verdict.best, verdict.scored
    references = [name for name in ("start", "paper") if name in verdict.shown]
    lines = ["The best gains of a study by `dualwinch tune`."]
    lines += [f"{name}: {value}" for name, value in facts.items()]
    lines += [
        worth(tuned),
        headline(tuned),
        *(f"note: {in_full(words, typed)}" for words in tuned.remarks),
        tested(tuned),
        *problem.choices,
        *contenders(tuned),
    ]
    lines += [f"trial: {best.number if verdict.improved else 'the start'}"]
    lines += [f"objective: {', '.join(objective.name for objective in problem.objectives)}"]
    lines += [f"feasible: {_yes(best.feasible)} where tuned, {_yes(scored.feasible)} {where(tuned)}"]
    lines += [f"{where(tuned)}{', ' * bool(references)}{' and '.join(references)} in brackets:"]
    for name, value in scored.statistics.items():
        unit = behind_number(problem.units[name])
        beside = ", ".join(number(verdict.statistics(other)[name]) for other in references)
        lines.append(f"    {name} = {number(value)}{unit}" + (f" ({beside})" if references else ""))
    lines += ["constraints there:"]
    lines += [
        f"    {constraint.label}: {number(scored.statistics[constraint.statistic.name])}, "
        f"{'satisfied' if scored.violations[constraint.label] <= 0 else 'violated'}"
        for constraint in verdict.constraints
    ]
    if places := margin_places(tuned):
        lines += ["least stability margins:", *(f"    {words}" for words in places)]
    if at_bounds := widen(tuned):
        lines.append(at_bounds)
    lines += ["tuned keys:", *(f"    {key} = {value}" for key, value in tuned.gains.items())]
    with atomic(Path(path)) as unfinished:
        unfinished.write_text(
            "".join(f"# {one_line(line)}".rstrip() + "\n" for line in lines) + "\n" + toml, encoding="utf-8"
        )


def write_study(
    path: str | Path, tuned: TuningResult, facts: Mapping[str, Any], configuration: str, typed: str = BEST
) -> None:
    """Write the content of a report as JSON: the problem, every trial as columns, the best and the test scores.

    `configuration` is the TOML of ensemble or experiment; `facts` and `typed` are as in `write_best`.
    """
    problem, verdict = tuned.problem, tuned.verdict
    content = {
        **facts,
        "seeds": {name: problem.stream(name) for name in (TRAINING, CHECKS, CERTIFICATE, TEST)},
        "scenarios": {
            TRAINING: len(tuned.training.scenarios),
            CERTIFICATE: verdict.certificate.draws if verdict.certificate else 0,
            TEST: verdict.scored.scenarios if verdict.has_test_set else 0,
        },
        "options": asdict(problem.options),
        "objectives": [{"name": objective.name, "unit": objective.unit} for objective in problem.objectives],
        "constraints": [
            {
                "text": constraint.text,
                "label": constraint.label,
                "statistic": constraint.statistic.name,
                "at_least": constraint.at_least,
                "bound": _finite(constraint.bound),
                "unit": constraint.statistic.unit,
            }
            for constraint in tuned.training.constraints
        ],
        "space": space_to_record(problem.space),
        "units": problem.units,
        "trials": trial_columns(tuned),
        "pareto_front": [tuned.trials[index].number for index in pareto_front(tuned.trials)],
        "best": {
            "trial": verdict.best.number if verdict.improved else None,
            "start_kept": verdict.obstacle or None,
            "certificate": verdict.certificate.to_dict() if verdict.certificate else None,
            "examined": verdict.examined,
            "unexamined": verdict.unexamined,
            "test_violations": verdict.test_violations if verdict.has_test_set else None,
            "test_violation_interval": list(verdict.violation_interval(problem.options.confidence))
            if verdict.has_test_set
            else None,
            "test_mean_interval": verdict.mean_interval(problem.objectives[0], problem.options.confidence),
            "contradiction": verdict.contradiction or None,
            "instability": instability(tuned) or None,
            "remarks": [in_full(words, typed) for words in tuned.remarks],
            "settings": tuned.gains,
            "at_bounds": dict(gains_at_bounds(tuned)),
            "training": _scores(verdict.best),
            "test": _scores(verdict.scored if verdict.has_test_set else None),
        },
        "margins": {name: _attained(score) for name, score in verdict.scores.items()},
        "start": _scores(verdict.scores["start"].evaluation),
        "paper": _scores(verdict.scores["paper"].evaluation),
        "test": {name: _table(score.result) for name, score in verdict.scores.items() if verdict.has_test_set},
        "within_authority": verdict.within_authority.tolist() if verdict.has_test_set else [],
        "metric_units": {
            name: quantity.unit for name, quantity in metric_quantities(problem.experiment.metrics).items()
        },
        "cost": {"trials": len(tuned.trials), "seconds": tuned.cost.seconds, **asdict(tuned.cost)},
        "idealisations": [plain(asdict(one)) for one in idealisations(tuned.best)],
        "interrupted": tuned.interrupted,
        "configuration": configuration,
    }
    with atomic(Path(path)) as unfinished:
        unfinished.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def trial_columns(tuned: TuningResult) -> dict[str, Any]:
    """The trials as columns for JSON: each a list with one entry per trial, some in named groups."""
    problem, trials = tuned.problem, tuned.trials
    return {
        "number": [trial.number for trial in trials],
        "origin": [trial.candidate.origin for trial in trials],
        "state": ["pruned" if trial.pruned else "complete" for trial in trials],
        "feasible": [trial.feasible for trial in trials],
        "scenarios": [trial.scenarios for trial in trials],
        "outcomes": [trial.outcomes for trial in trials],
        "parameters": {name: [trial.point[name] for trial in trials] for name in problem.space.names},
        "objectives": {
            objective.name: [_finite(trial.objectives[index]) for trial in trials]
            for index, objective in enumerate(problem.objectives)
        },
        "violations": {name: [trial.violations.get(name) for trial in trials] for name in trials[0].violations},
        "statistics": {
            name: [_finite(trial.statistics.get(name, math.nan)) for trial in trials] for name in problem.units
        },
    }


def _scores(evaluation: Evaluation | None) -> dict[str, Any] | None:
    if evaluation is None:
        return None
    return {
        "statistics": {name: _finite(value) for name, value in evaluation.statistics.items()},
        "violations": evaluation.violations,
        "feasible": evaluation.feasible,
        "outcomes": evaluation.outcomes,
    }


def _attained(score: ControllerScore) -> dict[str, Any]:
    """Name of a bounded stability margin → its worst value and place, null if there is none (SI, Hz)."""
    return {
        name: {
            "value": _finite(attained.worst.value),
            "machine": attained.machine,
            "amplitude": attained.worst.amplitude,
            "x": attained.worst.x,
            "v": attained.worst.v,
            "opening": attained.worst.opening or None,
            "frequency": _finite(attained.worst.frequency / (2 * math.pi)),
            "reason": attained.worst.reason or None,
        }
        for name, attained in score.attained.items()
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _table(result: BatchResult) -> dict[str, Any]:
    """One row of a result: outcome and metrics of every scenario, null where not measured."""
    metrics = {
        name: [value if math.isfinite(value) else None for value in values[0].tolist()]
        for name, values in result.metrics.items()
    }
    return {"outcomes": result.outcomes[0].tolist(), "metrics": metrics}


def _yes(truth: bool) -> str:
    return "yes" if truth else "no"
