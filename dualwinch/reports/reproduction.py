"""The report of ``dualwinch reproduce``: one HTML file with tables, figures, configuration, versions and errata."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup, escape

from dualwinch.codegen.files import atomic
from dualwinch.reports.captions import told
from dualwinch.reports.claims import Claim, claims
from dualwinch.reports.errata import INTRODUCTION, NOTES, places
from dualwinch.reports.page import template
from dualwinch.simulation.paper import CASES, CONTROLLERS, FIGURES, REDUCTIONS, percent, reductions
from dualwinch.simulation.results.result import Result

PAPER = "https://doi.org/10.3390/jmse13061120"


@dataclass(frozen=True)
class Column:
    """A column of the table of metrics.

    Attributes:
        group: heading above several columns.
        heading: what it shows.
        unit: unit of what it shows.
        metric: field of `simulation.metrics.metrics.Metrics`.
        scale: factor from that field to the unit shown.
        high_is_good: whether the largest value is the best; else the smallest.
    """

    group: str
    heading: str
    unit: str
    metric: str
    scale: float = 1.0
    high_is_good: bool = False


TABLE = (
    Column("whole run", "mean |e|", "mm", "mae", 1e3),
    Column("whole run", "max |e|", "mm", "max_abs_error", 1e3),
    Column("whole run", "mean e²", "mm²", "mse", 1e6),
    Column("steady state", "mean |e|", "mm", "steady_mae", 1e3),
    Column("steady state", "max |e|", "mm", "steady_max_abs_error", 1e3),
    Column("steady state", "mean e²", "mm²", "steady_mse", 1e6),
    Column("actuators and ropes", "saturated", "%", "saturated_share", 1e2),
    Column("actuators and ropes", "peak tension", "kN", "peak_tension", 1e-3),
    Column("actuators and ropes", "min. tension", "N", "min_tension", high_is_good=True),
    Column("actuators and ropes", "chatter", "N a sample", "chatter"),
)

METRIC_NAMES = {"mae": "mean |e|", "max_abs_error": "largest |e|", "mse": "mean e²"}

TITLES = {
    "trajectory": "tracking trajectory",
    "error": "tracking error",
    "commands": "force commands of the coordination",
    "tensions": "rope tensions",
}

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
"""What the enlarged panels of commands and tensions show, by reference."""

RINGING = "The ropes ring for some 20 ms: between samples of 1 ms the tensions are integrated in steps of 0.05 ms."
"""What the enlarged panels of tensions show besides."""

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
        found: the paper's claims; default: those that the runs alone tell something of.

    Raises:
        OSError: the file cannot be written.
    """
    page = render_report(runs, figures, configuration, versions, found)
    with atomic(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8", errors="xmlcharrefreplace")


def render_report(
    runs: Mapping[tuple[int, str], Result],
    figures: Mapping[int, bytes],
    configuration: str,
    versions: Mapping[str, str],
    found: Sequence[Claim] | None = None,
) -> str:
    """The report as HTML text; arguments as for `write_report`."""
    cases = sorted({number for number, _kind in runs})
    change = reductions(runs)
    cards = [
        {"name": METRIC_NAMES[metric], "here": percent(change[metric]), "paper": percent(paper, "+g")}
        for metric, paper in (REDUCTIONS if change else {}).items()
        if change
    ]
    return template("report.html.j2").render(
        paper=PAPER,
        summary=summary(runs),
        cards=cards,
        claims=claims(runs) if found is None else found,
        columns=TABLE,
        groups=_groups(),
        cases=[
            {
                "number": number,
                "name": CASES[number],
                "rows": _rows({kind: runs[number, kind] for kind in CONTROLLERS if (number, kind) in runs}),
                "pictures": _pictures(number, runs, figures),
            }
            for number in cases
        ],
        comparison=_comparison(figures),
        configuration=configuration.strip(),
        versions=versions,
        introduction=INTRODUCTION,
        notes=[{"note": note, "places": places(note)} for note in NOTES],
    )


def summary(runs: Mapping[tuple[int, str], Result]) -> str:
    """Two sentences: what was run, and what came out beside the paper."""
    numbers = sorted({number for number, _kind in runs})
    kinds = [CONTROLLERS[kind] for kind in CONTROLLERS if any(run == kind for _number, run in runs)]
    cases = f"Case{'s' * (len(numbers) > 1)} {_listing([str(number) for number in numbers])}"
    plural = "s" * (len(runs) != 1)
    first = f"{len(runs)} simulated run{plural} of the paper's {cases}, under {_listing(kinds)}."
    change = reductions(runs)
    if change is None:
        return first + " The reductions of Figure 21 need Case 4 with FANDO-NFTSM and NFTSM."
    here = _listing([f"{METRIC_NAMES[metric]} by {percent(change[metric])}" for metric in REDUCTIONS])
    paper = _listing([percent(value, "+g") for value in REDUCTIONS.values()])
    second = f"In the steady state of Case 4 the disturbance observer changes {here}; the paper reports {paper}."
    return f"{first} {second}".replace(" %", "\N{NO-BREAK SPACE}%")


def number_text(value: float) -> Markup:
    """A number for the table: three digits, a power of ten where it is very small or very large."""
    if not np.isfinite(value):
        return Markup("–")
    if value == 0:
        return Markup("0")
    mantissa, exponent = f"{value:.2e}".split("e")
    if 1e-2 <= abs(value) < 1e5:
        rounded = float(f"{mantissa}e{exponent}")
        return escape(f"{rounded:.{max(0, 2 - int(exponent))}f}".replace("-", "−"))
    power = str(int(exponent)).replace("-", "−")
    return Markup("{}·10<sup>{}</sup>").format(mantissa.replace("-", "−"), power)


def _listing(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _groups() -> list[tuple[str, int]]:
    names = list(dict.fromkeys(column.group for column in TABLE))
    return [(name, sum(column.group == name for column in TABLE)) for name in names]


def _rows(results: Mapping[str, Result]) -> list[dict[str, object]]:
    best = {column: _best(results, column) for column in TABLE}
    return [
        {
            "kind": kind,
            "name": CONTROLLERS[kind],
            "outcome": ""
            if result.outcome == "completed"
            else f"{result.outcome.replace('_', ' ')} at {result.end_time:.3g} s",
            "cells": [
                {"text": text, "best": text == best[column]}
                for column in TABLE
                for text in [number_text(column.scale * getattr(result.metrics, column.metric))]
            ],
        }
        for kind, result in results.items()
    ]


def _best(results: Mapping[str, Result], column: Column) -> str | None:
    """Text of the best value of a column; ``None`` where there is nothing to compare or all look the same."""
    values = [
        column.scale * getattr(result.metrics, column.metric)
        for result in results.values()
        if result.outcome == "completed"
    ]
    finite = [value for value in values if np.isfinite(value)]
    if len({number_text(value) for value in finite}) < 2:
        return None
    return number_text(max(finite) if column.high_is_good else min(finite))


def _pictures(number: int, runs: Mapping[tuple[int, str], Result], figures: Mapping[int, bytes]) -> list[Picture]:
    reference = next(run for (case, _kind), run in runs.items() if case == number).experiment.reference.kind
    pictures: list[Picture] = []
    for figure in FIGURES:
        if figure.case != number or figure.number not in figures:
            continue
        caption = CAPTIONS[figure.content]
        if figure.content in {"commands", "tensions"}:
            caption += " " + EVENTS[reference]
        if figure.content == "tensions":
            caption += " " + RINGING
        drawn = {kind: runs[number, kind] for kind in CONTROLLERS if (number, kind) in runs}
        caption = " ".join([caption, *told(figure.content, drawn)])
        title = f"Case {number}: {TITLES[figure.content]}"
        pictures.append(Picture(figure.number, title, caption, data_uri(figures[figure.number])))
    return pictures


def _comparison(figures: Mapping[int, bytes]) -> Picture | None:
    if 21 not in figures:
        return None
    return Picture(21, "Case 4: effect of the observer in the steady state", FIGURE_21, data_uri(figures[21]))


def data_uri(content: bytes) -> str:
    """A PNG or SVG as an address that carries its content."""
    kind = "image/png" if content.startswith(b"\x89PNG") else "image/svg+xml"
    return f"data:{kind};base64,{b64encode(content).decode()}"
