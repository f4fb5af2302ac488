"""What ``dualwinch reproduce`` prints: figures of merit, Figure 21's reductions, and the paper's claims."""

from collections.abc import Mapping

from rich import box
from rich.console import Console
from rich.table import Table

from dualwinch.commands.output import measured, styled
from dualwinch.reports.claims import Claim
from dualwinch.simulation.paper import CONTROLLERS, REDUCTIONS, percent, reductions
from dualwinch.simulation.results.result import Result


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
    table = Table(
        title="Figure 21: what the observer changes\n(Case 4, steady state)", title_justify="left", box=box.SIMPLE_HEAD
    )
    for name in ("", "MAE", "max |e|", "MSE"):
        table.add_column(name, justify="right" if name else "left")
    table.add_row("here", *(percent(change[key]) for key in REDUCTIONS))
    table.add_row("paper", *(percent(share, "+g") for share in REDUCTIONS.values()))
    console.print(table)
