"""Beyond the paper: every position law, and every coordination with the paper's law, side by side."""

from collections.abc import Callable

from rich.console import Console
from rich.table import Table

from dualwinch.commands.output import measured
from dualwinch.controllers.controller import POSITION_LAWS
from dualwinch.controllers.coordinations.registry import COORDINATIONS
from dualwinch.simulation.loop.engine import EngineName
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

PAPERS_LAW, PAPERS_COORDINATION = "fando-nftsm", "differential-tension"

VARIANTS = (
    *((law, PAPERS_COORDINATION) for law in POSITION_LAWS),
    *((PAPERS_LAW, coordination) for coordination in COORDINATIONS if coordination != PAPERS_COORDINATION),
)
"""Position law and coordination of each run."""

Variants = dict[tuple[int, str, str], Result]
"""(case, position law, coordination) → result, without rows."""


def run_variants(numbers: list[int], step: Callable[[str], None], engine: EngineName) -> Variants:
    """Run all variants with the gains they come with.

    Args:
        numbers: cases of the paper.
        step: told what comes next.
        engine: that runs them.
    """
    runs: Variants = {}
    for number in numbers:
        for law, coordination in VARIANTS:
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
