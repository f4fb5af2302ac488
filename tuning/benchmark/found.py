"""What a race has found, as data; `tuning.benchmark.result` shows it."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.tuning.benchmark.comparison import ErrorRatio, PairComparison, holm, ratio_of
from dualwinch.tuning.benchmark.entries import BenchmarkTerms, names
from dualwinch.tuning.benchmark.scores import ERROR, BaselineScore, EntryResult, ScoredRuns

MEAN_ERROR = Statistic("mean", ERROR)
"""What the searches minimise."""


@dataclass(frozen=True, repr=False)
class BenchmarkFindings:
    """Entries that were all tuned with the same number of rollouts, in the same unseen scenarios.

    Attributes:
        terms: what was the same for all.
        paper: the paper's gains, and the least error there is.
        entries: who is finished, a search each.
        left: number of entries that an interrupt has left out.
    """

    terms: BenchmarkTerms
    paper: BaselineScore
    entries: tuple[EntryResult, ...]
    left: int = 0

    @cached_property
    def names(self) -> dict[str, str]:
        """Key of each entry → what it is called; all its searches are called alike."""
        return names([scored.entry for scored in self.entries])

    @cached_property
    def searches(self) -> dict[str, tuple[EntryResult, ...]]:
        """Key of an entry's first search → all its searches, the least error first."""
        groups: dict[str, list[EntryResult]] = {}
        for scored in sorted(self.entries, key=self._order):
            groups.setdefault(scored.entry.group, []).append(scored)
        return {key: tuple(group) for key, group in groups.items()}

    @cached_property
    def by_key(self) -> dict[str, EntryResult]:
        """Key of each entry → what it came to."""
        return {scored.entry.key: scored for scored in self.entries}

    @cached_property
    def ratios(self) -> dict[str, ErrorRatio]:
        """Key of each entry → its errors over those of the paper's gains."""
        return {scored.entry.key: _ratio(scored.runs, self.paper.runs) for scored in self.entries}

    @cached_property
    def ranking(self) -> tuple[EntryResult, ...]:
        """The median search of every entry, the least error first; at the end who did not run all to its end.

        Of an even number of searches the worse one of the two in the middle.
        """
        return tuple(sorted((group[len(group) // 2] for group in self.searches.values()), key=self._order))

    def _order(self, scored: EntryResult) -> tuple[int, float]:
        lost, ratio = int((~scored.runs.completed).sum()), self._estimate(scored)
        return lost, math.inf if math.isnan(ratio) else ratio

    def _estimate(self, scored: EntryResult) -> float:
        return self.ratios[scored.entry.key].interval.estimate

    @cached_property
    def pairs(self) -> tuple[PairComparison, ...]:
        """Every two of the ranking, in its order."""
        couples = list(combinations(self.ranking, 2))
        ratios = [_ratio(first.runs, second.runs) for first, second in couples]
        corrected = holm([ratio.p for ratio in ratios])
        return tuple(
            PairComparison(first.entry.key, second.entry.key, ratio, level, self._apart(first, second))
            for (first, second), ratio, level in zip(couples, ratios, corrected, strict=True)
        )

    def _apart(self, first: EntryResult, second: EntryResult) -> bool:
        ours, theirs = (
            [self._order(search) for search in self.searches[scored.entry.group]] for scored in (first, second)
        )
        return max(ours) < min(theirs) or max(theirs) < min(ours)

    @property
    def luck(self) -> float:
        """Largest ratio of the errors of two searches of one entry; 1 where each was tuned once."""
        groups = [[self._estimate(search) for search in group] for group in self.searches.values()]
        spans = [[ratio for ratio in group if math.isfinite(ratio)] for group in groups]
        return max((max(span) / min(span) for span in spans if span), default=1.0)

    def alike(self, key: str) -> tuple[str, ...]:
        """Keys of the ranking that one of it does not differ from, by `tuning.benchmark.comparison.RULE`."""
        return tuple(
            pair.second if pair.first == key else pair.first
            for pair in self.pairs
            if key in (pair.first, pair.second) and not pair.differ
        )

    def pair(self, first: str, second: str) -> PairComparison:
        """Two entries, whichever of them is ahead; the ratio is of the first over the second."""
        found = next(pair for pair in self.pairs if {pair.first, pair.second} == {first, second})
        if found.first == first:
            return found
        ratio = _ratio(self.by_key[first].runs, self.by_key[second].runs)
        return replace(found, first=first, second=second, ratio=ratio)


def _ratio(runs: ScoredRuns, others: ScoredRuns) -> ErrorRatio:
    both = runs.completed & others.completed
    return ratio_of(runs.metrics[ERROR][both], others.metrics[ERROR][both])
