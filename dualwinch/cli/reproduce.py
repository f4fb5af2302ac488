"""``dualwinch reproduce``: the paper's cases, controllers and figures, in one folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter
from rich import box
from rich.console import Console
from rich.table import Table

from dualwinch.cli.output import measured, styled, terminal, version_notes, versions
from dualwinch.cli.progress import ProgressLine
from dualwinch.cli.simulate import engine_here

if TYPE_CHECKING:
    from dualwinch.reports.claims import Claim
    from dualwinch.simulation.experiment import EngineName
    from dualwinch.simulation.results.result import Result

    Runs = dict[tuple[int, str], Result]
    """(case, controller) → result."""
    Variants = dict[tuple[int, str, str], Result]
    """(case, position law, coordination) → result, without rows."""

app = App(
    name="reproduce",
    help_epilogue="""Examples:

    dualwinch reproduce
    dualwinch reproduce --cases 4 --controllers fando-nftsm,nftsm --out case4
    dualwinch reproduce --extended
""",
)


@app.default
def reproduce(
    *,
    out: Annotated[Path, Parameter(help="Folder for figures, data, metrics and the report.")] = Path("results"),
    cases: Annotated[str, Parameter(help="Cases to run, separated by commas.")] = "1,2,3,4",
    controllers: Annotated[
        str, Parameter(help="Controllers to compare, separated by commas.")
    ] = "fando-nftsm,nftsm,pid-cascade",
    extended: Annotated[
        bool, Parameter(help="Also compare all position laws and coordinations, beyond the paper's.", negative="")
    ] = False,
) -> None:
    """Run the paper's cases and controllers, and write every figure, the data and one report.

    Prints the figures of merit and, where Case 4 runs with both sliding-mode controllers, the reductions of
    Figure 21 beside the paper's.
    """
    from dualwinch.config.folders import made_folder

    numbers, kinds = _chosen_cases(cases.split(",")), _chosen_controllers(controllers.split(","))
    with made_folder(out), made_folder(out / "data"), made_folder(out / "figures"):
        _reproduce(out, numbers, kinds, extended=extended)


FIGURE_21 = 21


def _reproduce(out: Path, numbers: list[int], kinds: list[str], *, extended: bool) -> None:
    """The same, once everything is checked and there are folders."""
    from dualwinch.config.experiment_file import to_toml
    from dualwinch.reports.claims import claims
    from dualwinch.simulation.paper import FIGURES, case
    from dualwinch.simulation.results.storage import save
    from dualwinch.simulation.simulate import simulate

    engine = engine_here("compiled")
    jobs = [(number, kind) for number in numbers for kind in kinds]
    contents = [figure for figure in FIGURES if figure.case in numbers]
    compared = 4 in numbers and {"fando-nftsm", "nftsm"} <= set(kinds)
    more = len(variants_beyond_paper()) * len(numbers) if extended else 0
    with _progress(2 * len(jobs) + len(contents) + compared + 1 + more) as step:
        runs: Runs = {}
        for number, kind in jobs:
            step(f"case {number}, {kind}: simulate")
            runs[number, kind] = simulate(case(number, kind), engine=engine)
        for (number, kind), result in runs.items():
            step(f"case {number}, {kind}: write data")
            save(result, out / "data" / f"case{number}-{kind}.parquet", version_notes())
        variants = run_variants(numbers, step, engine) if extended else {}
        _write_metrics(out / "metrics.json", runs, variants)
        images: dict[int, bytes] = {}
        for figure in contents:
            step(f"figure {figure.number}: case {figure.case}, {figure.content}")
            images[figure.number] = _draw(figure.content, _of_case(runs, figure.case), out, figure.number)
        if compared:
            step("figure 21: with and without observer")
            images[FIGURE_21] = _draw("steady_state_bars", _of_case(runs, 4), out, FIGURE_21)
        step("report")
        from dualwinch.reports.reproduction import write_report

        found = claims(runs, other_observers(runs, engine) if compared else None)
        write_report(out / "report.html", runs, images, to_toml(case(numbers[-1])), versions(), found)
    console = terminal()
    print_tables(console, runs)
    print_claims(console, found)
    if extended:
        print_variants(
            console, variants, new_table("Beyond the paper: position laws, and coordinations with fando-nftsm", ())
        )
    console.print("Figures, data and report are in", styled("bold", str(out), f"; open {out / 'report.html'}"))


def _chosen_cases(words: list[str]) -> list[int]:
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.quantities.quantity import unknown
    from dualwinch.simulation.paper import CASES

    allowed = {str(number): number for number in CASES}
    for word in map(str.strip, words):
        if word not in allowed:
            raise ConfigurationError(f"--cases = {','.join(words)}: {unknown('case', word, allowed)}")
    return sorted({allowed[word.strip()] for word in words})


def _chosen_controllers(words: list[str]) -> list[str]:
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.quantities.quantity import unknown
    from dualwinch.simulation.paper import CONTROLLERS

    chosen = {word.strip() for word in words}
    for word in sorted(chosen - set(CONTROLLERS)):
        raise ConfigurationError(f"--controllers = {','.join(words)}: {unknown('controller', word, CONTROLLERS)}")
    return [kind for kind in CONTROLLERS if kind in chosen]


def _of_case(runs: Runs, number: int) -> dict[str, Result]:
    return {kind: result for (run_case, kind), result in runs.items() if run_case == number}


@contextmanager
def _progress(steps: int) -> Iterator:
    with ProgressLine() as progress:
        done = count()

        def step(phase: str) -> None:
            progress(next(done) / steps, phase)

        yield step


def _draw(content: str, results: dict[str, Result], out: Path, number: int) -> bytes:
    """Write one figure as PNG and SVG; the SVG's bytes are for the report."""
    from dualwinch.simulation import plots

    figure = getattr(plots, content)(results)
    path = out / "figures" / f"figure{number:02d}.svg"
    for file in (path.with_suffix(".png"), path):
        plots.save(figure, file)
    return path.read_bytes()


