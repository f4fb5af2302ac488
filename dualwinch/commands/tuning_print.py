"""A finished study on the terminal."""

from rich import box
from rich.console import Console
from rich.table import Table

from dualwinch.tuning.plots.names import shown_unit
from dualwinch.tuning.scoring.ranking import pareto_front
from dualwinch.tuning.summary import advice, authority, comparison, contenders, endings, headings, headline
from dualwinch.tuning.tune import Tuned


def print_study(tuned: Tuned) -> None:
    """Print what was found, what it is worth, what would help and what it took."""
    console, verdict = Console(), tuned.verdict

    def say(words: str) -> None:
        console.print(words, highlight=False, soft_wrap=True)

    say(f"[bold]{headline(tuned)}[/bold]")
    console.print(_table(tuned))
    for words in contenders(tuned):
        say(words)
    for constraint in tuned.prepared.constraints:
        kept = verdict.scored.violations[constraint.label] <= 0
        say(f"{'kept    ' if kept else '[red]violated[/red]'}  {constraint.label}")
    say(endings(tuned) + (f"; {comparison(tuned)}" if verdict.improved else ""))
    if beyond := authority(tuned):
        say(beyond)
    for number, sentence in enumerate(advice(tuned)):
        say(f"{'what would help: ' if not number else '                 '}{sentence}")
    if len(tuned.problem.objectives) > 1:
        say(f"Pareto front: {len(pareto_front(tuned.trials))} trials, in study.json")
    cost = tuned.cost
    say(
        f"{cost.rollouts} rollouts; {cost.preparing:.1f} s preparing, {cost.searching:.1f} s searching "
        f"({100 * cost.overhead:.0f} % of it not in rollouts), {cost.judging:.1f} s choosing and scoring"
    )


def _table(tuned: Tuned) -> Table:
    """The statistics of the best, the start and the paper's gains, and the ratio of the best to the last of them."""
    verdict, columns = tuned.verdict, headings(tuned)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", style="bold", no_wrap=True)
    compared = "paper" in columns
    for heading in columns.values():
        table.add_column(heading, justify="right")
    if compared:
        table.add_column("best / paper", justify="right")
    table.add_column("")
    for name, value in verdict.scored.statistics.items():
        theirs = verdict.statistics("paper")[name]
        ratio = [f"{value / theirs:.3g}" if theirs else ""] if compared else []
        values = [f"{verdict.statistics(column)[name]:.4g}" for column in columns]
        table.add_row(name, *values, *ratio, shown_unit(tuned.problem.units[name]))
    return table
