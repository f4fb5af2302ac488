"""The report of ``dualwinch tune``: one HTML file with scores, figures, gains and where they come from."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from dualwinch.codegen.files import atomic
from dualwinch.model.tree import leaves
from dualwinch.reports.reproduction import data_uri, number_text
from dualwinch.simulation.plots.files import encode
from dualwinch.tuning.plots.score import before_and_after, held_out
from dualwinch.tuning.plots.search import front, history, importance, parallel_coordinates
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.selection import Verdict, improvement
from dualwinch.tuning.scoring.statistic import statistic_from

CAPTIONS = {
    "history": "Every dot is a candidate in all tuning scenarios. Pale ones break a constraint, or were given up after "
    "the first scenarios. A candidate that keeps to every constraint is better than any that does not.",
    "importance": "Of all complete trials the best tenth is taken, whatever the constraints; a gain matters as much as "
    "its values there differ from those elsewhere (PED-ANOVA). An unimportant gain may be left at its default.",
    "parallel": "One line a candidate, one column a gain, from its lower to its upper bound. Where all lines meet, the "
    "gain is settled; where they fan out, it matters little. Lines that end at a bound ask for a wider one.",
    "front": "What one figure of merit costs in the other. A bound on the chatter that lies on the lower edge is what "
    "keeps the error from being smaller.",
    "before": "The same plant, sea and noise for both. Mind the two scales of the error.",
    "held_out": "The same scenarios for both. Neither the search nor the choice of the best has seen them.",
}


def write_tuning_report(
    path: Path,
    problem: Problem,
    trials: Sequence[Evaluation],
    verdict: Verdict,
    facts: Mapping[str, Any],
    configuration: str,
) -> None:
    """Write the report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        problem: what was tuned.
        trials: finished trials.
        verdict: the best and its score.
        facts: provenance, name → value.
        configuration: the best as TOML.

    Raises:
        OSError: the file cannot be written.
    """
    environment = Environment(
        loader=PackageLoader("dualwinch.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("tuning.html.j2").render(
        summary=_summary(problem, trials, verdict),
        constraints=f"Kept to in the search: {'; '.join(one.label for one in problem.bounded) or 'nothing'}.",
        where=_where(verdict),
        scores=_scores(verdict),
        bounds=_bounds(problem, verdict),
        pictures=_pictures(problem, trials, verdict),
        gains=_gains(problem, verdict),
        facts=facts,
        configuration=configuration.strip(),
    )
    with atomic(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8")


def _where(verdict: Verdict) -> str:
    return f"in {verdict.held_out.scenarios} held-out scenarios" if verdict.held_out else "in the tuned experiment"


def _summary(problem: Problem, trials: Sequence[Evaluation], verdict: Verdict) -> str:
    name = problem.minimised[0].name
    feasible = sum(one.feasible for one in trials)
    scored = verdict.held_out or verdict.best
    kept = "keeps to every constraint" if scored.feasible else "does not keep to every constraint"
    return (
        f"{len(trials)} trials, {feasible} of them within the constraints. Trial {verdict.best.number} is the best: "
        f"its {name} is {improvement(verdict, name):.4g} times below that of the paper's gains {_where(verdict)}, "
        f"and it {kept} there."
    )


def _scores(verdict: Verdict) -> list[dict[str, Any]]:
    scored = verdict.held_out or verdict.best
    rows = []
    for name, value in scored.statistics.items():
        theirs, unit = verdict.paper[name], statistic_from(name).unit.replace("^2", "²")
        ratio = number_text(value / theirs) if theirs else "–"
        rows.append(
            {
                "name": name.replace("_", " "),
                "best": number_text(value),
                "paper": number_text(theirs),
                "ratio": ratio,
                "unit": "" if unit == "1" else unit,
            }
        )
    return rows


def _bounds(problem: Problem, verdict: Verdict) -> list[dict[str, Any]]:
    scored = verdict.held_out or verdict.best
    return [
        {
            "label": one.label,
            "value": number_text(scored.statistics[one.statistic.name]),
            "kept": scored.violations[one.label] <= 0,
        }
        for one in problem.bounded
    ]


def _gains(problem: Problem, verdict: Verdict) -> list[dict[str, Any]]:
    theirs, ours = leaves(problem.paper_experiment), problem.space.settings(verdict.best.point)
    return [
        {
            "key": key,
            "best": number_text(ours[key]),
            "paper": number_text(theirs[key]) if key in theirs else "–",
            "searched": dimension.allowed,
        }
        for dimension in problem.space.dimensions
        for key in dimension.keys
    ]


def _pictures(problem: Problem, trials: Sequence[Evaluation], verdict: Verdict) -> list[dict[str, str]]:
    figures: dict[str, tuple[str, Figure | None]] = {
        "held_out": ("Scenarios that nobody tuned on", held_out(verdict)),
        "before": ("Before and after", before_and_after(problem, verdict)),
        "history": ("History of the search", history(problem, trials)),
        "front": ("What is traded", front(problem, trials)),
        "importance": ("Which gains matter", importance(problem, trials)),
        "parallel": ("Where the best lie", parallel_coordinates(problem, trials)),
    }
    return [
        {"title": title, "caption": CAPTIONS[name], "source": data_uri(encode(figure, ".png"))}
        for name, (title, figure) in figures.items()
        if figure is not None
    ]
