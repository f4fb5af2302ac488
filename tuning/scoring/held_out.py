"""Scenarios that neither a search nor the choice of the best saw, and what controllers come to there."""

from collections.abc import Sequence

from dualwinch.simulation.analysis.worst_margins import MarginSurvey
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.bounds import bounds_in
from dualwinch.tuning.scoring.evaluation import Candidate
from dualwinch.tuning.scoring.machines import machine_name
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.verdict import Attained, Score


class HeldOut:
    """Draws of a problem's ensemble of their own, or its experiment.

    Attributes:
        scenarios: what is run.
        constraints: with bounds that are numbers there.
        paper: what the paper's controller comes to.
    """

    def __init__(self, scorer: Scorer, count: int, seed: int) -> None:
        """Draw so many scenarios, and run the paper's controller in them."""
        problem, self._scorer = scorer.prepared.problem, scorer
        self.scenarios = problem.drawn(count, seed)
        self._machines = scorer.survey(self.scenarios)
        with_paper = problem.drawn(count, seed, problem.paper_experiment)
        result = scorer.run(None, with_paper)
        self.constraints = bounds_in(scorer.prepared, result, with_paper)
        machines = scorer.survey(with_paper, problem.paper_experiment)
        self.paper = self._scored(Candidate({}, "paper"), result, with_paper, machines)

    def score(self, candidate: Candidate) -> Score:
        """What a candidate comes to."""
        return self._scored(candidate, self._scorer.run([candidate], self.scenarios), self.scenarios, self._machines)

    def _scored(
        self,
        candidate: Candidate,
        result: BatchResult,
        scenarios: Sequence[Experiment | Scenario],
        machines: MarginSurvey | None,
    ) -> Score:
        scorer = self._scorer
        (margins,) = scorer.margins([candidate], machines)
        evaluation = scorer.judged(candidate, result, scenarios, margins=margins, constraints=self.constraints)
        if not (margins and machines):
            return Score(evaluation, result)
        names = {statistic.margin: statistic.name for statistic in scorer.prepared.problem.margins}
        attained = {
            names[kind]: Attained(worst, machine_name(machines.machines[worst.machine]))
            for kind, worst in margins.items()
        }
        return Score(evaluation, result, attained)
