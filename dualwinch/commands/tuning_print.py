"""A finished study on the terminal."""

from rich import box
from rich.table import Table
from rich.text import Text

from dualwinch.commands.output import styled, terminal
from dualwinch.tuning.result import (
    TuningResult,
    advice,
    authority,
    contenders,
    endings,
    headline,
    margin_places,
    statistics_table,
    worth,
)
from dualwinch.tuning.scoring.ranking import pareto_front


def print_study(tuned: TuningResult) -> None:
    """Print what was found, what it is worth, what would help and what it took."""
    console, verdict = terminal(), tuned.verdict

    def say(words: str | Text) -> None:
        console.print(words, highlight=False, soft_wrap=True)

    say(styled("bold", worth(tuned)))
    say(headline(tuned))
    console.print(_table(tuned))
    for words in contenders(tuned):
        say(words)
    for constraint in verdict.constraints:
        kept = verdict.scored.violations[constraint.label] <= 0
        say(styled("" if kept else "red", "kept    " if kept else "violated", f"  {constraint.label}"))
    for place in margin_places(tuned):
        say(place)
    say(endings(tuned))
    if beyond := authority(tuned):
        say(beyond)
    for number, sentence in enumerate(advice(tuned)):
        say(f"{'what would help: ' if not number else '                 '}{sentence}")
    if len(tuned.problem.objectives) > 1:
        say(f"Pareto front: {len(pareto_front(tuned.trials))} trials, in study.json")
    cost = tuned.cost
    margins = f"; {cost.margin_seconds:.1f} s of these for stability margins" if cost.margin_seconds else ""
    say(
        f"{cost.rollouts} rollouts; {cost.preparing:.1f} s preparing, {cost.searching:.1f} s searching "
        f"({100 * cost.overhead:.0f} % of it not in rollouts), {cost.judging:.1f} s choosing and scoring{margins}"
    )


def _table(tuned: TuningResult) -> Table:
    names, rows = statistics_table(tuned)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", style="bold", no_wrap=True)
    for name in names[1:]:
        table.add_column(name, justify="right" if name else "left")
    for row in rows:
        table.add_row(*row)
    return table
