"""What a study leaves: ``best.toml`` to simulate with, and ``study.json`` with every trial and score."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dualwinch.codegen.files import atomic
from dualwinch.model.description import describe
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.loop.metrics import Metrics
from dualwinch.tuning.problem import HELD_OUT, SELECTION, Problem
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.ranking import pareto_front
from dualwinch.tuning.scoring.selection import LAST_SCENARIOS, SELECTION_SCENARIOS, Verdict
from dualwinch.tuning.scoring.statistic import statistic_from
from dualwinch.tuning.space_record import space_to_record


def write_best(path: Path, problem: Problem, verdict: Verdict, toml: str, facts: Mapping[str, Any]) -> None:
    """Write the best as a configuration file, with where it comes from as comments.

    Args:
        path: the file.
        problem: what was tuned.
        verdict: the best and its score.
        toml: the experiment with the best's gains.
        facts: name → value of what else belongs to its provenance, such as code version and date.
    """
    best, scored = verdict.best, verdict.held_out or verdict.best
    where = "held-out scenarios" if verdict.held_out else "the tuned experiment"
    lines = ["The best gains of a study by `dualwinch tune`."]
    lines += [f"{name}: {value}" for name, value in facts.items()]
    lines += [f"trial: {best.number}", f"objective: {', '.join(problem.objectives)}"]
    lines += [f"feasible: {'yes' if best.feasible else 'no'} where tuned, {_feasible(scored)} in {where}"]
    lines += [f"in {where}, paper's gains in brackets:"]
    for name, value in scored.statistics.items():
        unit = statistic_from(name).unit
        lines.append(f"    {name} = {value:.6g} {unit if unit != '1' else ''} ({verdict.paper[name]:.6g})")
    lines += ["constraints there:"]
    lines += [
        f"    {one.label}: {scored.statistics[one.statistic.name]:.6g}, "
        f"{'kept' if scored.violations[one.label] <= 0 else 'violated'}"
        for one in problem.bounded
    ]
    lines += ["tuned keys:", *(f"    {key} = {value}" for key, value in problem.space.settings(best.point).items())]
    with atomic(path) as unfinished:
        unfinished.write_text("".join(f"# {line}".rstrip() + "\n" for line in lines) + "\n" + toml, encoding="utf-8")


def write_study(
    path: Path,
    problem: Problem,
    trials: Sequence[Evaluation],
    verdict: Verdict,
    facts: Mapping[str, Any],
    configuration: str,
    cost: Mapping[str, float],
) -> None:
    """Write everything a report needs: the problem, every trial as columns, the best and the held-out scores.

    Args:
        path: the file, JSON.
        problem: what was tuned.
        trials: finished trials, in their order.
        verdict: the best and its score.
        facts: provenance.
        configuration: TOML of ensemble or experiment.
        cost: rollouts, seconds and the like.
    """
    content = {
        **facts,
        "seeds": {
            "tuning": problem.seed,
            "selection": problem.seed + SELECTION,
            "held_out": problem.seed + HELD_OUT,
        },
        "scenarios": {
            "tuning": problem.scenarios if problem.ensemble else 1,
            "selection": SELECTION_SCENARIOS + LAST_SCENARIOS if problem.ensemble else 0,
            "held_out": len(verdict.held_out_metrics["best"].outcomes[0]) if verdict.held_out else 0,
        },
        "objectives": [{"name": one.name, "unit": one.unit} for one in problem.minimised],
        "constraints": [
            {
                "text": one.text,
                "label": one.label,
                "statistic": one.statistic.name,
                "at_least": one.at_least,
                "bound": one.bound,
                "unit": one.statistic.unit,
            }
            for one in problem.bounded
        ],
        "space": space_to_record(problem.space),
        "units": {one.name: one.unit for one in problem.reported},
        "trials": trial_columns(problem, trials),
        "pareto_front": [trials[place].number for place in pareto_front(trials)],
        "best": {
            "trial": verdict.best.number,
            "settings": problem.space.settings(verdict.best.point),
            "tuning": _scores(verdict.best),
            "selection": _scores(verdict.selection),
            "held_out": _scores(verdict.held_out),
        },
        "paper": {"statistics": verdict.paper},
        "held_out": {name: _table(result) for name, result in verdict.held_out_metrics.items()},
        "within_reach": verdict.within_reach.tolist(),
        "metric_units": {name: leaf.quantity.unit for name, leaf in describe(Metrics).items()},
        "cost": dict(cost),
        "configuration": configuration,
    }
    with atomic(path) as unfinished:
        unfinished.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def trial_columns(problem: Problem, trials: Sequence[Evaluation]) -> dict[str, Any]:
    """The trials as columns, JSON-ready: each a list with an entry a trial, some of them in named groups."""
    return {
        "number": [one.number for one in trials],
        "origin": [one.candidate.origin for one in trials],
        "state": ["pruned" if one.pruned else "complete" for one in trials],
        "feasible": [one.feasible for one in trials],
        "scenarios": [one.scenarios for one in trials],
        "outcomes": [one.outcomes for one in trials],
        "parameters": {name: [one.point[name] for one in trials] for name in problem.space.names},
        "objectives": {
            name.name: [one.objectives[place] for one in trials] for place, name in enumerate(problem.minimised)
        },
        "violations": {
            name: [one.violations.get(name) for one in trials] for name in (trials[0].violations if trials else ())
        },
        "statistics": {one.name: [trial.statistics.get(one.name) for trial in trials] for one in problem.reported},
    }


def _scores(one: Evaluation | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "statistics": one.statistics,
        "violations": one.violations,
        "feasible": one.feasible,
        "outcomes": one.outcomes,
    }


def _table(result: BatchResult) -> dict[str, Any]:
    """One row of a result: outcome and figures of merit of every scenario, null where not measured."""
    metrics = {
        name: [value if math.isfinite(value) else None for value in values[0].tolist()]
        for name, values in result.metrics.items()
    }
    return {"outcomes": result.outcomes[0].tolist(), "metrics": metrics}


def _feasible(one: Evaluation) -> str:
    return "yes" if one.feasible else "no"
