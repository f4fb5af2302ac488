"""Which trials are tried in more scenarios: ladders of them, the first from the best to ever more cautious ones."""

from collections.abc import Callable, Sequence

from dualwinch.tuning.scoring.evaluation import Evaluation

RUNG, GROWTH = 0.02, 1.17
"""How much larger, as a share, the objective of the second finalist is than that of the first, where they were tuned;
and by which factor that grows from each to the next. The best are told apart; the last is three times the first."""

Met = tuple[Evaluation, Evaluation]
"""A trial as it was tuned, and what it came to in more scenarios."""


def those_that_hold(
    ordered: Sequence[Evaluation],
    first: Sequence[Evaluation],
    held: Callable[[Sequence[Evaluation]], list[Met]],
    go_on: Callable[[], bool],
) -> list[Met]:
    """Trials that hold in more scenarios, among them the best that does, or nearly.

    The very best where tuned are often the ones that only just hold, and far from them are some that surely do. So a
    first ladder leads from the best to these; each further one, of as many, from the best to the best that held.

    Args:
        ordered: trials, the best first, each with a number of its own.
        first: of these the first ladder.
        held: tries trials, and gives those that hold.
        go_on: whether there may be a further ladder.
    """
    met, most = held(first), len(first)
    waiting, over = list(ordered), {trial.number for trial in first}
    while go_on():
        holding = {trial.number for trial, _ in met}
        end = next((index for index, trial in enumerate(waiting) if trial.number in holding), len(waiting))
        waiting = [trial for trial in waiting[:end] if trial.number not in over]
        if not waiting:
            break
        ladder = [waiting[index] for index in evenly(len(waiting), most)]
        over = {trial.number for trial in ladder}
        met += held(ladder)
    return met


def evenly(count: int, most: int) -> list[int]:
    """So many indices of a sequence, at most, spread evenly from its first on."""
    number = min(count, most)
    return [share * count // number for share in range(number)]


def rungs(ordered: Sequence[Evaluation], most: int) -> list[int]:
    """Indices of trials: the best, then of each further rung the one that keeps furthest from its bounds.

    A rung holds the trials whose objective is a share larger than that of its first one, ever more of them (`RUNG`).

    Args:
        ordered: trials, the best first.
        most: number of indices, at most.
    """
    starts = [0]
    for index, trial in enumerate(ordered):
        above, width = ordered[starts[-1]], 1 + RUNG * GROWTH ** (len(starts) - 1)
        if trial.objectives[0] > width * above.objectives[0]:
            starts.append(index)
    ends = [*starts[1:], len(ordered)]
    further = [
        max(range(start, end), key=lambda index: ordered[index].reserve)
        for start, end in zip(starts[1:most], ends[1:most], strict=True)
    ]
    found = [0, *further]
    rest = [index for index in range(len(ordered)) if index not in found]
    return sorted(found + rest[: most - len(found)])
