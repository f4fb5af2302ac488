"""The report of ``dualwinch tune``: one HTML file with scores, figures, gains and where they come from."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from dualwinch.codegen.files import atomic
from dualwinch.model.quantities.tree import leaves
from dualwinch.reports.page import template
from dualwinch.reports.reproduction import data_uri, number_text
from dualwinch.reports.tuning_words import ASSUMED, costs, gained, next_steps
from dualwinch.simulation.plots.page import encode
from dualwinch.tuning.plots import (
    before_and_after,
    front,
    held_out,
    history,
    importance,
    parallel_coordinates,
    shown_name,
    shown_unit,
)
from dualwinch.tuning.result import (
    TuningResult,
    authority,
    contenders,
    headings,
    headline,
    margin_places,
    where,
    worth,
)

CAPTIONS = {
    "history": "Each dot is a candidate in all tuning scenarios. Pale ones violate a constraint or were abandoned "
    "after the first scenarios. A candidate that satisfies every constraint ranks above any that does not.",
    "importance": "How much a gain's values among the best tenth of all complete trials, constraints aside, differ "
    "from those elsewhere (PED-ANOVA). An unimportant gain may stay at its default.",
    "parallel": "One line per candidate, one column per gain, from its lower to its upper bound. Where lines converge, "
    "the gain is settled; where they fan out, it matters little; where they end at a bound, widen it.",
    "front": "The price of one figure of merit in terms of the other. Where a bound on the chatter touches the lower "
    "edge, it is what keeps the error from being smaller.",
    "before": "The same plant, sea and noise for both. Note the two scales of the error.",
    "held_out": "The same scenarios for both, seen neither by the search nor by the choice of the best.",
}


def write_tuning_report(path: str | Path, tuned: TuningResult, facts: Mapping[str, Any], configuration: str) -> None:
    """Write the report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        tuned: the study.
        facts: provenance, name → value.
        configuration: the best as TOML.

    Raises:
        OSError: the file cannot be written.
    """
    folder = Path(path).parent
    kept = "; ".join(constraint.label for constraint in tuned.training.constraints) or "nothing"
    page = template("tuning.html.j2").render(
        summary=_summary(tuned),
        gained=gained(tuned),
        assumed=ASSUMED,
        costs=costs(tuned),
        steps=next_steps(tuned, folder),
        best=folder / "best.toml",
        folder=folder,
        constraints=f"Constraints of the search: {kept}.",
        contenders=" ".join(map(_sentence, contenders(tuned))),
        authority=_sentence(authority(tuned)),
        where=where(tuned),
        headings=list(headings(tuned).values()),
        scores=_scores(tuned),
        bounds=_bounds(tuned),
        margins=margin_places(tuned),
        pictures=_pictures(tuned),
        gains=_gains(tuned),
        facts={**facts, **_cost(tuned)},
        configuration=configuration.strip(),
    )
    with atomic(Path(path)) as unfinished:
        unfinished.write_text(page, encoding="utf-8", errors="xmlcharrefreplace")


def _sentence(words: str) -> str:
    """Words as a sentence; one that begins with the name of a statistic keeps it as it is."""
    first = words.partition(" ")[0]
    begin = first if "." in first else first[:1].upper() + first[1:]
    return f"{begin}{words[len(first) :]}." if words else ""


def _summary(tuned: TuningResult) -> str:
    feasible = sum(trial.feasible for trial in tuned.trials)
    kept = "satisfies" if tuned.verdict.scored.feasible else "does not satisfy"
    return (
        f"{_sentence(worth(tuned))} {_sentence(headline(tuned))} It {kept} every constraint there. "
        f"Of {len(tuned.trials)} trials, {feasible} satisfied them in all tuning scenarios."
    )


def _scores(tuned: TuningResult) -> list[dict[str, Any]]:
    verdict, columns = tuned.verdict, list(headings(tuned))
    rows = []
    for name, value in verdict.scored.statistics.items():
        theirs = verdict.statistics("paper")[name]
        rows.append(
            {
                "name": shown_name(name),
                "values": [number_text(verdict.statistics(column)[name]) for column in columns],
                "ratio": number_text(value / theirs) if theirs else "–",
                "unit": shown_unit(tuned.problem.units[name]),
            }
        )
    return rows


def _bounds(tuned: TuningResult) -> list[dict[str, Any]]:
    scored = tuned.verdict.scored
    return [
        {
            "label": constraint.label,
            "value": number_text(scored.statistics[constraint.statistic.name]),
            "kept": scored.violations[constraint.label] <= 0,
        }
        for constraint in tuned.verdict.constraints
    ]


def _gains(tuned: TuningResult) -> list[dict[str, Any]]:
    start, best = leaves(tuned.problem.experiment), tuned.gains
    return [
        {"key": key, "best": number_text(best[key]), "start": number_text(start[key]), "searched": dimension.allowed}
        for dimension in tuned.problem.space.dimensions
        for key in dimension.keys
    ]


def _cost(tuned: TuningResult) -> dict[str, str]:
    cost = tuned.cost
    times = {"preparing": cost.preparing, "searching": cost.searching, "choosing and scoring": cost.judging}
    return {
        "trials": str(len(tuned.trials)),
        "rollouts": str(cost.rollouts),
        "time": ", ".join(f"{seconds:.1f} s {words}" for words, seconds in times.items()),
    }


SECTIONS = {"gained": ("held_out", "before"), "cost": ("front",), "search": ("history", "importance", "parallel")}
"""Section of the report → its figures."""


def _pictures(tuned: TuningResult) -> dict[str, list[dict[str, str]]]:
    problem, trials, verdict = tuned.problem, tuned.trials, tuned.verdict
    figures: dict[str, tuple[str, Figure | None]] = {
        "held_out": ("Held-out scenarios", held_out(verdict)),
        "before": ("The paper's gains and the best", before_and_after(problem, verdict)),
        "history": ("History", history(problem, trials)),
        "front": ("Trade-off", front(problem, tuned.training.constraints, trials)),
        "importance": ("Which gains matter", importance(problem, trials)),
        "parallel": ("Gains of the best candidates", parallel_coordinates(problem, trials)),
    }
    shown = {
        name: {"title": title, "caption": CAPTIONS[name], "source": data_uri(encode(figure, ".png"))}
        for name, (title, figure) in figures.items()
        if figure is not None
    }
    return {section: [shown[name] for name in names if name in shown] for section, names in SECTIONS.items()}