def _write_metrics(path: Path, runs: Runs, variants: Variants) -> None:
    from dualwinch.codegen.files import atomic
    from dualwinch.simulation.metrics.metrics import metric_quantities
    from dualwinch.simulation.paper import REDUCTIONS, reductions

    records = [
        {"case": number, "controller": kind, "outcome": result.outcome, **_finite(asdict(result.metrics))}
        for (number, kind), result in runs.items()
    ]
    content = {
        "versions": versions(),
        "units": {name: quantity.unit for name, quantity in metric_quantities().items()},
        "runs": records,
        "reductions": _finite(reductions(runs) or {}),
        "paper_reductions": REDUCTIONS,
    }
    if variants:
        content["extended"] = [
            {"case": number, "controller": law, "coordination": coordination, "outcome": result.outcome}
            | _finite(asdict(result.metrics))
            for (number, law, coordination), result in variants.items()
        ]
    with atomic(path) as unfinished:
        unfinished.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _finite(values: dict[str, float]) -> dict[str, float | None]:
    import numpy as np

    return {name: float(value) if np.isfinite(value) else None for name, value in values.items()}


OTHER_GAINS = (2.5, 50.0)
"""Gains L₀ = K_f in 1/s beside the assumed ones (A9), to say what rests on them."""


def other_observers(runs: Runs, engine: EngineName = "compiled") -> dict[float, float]:
    """Gain of an observer in Case 4 → change of the steady mean error by it."""
    from dualwinch.simulation.paper import case
    from dualwinch.simulation.settings import override
    from dualwinch.simulation.simulate import simulate

    without = runs[4, "nftsm"].metrics.steady_mae
    found = {}
    for gain in OTHER_GAINS:
        gains = {"controller.observer.l0": gain, "controller.observer.kf": gain}
        with_it = simulate(override(case(4), gains), stride=0, engine=engine)
        found[gain] = with_it.metrics.steady_mae / without - 1
    return found


