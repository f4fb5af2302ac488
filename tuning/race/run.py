"""Run a race: the paper's gains once, then one entry after the other, each kept as soon as it is finished."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dualwinch.model.quantities.tree import with_leaves
from dualwinch.tuning.progress import CHOOSING, DRAWING, REFERENCES, SEARCHING, Progress
from dualwinch.tuning.progress import SCORING as SCORING_BEST
from dualwinch.tuning.race.entry import names
from dualwinch.tuning.race.folder import PAPER, Folder
from dualwinch.tuning.race.result import Race
from dualwinch.tuning.race.score import LEAST_PHASE, PAPER_PHASE, STRESS_PHASE, UNSEEN_PHASE, Breaking, paper, scored
from dualwinch.tuning.race.scored import Paper, Scored
from dualwinch.tuning.race.terms import Entrant, Terms

BEGINS = {
    DRAWING: 0.0,
    REFERENCES: 0.02,
    PAPER_PHASE: 0.1,
    LEAST_PHASE: 0.1,
    SEARCHING: 0.12,
    CHOOSING: 0.82,
    SCORING_BEST: 0.9,
    UNSEEN_PHASE: 0.93,
    STRESS_PHASE: 0.95,
}
"""Phase → share of an entry's time that is over by then, roughly."""

Told = Callable[[float, str], None]
"""``told(share, words)``: how much of what is left to do is done, and what is being done."""


class Lap:
    """Watches one entry, and tells how much of the race is done."""

    def __init__(self, name: str, number: int, of: int, told: Told | None) -> None:
        """Watch entry `number`, from 0, of so many that have to be run."""
        self._name, self._number, self._of, self._told = name, number, of, told
        self._words = ""

    def phase(self, words: str) -> None:
        """Tell what is done from now on."""
        self._words = words
        self._tell(BEGINS.get(words, 0.0))

    def progress(self, progress: Progress, until: float | None, trials: int | None) -> None:  # noqa: ARG002
        """Tell how far the search is."""
        self._tell(BEGINS[SEARCHING] + progress.share * (BEGINS[CHOOSING] - BEGINS[SEARCHING]))

    def _tell(self, share: float) -> None:
        if self._told:
            number = f"{self._number + 1} of {self._of}, " if self._of > 1 else ""
            self._told((self._number + share) / self._of, f"{number}{self._name}: {self._words}")


def race(
    entrants: Sequence[Entrant],
    terms: Terms,
    *,
    folder: Path | None = None,
    breaking: Breaking | None = None,
    threads: int | None = None,
    told: Told | None = None,
) -> Race:
    """Tune and score every entry that the folder does not hold yet; find out what breaks it where that is asked for.

    An interrupt (Ctrl-C) keeps what is finished; the same call goes on with the rest.

    Args:
        entrants: who takes part, at least one.
        terms: what is the same for all.
        folder: where finished entries are kept; those of earlier calls take part too, if they were run on these terms.
        breaking: finds out what breaks the best gains first.
        threads: default: one a core.
        told: called now and then.

    Returns:
        The race; `Race.left` says how many entries an interrupt has left out.

    Raises:
        ConfigurationError: the folder holds a race on other terms.
        DualwinchError: no compiler, no usable cache folder, or no optimum found.
        KeyboardInterrupt: interrupted before the first entry was finished.
    """
    kept = Folder(folder, terms.to_record())
    known = {each.entry.key: kept.find(each.entry.stem, each.definition) for each in entrants}
    waiting = [each for each in entrants if _lacks(known[each.entry.key], breaking)]
    left, called = len(waiting), names([each.entry for each in entrants])
    try:
        if kept.find(PAPER) is None:
            first = Lap(PAPER, 0, 1, lambda _, words: told(0.0, words) if told else None)
            kept.keep(PAPER, {}, paper(entrants[0].problem, terms, threads=threads, watch=first).to_record())
        for number, entrant in enumerate(waiting):
            entry, lap = entrant.entry, Lap(called[entrant.entry.key], number, len(waiting), told)
            record = known[entry.key]
            if record and breaking:
                lap.phase(STRESS_PHASE)
                found = breaking(with_leaves(entrant.problem.experiment, record["gains"]))
                kept.keep(entry.stem, entrant.definition, record | {"stress": list(found)})
            else:
                done = scored(entrant, terms, breaking=breaking, threads=threads, watch=lap)
                kept.keep(entry.stem, entrant.definition, done.to_record())
            left -= 1
    except KeyboardInterrupt:
        if not set(kept.stems) - {PAPER}:
            raise
    records = {stem: kept.find(stem) for stem in kept.stems}
    return Race(
        terms=terms,
        paper=Paper.from_record(records.pop(PAPER) or {}),
        entries=tuple(Scored.from_record(record) for record in records.values() if record),
        left=left,
    )


def _lacks(record: Mapping[str, Any] | None, breaking: Breaking | None) -> bool:
    """Whether something is still to be found out about an entry."""
    return record is None or (breaking is not None and record["stress"] is None)
