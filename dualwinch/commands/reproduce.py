"""``dualwinch reproduce``: the paper's cases, controllers and figures, in one folder."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from os import PathLike
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from dualwinch.codegen.files import atomic
from dualwinch.commands.doctor import versions
from dualwinch.commands.extended import VARIANTS, Variants, print_variants, run_variants
from dualwinch.commands.folders import made_folder
from dualwinch.commands.measured import measured
from dualwinch.commands.terminal import styled, terminal
from dualwinch.config.experiment_file import to_toml
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.simulation.comparison import percent, reductions
from dualwinch.simulation.metrics.metrics import Metrics
from dualwinch.simulation.paper import CASES, CONTROLLERS, FIGURES, REDUCTIONS, case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.results.storage import save
from dualwinch.simulation.simulate import simulate

Runs = dict[tuple[int, str], Result]
"""(case, controller) → result."""

FIGURE_21 = 21


def reproduce(out: str | PathLike[str], cases: list[str], controllers: list[str], *, extended: bool = False) -> None:
    """Run, print and write everything.

    Args:
        out: folder for figures, data, ``metrics.json`` and ``report.html``; made if it is missing.
        cases: numbers of cases, as words.
        controllers: names of controllers.
        extended: also compare all position laws and coordinations, beyond the paper's.

    Raises:
        ConfigurationError: no such case or controller.
        OSError: the folder cannot be written to.
    """
    out, numbers, kinds = Path(out), _chosen_cases(cases), _chosen_controllers(controllers)
    with made_folder(out), made_folder(out / "data"), made_folder(out / "figures"):
        _reproduce(out, numbers, kinds, extended=extended)


def _reproduce(out: Path, numbers: list[int], kinds: list[str], *, extended: bool) -> None:
    """The same, once everything is checked and there are folders."""
    jobs = [(number, kind) for number in numbers for kind in kinds]
    contents = [figure for figure in FIGURES if figure.case in numbers]
    compared = 4 in numbers and {"fando-nftsm", "nftsm"} <= set(kinds)
    more = len(VARIANTS) * len(numbers) if extended else 0
    with _progress(2 * len(jobs) + len(contents) + compared + 1 + more) as step:
        runs: Runs = {}
        for number, kind in jobs:
            step(f"case {number}, {kind}: simulate")
            runs[number, kind] = simulate(case(number, kind))
        for (number, kind), result in runs.items():
            step(f"case {number}, {kind}: write data")
            notes = {f"version_{name}": version for name, version in versions().items()}
            save(result, out / "data" / f"case{number}-{kind}.parquet", notes)
        variants = run_variants(numbers, step) if extended else {}
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

        write_report(out / "report.html", runs, images, to_toml(case(numbers[-1])), versions())
    console = terminal()
    _print_tables(console, runs)
    if extended:
        print_variants(
            console, variants, _table("Beyond the paper: position laws, and coordinations with fando-nftsm", ())
        )
    console.print("Figures, data and report are in", styled("bold", str(out), f"; open {out / 'report.html'}"))


def _chosen_cases(words: list[str]) -> list[int]:
    allowed = {str(number): number for number in CASES}
    wrong = [word for word in words if word.strip() not in allowed]
    if wrong:
        raise ConfigurationError(f"--cases = {','.join(words)}: {wrong[0]!r} must be one of {', '.join(allowed)}")
    return sorted({allowed[word.strip()] for word in words})


def _chosen_controllers(words: list[str]) -> list[str]:
    chosen = {word.strip() for word in words}
    wrong = sorted(chosen - set(CONTROLLERS))
    if wrong:
        raise ConfigurationError(
            f"--controllers = {','.join(words)}: {wrong[0]!r} must be one of {', '.join(CONTROLLERS)}"
        )
    return [kind for kind in CONTROLLERS if kind in chosen]


def _of_case(runs: Runs, number: int) -> dict[str, Result]:
    return {kind: result for (run_case, kind), result in runs.items() if run_case == number}


@contextmanager
def _progress(steps: int) -> Iterator:
    columns = (TextColumn("{task.description:<44}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = terminal(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=steps, completed=-1)

        def step(description: str) -> None:
            bar.update(task, advance=1, description=description)

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
    records = [
        {"case": number, "controller": kind, "outcome": result.outcome, **_finite(asdict(result.metrics))}
        for (number, kind), result in runs.items()
    ]
    content = {
        "versions": versions(),
        "units": {name: leaf.quantity.unit for name, leaf in describe(Metrics).items()},
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
    return {name: float(value) if np.isfinite(value) else None for name, value in values.items()}


def _table(title: str, columns: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("case", justify="right")
    table.add_column("controller", no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _print_tables(console: Console, runs: Runs) -> None:
    whole, steady = ("MAE\nmm", "max |e|\nmm", "MSE\nmm²"), ("steady\nMAE mm", "steady\nmax |e|", "steady\nMSE mm²")
    tracking = _table("Tracking error", whole + steady)
    ropes = _table("Ropes and limits", ("saturated\n%", "peak tension\nN", "least tension\nN", "chatter\nN/sample"))
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


def _print_reductions(console: Console, change: dict[str, float]) -> None:
    table = Table(
        title="Figure 21: what the observer changes\n(Case 4, steady state)", title_justify="left", box=box.SIMPLE_HEAD
    )
    for name in ("", "MAE", "max |e|", "MSE"):
        table.add_column(name, justify="right" if name else "left")
    table.add_row("here", *(percent(change[key]) for key in REDUCTIONS))
    table.add_row("paper", *(percent(share, "+g") for share in REDUCTIONS.values()))
    console.print(table)