def new_table(title: str, columns: tuple[str, ...]) -> Table:
    """A table of runs: case, controller, and numbers under these headings."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("case", justify="right")
    table.add_column("controller", no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def print_tables(console: Console, runs: Mapping[tuple[int, str], Result]) -> None:
    """Print the figures of merit, and Figure 21's reductions where there are the runs for them."""
    from dualwinch.simulation.paper import CONTROLLERS, reductions

    whole, steady = ("MAE\nmm", "max |e|\nmm", "MSE\nmm²"), ("steady\nMAE mm", "steady\nmax |e|", "steady\nMSE mm²")
    tracking = new_table("Tracking error", whole + steady)
    ropes = new_table("Ropes and limits", ("saturated\n%", "peak tension\nN", "least tension\nN", "chatter\nN/sample"))
    last = 0
    for (number, kind), result in runs.items():
        if last and number != last:
            tracking.add_section()
            ropes.add_section()
        m, ended = result.metrics, "" if result.outcome == "completed" else f" ({result.outcome})"
        head = (str(number) if number != last else "", CONTROLLERS[kind] + ended)
        millimetres = (1e3 * m.mae, 1e3 * m.max_abs_error, 1e6 * m.mse)
        millimetres += (1e3 * m.steady_mae, 1e3 * m.steady_max_abs_error, 1e6 * m.steady_mse)
        tracking.add_row(*head, *(measured(value, ".3g") for value in millimetres))
        forces = (100 * m.saturated_share, m.peak_tension, m.min_tension, m.chatter)
        ropes.add_row(*head, *map(measured, forces))
        last = number
    console.print(tracking)
    console.print(ropes)
    change = reductions(runs)
    if change:
        _print_reductions(console, change)


def print_claims(console: Console, found: list[Claim]) -> None:
    """Print the paper's claims and what became of them."""
    if not found:
        return
    table = Table(
        title="The paper, claim by claim", title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, leading=1
    )
    for heading in ("the paper says", "these runs say"):
        table.add_column(heading, overflow="fold")
    table.add_column("", no_wrap=True)
    colours = {"holds": "green", "partly": "yellow", "does not hold": "red"}
    for claim in found:
        table.add_row(claim.words, claim.here, styled(colours[claim.verdict], claim.verdict))
    console.print(table)


def _print_reductions(console: Console, change: dict[str, float]) -> None:
    from dualwinch.simulation.paper import REDUCTIONS, percent

    table = Table(
        title="Figure 21: what the observer changes\n(Case 4, steady state)", title_justify="left", box=box.SIMPLE_HEAD
    )
    for name in ("", "MAE", "max |e|", "MSE"):
        table.add_column(name, justify="right" if name else "left")
    table.add_row("here", *(percent(change[key]) for key in REDUCTIONS))
    table.add_row("paper", *(percent(share, "+g") for share in REDUCTIONS.values()))
    console.print(table)


PAPERS_LAW, PAPERS_COORDINATION = "fando-nftsm", "differential-tension"


def variants_beyond_paper() -> list[tuple[str, str]]:
    """Position law and coordination of each run."""
    from dualwinch.controllers.controller import POSITION_LAWS
    from dualwinch.controllers.registry import COORDINATIONS

    others = (coordination for coordination in COORDINATIONS if coordination != PAPERS_COORDINATION)
    return [*((law, PAPERS_COORDINATION) for law in POSITION_LAWS), *((PAPERS_LAW, other) for other in others)]


def run_variants(numbers: list[int], step: Callable[[str], None], engine: EngineName) -> Variants:
    """Run all variants with the gains they come with.

    Args:
        numbers: cases of the paper.
        step: called with the name of each run.
        engine: that runs them.
    """
    from dualwinch.simulation.paper import case
    from dualwinch.simulation.settings import override
    from dualwinch.simulation.simulate import simulate

    runs: Variants = {}
    for number in numbers:
        for law, coordination in variants_beyond_paper():
            step(f"case {number}, {law}, {coordination}")
            experiment = override(case(number, law), {"controller.coordination.kind": coordination})
            runs[number, law, coordination] = simulate(experiment, stride=0, engine=engine)
    return runs


def print_variants(console: Console, runs: Variants, table: Table) -> None:
    """Fill and print a table that has the columns of case and controller: tracking, chatter, slack, energy.

    A coordination stands for the paper's position law with it, a position law for itself with the paper's coordination.
    """
    for name in ("MAE\nmm", "steady\nmm", "chatter\nN", "slack\n%", "peak\nN", "energy\nkJ"):
        table.add_column(name, justify="right", no_wrap=True)
    last = 0
    for (number, law, coordination), result in runs.items():
        if last and number != last:
            table.add_section()
        m, ended = result.metrics, "" if result.outcome == "completed" else f" ({result.outcome})"
        name = law if coordination == PAPERS_COORDINATION else coordination
        values = (1e3 * m.mae, 1e3 * m.steady_mae, m.chatter, 100 * m.slack_share)
        forces = (m.peak_tension, m.energy / 1e3)
        table.add_row(
            str(number) if number != last else "",
            name + ended,
            *(measured(value, ".3g") for value in values),
            *map(measured, forces),
        )
        last = number
    console.print(table)
