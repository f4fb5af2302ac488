"""Candidates run in scenarios and judged by objectives and constraints, and what that cost."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dualwinch.simulation.analysis.worst_margins import MarginSurvey
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning import clock
from dualwinch.tuning.constraint import Constraint
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.scoring.bounds import bounds_in
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.machines import survey
from dualwinch.tuning.scoring.runs import keeps_tight, leeways, over, row_of, run_pairs, worst_of
from dualwinch.tuning.scoring.tried import Margins

FAILED = "scenarios not completed <= 0"
"""Constraint that every scenario runs to its end; its violation is the share that does not."""

MOST_SLACK = 0.01
"""Share of a run with a slack rope beyond which the run is given up, where no rope may be slack at all."""


class Scorer:
    """Runs candidates of a problem in scenarios, judges them, and counts what that cost.

    Attributes:
        prepared: the problem.
        rollouts: number of rollouts so far.
        seconds: wall time they took.
        margin_seconds: wall time that stability margins took.
    """

    def __init__(self, prepared: Prepared, threads: int | None = None) -> None:
        """A scorer.

        Args:
            prepared: gives objectives and constraints.
            threads: default: one a core.
        """
        self.prepared = prepared
        self.rollouts, self.seconds, self.margin_seconds = 0, 0.0, 0.0
        self._threads, self._units = threads, prepared.problem.units
        self._most_slack = MOST_SLACK if keeps_tight(prepared.constraints) else None

    @property
    def pace(self) -> float:
        """Wall time in s that a rollout took in the mean, margins included; 0 before the first."""
        return (self.seconds + self.margin_seconds) / self.rollouts if self.rollouts else 0.0

    def start(self) -> Evaluation:
        """The start in the tuning scenarios, from the rollouts that preparing has made."""
        prepared = self.prepared
        candidate = Candidate(prepared.problem.start, "start")
        margins = self.margins([candidate], prepared.margins)[0]
        return self.judged(candidate, prepared.start, prepared.scenarios, tuning=True, margins=margins)

    def over(
        self,
        candidates: Sequence[Candidate],
        scenarios: Sequence[Experiment | Scenario],
        *,
        tuning: bool = False,
        constraints: Sequence[Constraint] | None = None,
    ) -> list[Evaluation]:
        """Evaluate candidates in all of some scenarios; arguments as of `judged`."""
        if not candidates:
            return []
        result = self.run(candidates, scenarios)
        margins = self.margins(candidates, self.prepared.margins if tuning else self.survey(scenarios))
        return [
            self.judged(candidate, result, scenarios, row, tuning=tuning, margins=margins[row], constraints=constraints)
            for row, candidate in enumerate(candidates)
        ]

    def survey(
        self, scenarios: Sequence[Experiment | Scenario], experiment: Experiment | None = None
    ) -> MarginSurvey | None:
        """The machines of some scenarios beside the nominal one (`tuning.scoring.machines.survey`)."""
        return survey(self.prepared.problem, scenarios, self._threads, experiment=experiment)

    def bounds(self, scenarios: Sequence[Scenario]) -> tuple[Constraint, ...]:
        """The constraints in other scenarios; the paper's controller, which bounds may refer to, is run there."""
        base = self.prepared.problem.paper_experiment
        with_paper = [replace(scenario, base=base) for scenario in scenarios]
        return bounds_in(self.prepared, self.run(None, with_paper), with_paper)

    def margins(
        self, candidates: Sequence[Candidate], machines: MarginSurvey | None, looked_at: Sequence[bool] | None = None
    ) -> list[Margins | None]:
        """The worst margins of candidates on some machines; ``None`` for those not looked at.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        problem, found = self.prepared.problem, list[Margins | None]([None] * len(candidates))
        chosen = [row for row in range(len(candidates)) if looked_at is None or looked_at[row]]
        if machines and chosen:
            began = clock.now()
            kinds = [statistic.margin for statistic in problem.margins]
            given = [candidates[row].point for row in chosen]
            values = [problem.space.parameters(point) if point else () for point in given]
            for row, worst in zip(chosen, machines.worst(values, kinds), strict=True):
                found[row] = worst
            self.margin_seconds += clock.now() - began
        return found

    def run(
        self,
        candidates: Sequence[Candidate] | None,
        scenarios: Sequence[Experiment | Scenario],
        *,
        to_the_end: bool = True,
    ) -> BatchResult:
        """The rollouts of candidates, a row each, in some scenarios; without candidates, those of the scenarios' own.

        Args:
            candidates: whose gains.
            scenarios: what is run.
            to_the_end: also where a rope is slack for long (`MOST_SLACK`), though the constraints forbid that.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        space = self.prepared.problem.space
        most_slack = None if to_the_end else self._most_slack
        began = clock.now()
        if candidates is None:
            result = run_pairs([], [[]], scenarios, self._threads)
        else:
            points = [space.parameters(candidate.point) for candidate in candidates]
            result = run_pairs(space.keys, points, scenarios, self._threads, most_slack)
        self.seconds += clock.now() - began
        self.rollouts += result.outcomes.size
        return result

    def judged(
        self,
        candidate: Candidate,
        result: BatchResult,
        scenarios: Sequence[Experiment | Scenario],
        row: int = 0,
        *,
        tuning: bool = False,
        pruned: bool = False,
        margins: Margins | None = None,
        constraints: Sequence[Constraint] | None = None,
    ) -> Evaluation:
        """What a row of a result comes to for a candidate; in tuning with a margin (`Problem.margin`).

        The constraints are by default those of the tuning scenarios (`tuning.scoring.bounds` has those of others).
        Stability margins that nobody has looked at have no value and violate nothing: such a candidate was given up, or
        failed a scenario.
        """
        problem, outcomes = self.prepared.problem, result.outcomes[row]
        done = outcomes == "completed"
        found = {statistic.name: over(statistic, result, row, scenarios) for statistic in problem.reported}
        if margins is not None:
            found |= {statistic.name: statistic.of(margins) for statistic in problem.margins}
        violations = {FAILED: float(1 - done.mean())}
        for constraint in self.prepared.constraints if constraints is None else constraints:
            margin, value = problem.margin(constraint) if tuning else 0.0, found.get(constraint.statistic.name)
            violation = 0.0 if value is None else constraint.violation(value, margin)
            violations[constraint.label] = max(violation, self._overwhelmed(constraint, result, scenarios, row))
        return Evaluation(
            candidate=candidate,
            objectives=tuple(found[statistic.name] for statistic in problem.objectives),
            violations=violations,
            statistics=found,
            outcomes=dict(Counter(outcomes.tolist())),
            scenarios=len(outcomes),
            pruned=pruned,
            units=self._units,
        )

    @staticmethod
    def _overwhelmed(
        constraint: Constraint, result: BatchResult, scenarios: Sequence[Experiment | Scenario], row: int
    ) -> float:
        """By how much a bound is exceeded in overwhelming scenarios beyond what may be there; -inf without any."""
        beyond = worst_of(row_of(result, row), [constraint], scenarios)[0, leeways(scenarios) > 0]
        return float(beyond[np.isfinite(beyond)].max(initial=-math.inf))
