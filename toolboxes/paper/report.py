"""The report of ``dualwinch reproduce``: one HTML file with tables, figures, configuration, versions and errata."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from dualwinch.toolbox import Result, drawing, idealisations, merits, paper, report_page, run_figures, texts
from dualwinch.toolboxes.paper.claims import Claim, claims, reductions
from dualwinch.toolboxes.paper.errata import INTRODUCTION, NOTES, places

PAPER_DOI = "https://doi.org/10.3390/jmse13061120"


TABLE_COLUMNS = (
    *("mae", "max_abs_error", "mse", "steady_mae", "steady_max_abs_error", "steady_mse"),
    *("saturated_share", "peak_tension", "min_tension", "chatter"),
)
"""Figures of merit in the table."""

CAPTIONS = {
    "trajectory": "Position and speed of the vehicle; the reference is the dotted black line. The inset enlarges the "
    "end of the steady state, where the remaining lags are visible.",
    "error": "Top: the error over the whole run. Bottom left: its size on a logarithmic axis. Bottom right: the "
    "steady state alone.",
    "commands": "The tension that the coordination demands of each rope, between its limits (black, dotted). When one "
    "rope reaches its limit the other takes over, so that their difference remains the force required.",
    "tensions": "The tension each rope carries. The limits (black, dotted) apply to the commands, not to the tensions.",
}

EVENTS = {
    "uniform": "Right: the start, enlarged. The reference demands a step in speed, which no winch can follow.",
    "profile": "Right: the start of braking, enlarged. The reference acceleration jumps there.",
}
"""Reference → content of the enlarged panels of commands and tensions."""

RINGING = "The ropes ring for some 20 ms: between samples of 1 ms the tensions are integrated in steps of 0.05 ms."
"""Further content of the enlarged panels of tensions."""

FIGURE_21 = (
    "Steady-state errors of Case 4 without and with the disturbance observer (top), and the reduction it brings beside "
    "the one the paper reports (bottom)."
)


@dataclass(frozen=True)
class Picture:
    """A figure of the report."""

    number: int
    title: str
    caption: str
    source: str


def write_report(
    path: Path,
    runs: Mapping[tuple[int, str], Result],
    figures: Mapping[int, bytes],
    configuration: str,
    versions: Mapping[str, str],
    found: Sequence[Claim] | None = None,
) -> None:
    """Write the report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        runs: (case, controller) → result; any subset of the paper's cases and controllers.
        figures: number of the paper's figure → its content, PNG or SVG; any subset of 5 to 21.
        configuration: the configuration as TOML text.
        versions: name → version of everything the results depend on.
        found: the paper's claims; default: those that the runs alone can confirm or refute.

    Raises:
        OSError: the file cannot be written.
    """
    change, quantities = reductions({key: run.metrics for key, run in runs.items()}), merits.metric_quantities()
    cards = [
        {
            "name": quantities[metric].label,
            "here": paper.percent(change[metric]),
            "paper": paper.percent(reported, "+g"),
        }
        for metric, reported in (paper.REDUCTIONS if change else {}).items()
        if change
    ]
    report_page.write_page(
        path,
        "paper.html.j2",
        Path(__file__).parent / "templates",
        paper=PAPER_DOI,
        summary=summary(runs),
        cards=cards,
        claims=claims(runs) if found is None else found,
        columns=[quantities[name] for name in TABLE_COLUMNS],
        cases=[
            {
                "number": number,
                "name": paper.CASES[number],
                "rows": _rows({kind: runs[number, kind] for kind in paper.CONTROLLERS if (number, kind) in runs}),
                "pictures": _pictures(number, runs, figures),
            }
            for number in sorted({number for number, _kind in runs})
        ],
        comparison=_comparison(figures),
        idealised=dict.fromkeys(
            one.statement for run in runs.values() for one in idealisations.idealisations(run.experiment)
        ),
        configuration=configuration.strip(),
        versions=versions,
        introduction=INTRODUCTION,
        notes=[{"note": note, "places": places(note)} for note in NOTES],
    )


def summary(runs: Mapping[tuple[int, str], Result]) -> str:
    """Two sentences: the runs, and their result beside the paper's."""
    numbers = sorted({number for number, _kind in runs})
    kinds = [paper.CONTROLLERS[kind] for kind in paper.CONTROLLERS if any(run == kind for _number, run in runs)]
    cases = f"Case{'s' * (len(numbers) > 1)} {texts.enumeration([str(number) for number in numbers])}"
    plural = "s" * (len(runs) != 1)
    opening = f"{len(runs)} simulated run{plural} of the paper's {cases}, under {texts.enumeration(kinds)}."
    change = reductions({key: run.metrics for key, run in runs.items()})
    if change is None:
        return opening + " The reductions of Figure 21 need Case 4 with FANDO-NFTSM and NFTSM."
    quantities = merits.metric_quantities()
    here = texts.enumeration(
        [f"{quantities[metric].label} by {paper.percent(change[metric])}" for metric in paper.REDUCTIONS]
    )
    reported = texts.enumeration([paper.percent(value, "+g") for value in paper.REDUCTIONS.values()])
    second = f"In the steady state of Case 4 the disturbance observer changes {here}; the paper reports {reported}."
    return f"{opening} {second}".replace(" %", "\N{NO-BREAK SPACE}%")


