"""Evaluate candidates by compiled rollouts: all in some scenarios, the promising in more, the best in yet more."""

import math
from collections.abc import Sequence

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.hardness import Hardness
from dualwinch.tuning.scoring.ranking import promising_first
from dualwinch.tuning.scoring.runs import joined, row_of
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.tried import Margins, Tried

FIRST_SHARE, KEPT_SHARE = 0.5, 0.3
"""Share of the scenarios that all candidates see, and share of the candidates that see the rest: of sixteen five, in
six scenarios, which nearly fills two blocks of lanes."""

FEW = 8
"""So many candidates are not worth pruning: their scenarios fill few vector lanes."""

LEADERS, MOST_TRIED = 2, 6
"""Candidates of a call, the most promising of it, that meet the further hard scenarios at a time, and in all at most:
whoever leads without having met them is what a search would follow next."""

HOPELESS = 0.05
"""Share of a bound: candidates that exceed one by more meet no further scenarios."""

SURVEYED = 8
"""Every so many calls the one that leads meets all hard scenarios there are: others may have become the hardest."""

EXEMPT = ("paper", "start")
"""Origins of candidates that are never given up early: others are compared with them."""


class Evaluator(Scorer):
    """Evaluates the candidates of a search, call by call, and learns in which scenarios the best come off worst."""

    def __init__(self, prepared: Prepared, *, prune: bool = True, threads: int | None = None) -> None:
        """An evaluator.

        Args:
            prepared: gives scenarios, objectives and constraints.
            prune: whether hopeless candidates are given up after the first scenarios; never with several objectives.
            threads: default: one a core.
        """
        super().__init__(prepared, threads)
        problem = prepared.problem
        self._hardness, self._calls = Hardness(prepared), 0
        self._first = round(FIRST_SHARE * problem.scenarios) if prune and len(problem.objectives) == 1 else 0

    @property
    def for_the_best(self) -> tuple[Experiment | Scenario, ...]:
        """The tuning scenarios in which the best are tried at present, hard ones among them that others do not meet."""
        return (*self._hardness.everyones, *self._hardness.further)

    def evaluate(self, candidates: Sequence[Candidate]) -> list[Evaluation]:
        """Evaluate candidates in the tuning scenarios: the promising ones in further hard ones, one at times in all.

        Raises:
            KeyboardInterrupt: interrupted; nothing of this batch is kept.
        """
        if not self._first:
            return self.over(candidates, self.prepared.scenarios, tuning=True)
        everyones, further, rest = self._hardness.everyones, self._hardness.further, self._hardness.rest
        tried = self._tried(candidates, everyones)
        met = self._led(tried, everyones, further)
        self._calls += 1
        leader = promising_first(tried.judged)[0] if met else None
        if rest and leader in met and self._calls % SURVEYED == 0:
            met = [leader]
            self._meet(tried, met, [*everyones, *further], rest)
        self._hardness.learn([tried.results[row] for row in met])
        return tried.judged

    def _led(
        self,
        tried: Tried,
        everyones: Sequence[Experiment | Scenario],
        further: Sequence[Experiment | Scenario],
    ) -> list[int]:
        """The most promising meet the further hard scenarios, until the one that leads has met them; rows of those.

        Were only those to meet them that hold, whoever fails there would fall behind those that nobody has tried.
        """
        met: list[int] = []
        while further and len(met) < MOST_TRIED:
            order = promising_first(tried.judged)
            if order[0] in met:
                break
            waiting = [row for row in order if row in tried.results and row not in met]
            rows = [row for row in waiting if tried.judged[row].violation <= HOPELESS][:LEADERS]
            if not rows:
                break
            self._meet(tried, rows, everyones, further)
            met += rows
        return met

    def _meet(
        self,
        tried: Tried,
        rows: Sequence[int],
        before: Sequence[Experiment | Scenario],
        scenarios: Sequence[Experiment | Scenario],
    ) -> None:
        """Candidates of a call meet further scenarios, beside those that they have met before."""
        more = self.run([tried.candidates[row] for row in rows], scenarios, to_the_end=False)
        met = [*before, *scenarios]
        for number, row in enumerate(rows):
            candidate, margins = tried.candidates[row], tried.margins[row]
            tried.results[row] = result = joined(tried.results[row], more, number)
            tried.judged[row] = self.judged(candidate, result, met, tuning=True, margins=margins)

    def _tried(self, candidates: Sequence[Candidate], scenarios: Sequence[Experiment | Scenario]) -> Tried:
        """What candidates come to, the hopeless given up after the first scenarios."""
        exempt = any(candidate.origin in EXEMPT for candidate in candidates)
        if len(candidates) <= FEW:
            result = self.run(candidates, scenarios, to_the_end=exempt)
            whole = {row: row_of(result, row) for row in range(len(candidates))}
            margins = self._margins_of(candidates, whole)
            judged = [
                self.judged(candidate, whole[row], scenarios, tuning=True, margins=margins[row])
                for row, candidate in enumerate(candidates)
            ]
            return Tried(candidates, judged, whole, margins)
        first = scenarios[: self._first]
        early = self.run(candidates, first, to_the_end=exempt)
        judged = [
            self.judged(candidate, early, first, row, tuning=True, pruned=True)
            for row, candidate in enumerate(candidates)
        ]
        order = promising_first(judged)
        kept = set(order[: math.ceil(KEPT_SHARE * len(order))])
        kept |= {index for index, candidate in enumerate(candidates) if candidate.origin in EXEMPT}
        late = self.run([candidates[index] for index in sorted(kept)], scenarios[self._first :], to_the_end=exempt)
        whole = {index: joined(row_of(early, index), late, row) for row, index in enumerate(sorted(kept))}
        margins = self._margins_of(candidates, whole)
        for index, result in whole.items():
            judged[index] = self.judged(candidates[index], result, scenarios, tuning=True, margins=margins[index])
        return Tried(candidates, judged, whole, margins)

    def _margins_of(self, candidates: Sequence[Candidate], whole: dict[int, BatchResult]) -> list[Margins | None]:
        """Margins of the candidates that ran to the end in all scenarios."""
        completed = [
            index in whole and bool((whole[index].outcomes == "completed").all()) for index in range(len(candidates))
        ]
        return self.margins(candidates, self.prepared.margins, completed)
