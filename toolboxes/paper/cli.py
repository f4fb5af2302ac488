"""``dualwinch reproduce``: the paper's cases, controllers and figures, in one folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from itertools import count, product
from pathlib import Path
from typing import TYPE_CHECKING

from dualwinch.toolbox import ProgressLine, figure_tables, output

if TYPE_CHECKING:
    from dualwinch.toolbox import Result
    from dualwinch.toolboxes.paper.claims import Claim

    Runs = dict[tuple[int, str], Result]
    """(case, controller) → result."""
    Variants = dict[tuple[int, str, str], Result]
    """(case, position law, coordination) → result, without rows."""


def reproduce(
    *,
    out: Path = Path("results"),
    cases: str = "1,2,3,4",
    controllers: str = "fando-nftsm,nftsm,pid-cascade",
    extended: bool = False,
) -> None:
    """Run the paper's cases and controllers, and write every figure, the data and one report.

    Prints the figures of merit and, where Case 4 runs with both sliding-mode controllers, the reductions of
    Figure 21 beside the paper's.

    Args:
        out: Folder for figures, data, metrics and the report.
        cases: Cases to run, separated by commas.
        controllers: Controllers to compare, separated by commas.
        extended: Also compare all position laws and coordinations, beyond the paper's.

    Examples:
        dualwinch reproduce
        dualwinch reproduce --cases 4 --controllers fando-nftsm,nftsm --out case4
        dualwinch reproduce --extended
    """
    from dualwinch.toolbox import folders, paper

    numbers = [int(word) for word in _chosen("case", cases, [str(number) for number in paper.CASES])]
    kinds = _chosen("controller", controllers, list(paper.CONTROLLERS))
    with folders.made_folder(out), folders.made_folder(out / "data"), folders.made_folder(out / "figures"):
        _reproduce(out, numbers, kinds, extended=extended)


def _chosen(what: str, text: str, known: list[str]) -> list[str]:
    """The words of an option, separated by commas, in the order of those that are known."""
    from dualwinch.toolbox import ConfigurationError, quantities

    words = [word.strip() for word in text.split(",")]
    for word in words:
        if word not in known:
            raise ConfigurationError(f"--{what}s = {text}: {quantities.unknown(what, word, known)}")
    return [word for word in known if word in words]


FIGURE_21 = 21


def _reproduce(out: Path, numbers: list[int], kinds: list[str], *, extended: bool) -> None:
    """Run, draw, write and print, once options and folders are checked."""
    from dualwinch.toolbox import engine_here, experiment_file, file_formats, paper, settings
    from dualwinch.toolbox import runs as simulations
    from dualwinch.toolboxes.paper.claims import claims, other_observers

    engine = engine_here("compiled")
    jobs = [(number, kind) for number in numbers for kind in kinds]
    contents = [figure for figure in paper.FIGURES if figure.case in numbers]
    compared = 4 in numbers and {"fando-nftsm", "nftsm"} <= set(kinds)
    combinations = list(product(numbers, variants_beyond_paper())) if extended else []
    steps, steps_finished = 2 * len(jobs) + len(contents) + compared + 1 + len(combinations), count()
    runs: Runs = {}
    variants: Variants = {}
    images: dict[int, bytes] = {}
    with ProgressLine(command="reproduce", patient=True) as progress:

        def step(phase: str) -> None:
            progress(next(steps_finished) / steps, phase)

        for number, kind in jobs:
            step(f"case {number}, {kind}: simulate")
            runs[number, kind] = simulations.simulate(paper.case(number, kind), engine=engine)
        for (number, kind), result in runs.items():
            step(f"case {number}, {kind}: write data")
            file_formats.save(result, out / "data" / f"case{number}-{kind}.parquet", output.version_notes())
        for number, (law, coordination) in combinations:
            step(f"case {number}, {law}, {coordination}")
            experiment = settings.override(paper.case(number, law), {"controller.coordination.kind": coordination})
            variants[number, law, coordination] = simulations.simulate(experiment, stride=0, engine=engine)
        for figure in contents:
            step(f"figure {figure.number}: case {figure.case}, {figure.content}")
            images[figure.number] = _draw(figure.content, _of_case(runs, figure.case), out, figure.number)
        if compared:
            step("figure 21: with and without observer")
            images[FIGURE_21] = _draw("steady_state_bars", _of_case(runs, 4), out, FIGURE_21)
        step("report")
        from dualwinch.toolboxes.paper.report import write_report

        observers = other_observers(runs, engine) if compared else {}
        results = claims(runs, observers)
        _write_metrics(out / "metrics.json", runs, variants, observers, results)
        write_report(
            out / "report.html",
            runs,
            images,
            experiment_file.to_toml(paper.case(numbers[-1])),
            output.versions(),
            results,
        )
    console = output.terminal()
    output.print_figures([*tables(runs, variants), claims_table(results)])
    console.print("Figures, data and report are in", output.styled("bold", str(out), f"; open {out / 'report.html'}"))


def _of_case(runs: Runs, number: int) -> dict[str, Result]:
    return {kind: result for (run_case, kind), result in runs.items() if run_case == number}


def _draw(content: str, results: dict[str, Result], out: Path, number: int) -> bytes:
    """Write one figure as PNG and SVG, and return the SVG for the report."""
    from dualwinch.toolbox import drawing, run_figures

    figure = getattr(run_figures, content)(results)
    path = out / "figures" / f"figure{number:02d}.svg"
    for file in (path.with_suffix(".png"), path):
        drawing.save(figure, file)
    return path.read_bytes()


def _write_metrics(
    path: Path, runs: Runs, variants: Variants, observers: Mapping[float, float], found: list[Claim]
) -> None:
    from dualwinch.toolbox import merits, paper, whole_files
    from dualwinch.toolboxes.paper.claims import reductions

    content = {
        "versions": output.versions(),
        "units": {name: quantity.unit for name, quantity in merits.metric_quantities().items()}
        | dict.fromkeys(("reductions", "change"), "1")
        | {"gain": "1/s"},
        "runs": [
            {"case": number, "controller": kind, "outcome": result.outcome, **result.metrics}
            for (number, kind), result in runs.items()
        ],
        "figure": FIGURE_21,
        "reductions": reductions({key: run.metrics for key, run in runs.items()}) or {},
        "paper_reductions": paper.REDUCTIONS,
        "other_observers": [{"gain": gain, "change": change} for gain, change in observers.items()],
        "claims": list(map(asdict, found)),
    }
    if variants:
        content["extended"] = [
            {"case": number, "controller": law, "coordination": coordination, "outcome": result.outcome}
            | dict(result.metrics)
            for (number, law, coordination), result in variants.items()
        ]
    whole_files.write_whole(path, output.json_text(content))


TRACKING = ("mae", "max_abs_error", "mse", "steady_mae", "steady_max_abs_error", "steady_mse")
ROPE_METRICS = ("saturated_share", "peak_tension", "min_tension", "chatter")
FURTHER_METRICS = ("mae", "steady_mae", "chatter", "slack_share", "peak_tension", "energy")
"""Figures of merit in the tables."""


def runs_table(title: str, runs: Mapping[tuple[int, str], Result], names: tuple[str, ...]) -> figure_tables.FigureTable:
    """Figures of merit of runs, (case, controller in words) → result, with the outcome of those not completed."""
    from dualwinch.toolbox import merits

    quantities = merits.metric_quantities()
    columns = [figure_tables.FigureColumn("case"), figure_tables.FigureColumn("controller", "")]
    columns += [quantities[name].column(name) for name in names]
    rows = []
    for (number, controller), result in runs.items():
        ended = "" if result.outcome == "completed" else f" ({result.outcome})"
        rows.append([number, controller + ended, *(result.metrics[name] for name in names)])
    return figure_tables.FigureTable(title, columns, rows, title)


def tables(runs: Runs, variants: Variants) -> list[figure_tables.FigureTable]:
    """Figures of merit, Figure 21's reductions if their runs are there, and the variants.

    A variant is named by the part that differs from the paper's: position law or coordination.
    """
    from dualwinch.toolbox import merits, paper
    from dualwinch.toolboxes.paper.claims import reductions

    named = {(number, paper.CONTROLLERS[kind]): result for (number, kind), result in runs.items()}
    tables = [runs_table("Tracking error", named, TRACKING), runs_table("Ropes and limits", named, ROPE_METRICS)]
    if change := reductions({key: run.metrics for key, run in runs.items()}):
        title = "Figure 21: effect of the observer\n(Case 4, steady state)"
        quantities = merits.metric_quantities()
        columns = [
            figure_tables.FigureColumn(key, heading=quantities[key].label, factor=100, form="+.3g", shown_unit="%")
            for key in change
        ]
        rows = [("here", *change.values()), ("paper", *(paper.REDUCTIONS[key] for key in change))]
        tables.append(
            figure_tables.FigureTable("reductions", (figure_tables.FigureColumn("", ""), *columns), rows, title)
        )
    for case in dict.fromkeys(number for number, *_ in variants):
        results = {
            (number, law if coordination == PAPERS_COORDINATION else coordination): result
            for (number, law, coordination), result in variants.items()
            if number == case
        }
        title = f"Beyond the paper, Case {case}: position laws, and coordinations with {PAPERS_LAW}"
        table = runs_table(title, results, FURTHER_METRICS)
        tables.append(replace(table, columns=table.columns[1:], rows=[row[1:] for row in table.rows]))
    return tables


def claims_table(claims: list[Claim]) -> figure_tables.FigureTable:
    """The paper's claims with the verdicts of these runs."""
    colours = {"holds": "green", "partly": "yellow", "does not hold": "red"}
    columns = (
        figure_tables.FigureColumn("words", "", "the paper says"),
        figure_tables.FigureColumn("here", "", "these runs say"),
        figure_tables.FigureColumn("verdict", "", "", styles=colours),
    )
    rows = [(claim.words, claim.here, claim.verdict) for claim in claims]
    return figure_tables.FigureTable(
        "claims", columns, rows, "The paper, claim by claim" if rows else "", layout="rows" if rows else "file"
    )


PAPERS_LAW, PAPERS_COORDINATION = "fando-nftsm", "differential-tension"


def variants_beyond_paper() -> list[tuple[str, str]]:
    """Position law and coordination of each variant."""
    from dualwinch.toolbox import registries

    alternatives = (coordination for coordination in registries.COORDINATIONS if coordination != PAPERS_COORDINATION)
    return [
        *((law, PAPERS_COORDINATION) for law in registries.POSITION_LAWS),
        *((PAPERS_LAW, other) for other in alternatives),
    ]
