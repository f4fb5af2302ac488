"""What a race has found, as data; `tuning.race.result` shows it."""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

from dualwinch.simulation.ensembles.statistic import Statistic
from dualwinch.tuning.race.entry import names
from dualwinch.tuning.race.front import ERROR
from dualwinch.tuning.race.pairs import Pair, Ratio, holm, ratio_of
from dualwinch.tuning.race.scored import Paper, Runs, Scored
from dualwinch.tuning.race.terms import Terms

MEAN_ERROR = Statistic("mean", ERROR)
"""What the searches minimise."""


@dataclass(frozen=True, repr=False)
class Found:
    """Entries that were all tuned with the same number of rollouts, in the same unseen scenarios.

    Attributes:
        terms: what was the same for all.
        paper: the paper's gains, and the least error there is.
        entries: who is finished.
        left: number of entries that an interrupt has left out.
    """

    terms: Terms
    paper: Paper
    entries: tuple[Scored, ...]
    left: int = 0

    @cached_property
    def names(self) -> dict[str, str]:
        """Key of each entry → what it is called."""
        return names([scored.entry for scored in self.entries])

    @cached_property
    def by_key(self) -> dict[str, Scored]:
        """Key of each entry → what it came to."""
        return {scored.entry.key: scored for scored in self.entries}

    @cached_property
    def ratios(self) -> dict[str, Ratio]:
        """Key of each entry → its errors over those of the paper's gains."""
        return {scored.entry.key: _ratio(scored.runs, self.paper.runs) for scored in self.entries}

    @cached_property
    def ranking(self) -> tuple[Scored, ...]:
        """The entries, the least error first; behind them those that did not run all scenarios to their end."""

        def order(scored: Scored) -> tuple[int, float]:
            lost, ratio = int((~scored.runs.completed).sum()), self.ratios[scored.entry.key].interval.estimate
            return lost, math.inf if math.isnan(ratio) else ratio

        return tuple(sorted(self.entries, key=order))

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Every two entries, in the order of the ranking."""
        couples = list(combinations(self.ranking, 2))
        ratios = [_ratio(first.runs, second.runs) for first, second in couples]
        corrected = holm([ratio.p for ratio in ratios])
        return tuple(
            Pair(first.entry.key, second.entry.key, ratio, level)
            for (first, second), ratio, level in zip(couples, ratios, corrected, strict=True)
        )

    def alike(self, key: str) -> tuple[str, ...]:
        """Keys of the entries that one does not differ from, by `tuning.race.pairs.RULE`."""
        return tuple(
            pair.second if pair.first == key else pair.first
            for pair in self.pairs
            if key in (pair.first, pair.second) and not pair.differ
        )

    def pair(self, first: str, second: str) -> Pair:
        """Two entries, whichever of them is ahead; the ratio is of the first over the second."""
        found = next(pair for pair in self.pairs if {pair.first, pair.second} == {first, second})
        if found.first == first:
            return found
        return Pair(first, second, _ratio(self.by_key[first].runs, self.by_key[second].runs), found.corrected)


def _ratio(runs: Runs, others: Runs) -> Ratio:
    both = runs.completed & others.completed
    return ratio_of(runs.metrics[ERROR][both], others.metrics[ERROR][both])