def _rows(results: Mapping[str, Result]) -> list[dict[str, object]]:
    quantities = merits.metric_quantities()
    best = {name: _best(results, name, quantities[name]) for name in TABLE_COLUMNS}
    return [
        {
            "kind": kind,
            "name": paper.CONTROLLERS[kind],
            "outcome": ""
            if result.outcome == "completed"
            else f"{result.outcome.replace('_', ' ')} at {result.end_time:.3g} s",
            "cells": [
                {"text": text, "best": text == best[name]}
                for name in TABLE_COLUMNS
                for text in [report_page.number_text(quantities[name].scale * result.metrics[name])]
            ],
        }
        for kind, result in results.items()
    ]


def _best(results: Mapping[str, Result], name: str, merit: merits.MetricQuantity) -> str | None:
    """Text of the best value of a column; ``None`` if there is only one or all look the same."""
    values = [merit.scale * each.metrics[name] for each in results.values() if each.outcome == "completed"]
    finite = [value for value in values if np.isfinite(value)]
    if len({report_page.number_text(value) for value in finite}) < 2:
        return None
    return report_page.number_text(max(finite) if merit.small_is_bad else min(finite))


def _pictures(number: int, runs: Mapping[tuple[int, str], Result], figures: Mapping[int, bytes]) -> list[Picture]:
    reference = next(run for (case, _kind), run in runs.items() if case == number).experiment.reference.kind
    pictures: list[Picture] = []
    for figure in paper.FIGURES:
        if figure.case != number or figure.number not in figures:
            continue
        caption = CAPTIONS[figure.content]
        if figure.content in {"commands", "tensions"}:
            caption += " " + EVENTS[reference]
        if figure.content == "tensions":
            caption += " " + RINGING
        runs_of_case = {kind: runs[number, kind] for kind in paper.CONTROLLERS if (number, kind) in runs}
        caption = " ".join([caption, *remarks(figure.content, runs_of_case)])
        title = f"Case {number}: {paper.CONTENTS[figure.content]}"
        pictures.append(Picture(figure.number, title, caption, report_page.data_uri(figures[figure.number])))
    return pictures


def _comparison(figures: Mapping[int, bytes]) -> Picture | None:
    if 21 not in figures:
        return None
    return Picture(
        21, "Case 4: effect of the observer in the steady state", FIGURE_21, report_page.data_uri(figures[21])
    )


DRAWN = {"trajectory": ("x",), "error": ("e",), "commands": ("F1_cmd", "F2_cmd"), "tensions": ("F1", "F2")}
"""Content of a figure → its columns."""

COINCIDE = 0.005
"""Largest distance of lines that look like a single one, as a share of their panel's height."""


def remarks(content: str, runs: Mapping[str, Result]) -> list[str]:
    """Sentences for the caption of a figure.

    Args:
        content: one of `simulation.paper.CONTENTS`.
        runs: controller → result, all of one case.
    """
    sentences = []
    if together := _together(content, runs):
        sentences.append(f"At the scale of the whole run the lines of {texts.enumeration(together)} coincide.")
    if content == "error":
        sentences += [f"There, {name} is off the panel; its range is given in words." for name in _off_the_panel(runs)]
    return sentences


def _together(content: str, runs: Mapping[str, Result]) -> list[str]:
    """Names of the controllers whose lines coincide."""
    columns = DRAWN[content]
    rows = min((len(run["t"]) for run in runs.values()), default=0)
    spans = {name: max((np.ptp(run[name][:rows]) for run in runs.values() if rows), default=0.0) for name in columns}
    labels: list[str] = []
    for one, other in combinations(runs, 2):
        distances = [np.abs(runs[one][name][:rows] - runs[other][name][:rows]).max(initial=0.0) for name in columns]
        if all(distance <= COINCIDE * spans[name] for name, distance in zip(columns, distances, strict=True)):
            labels += [one, other]
    return [paper.CONTROLLERS[kind] for kind in dict.fromkeys(labels)]


def _off_the_panel(runs: Mapping[str, Result]) -> list[str]:
    """Names of the controllers whose steady-state error is too large for the panel of the others."""
    sizes = {}
    for kind, run in runs.items():
        sizes[kind] = drawing.largest(run["e"][drawing.within(run["t"], *run.experiment.steady_window)])
    smallest = min((size for size in sizes.values() if size > 0), default=0.0)
    return [paper.CONTROLLERS[kind] for kind, size in sizes.items() if size > run_figures.COMPARABLE * smallest]
