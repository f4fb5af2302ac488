"""Scenarios on a machine that is what its data sheets say."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle, islice

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.analysis.authority import ForceDemand, force_demand
from dualwinch.simulation.analysis.margin_survey import MarginSurvey
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.batch.threads import map_all
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.progress import DRAWING, REFERENCES, SILENT, TuningProgress
from dualwinch.tuning.scoring.rollouts import over, run_pairs, worst_of


def nominal_hardware(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Draws of one ensemble with every error of the machine and its sensors set to 0 (`Mark.UNKNOWN`).

    Everything else stays: what acts on the vehicle, noise, silence, lags, and plants that data sheets tell roughly.
    """
    if not scenarios:
        return []
    first = scenarios[0]
    values = leaves(first.base)
    errors = {
        key: 0.0
        for key, leaf in describe_parts(first.base).items()
        if Mark.UNKNOWN in leaf.marks and Mark.COURSE not in leaf.marks and (key in first.draws or values[key])
    }
    base = with_leaves(first.base, errors)
    return [
        replace(scenario, base=base, draws={key: value for key, value in scenario.draws.items() if key not in errors})
        for scenario in scenarios
    ]


def every_second_nominal(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Draws of one ensemble, the second, fourth, ... on machines without errors."""
    found = list(scenarios)
    found[1::2] = nominal_hardware(found[1::2])
    return found


LOOKED_AT = 600
"""Draws that are looked at."""

FURTHEST = 0.01
"""How far in m the vehicle falls behind at most in hard draws. There are few in which it falls behind further."""

BEHIND = (0.025, 0.015, 0.035)
"""How far in m it falls behind in overwhelming vertices: as in the hardest of some hundreds of draws, not further."""

BEYOND_SHARE, VERTEX_SHARE = 1 / 3, 1 / 6
"""Shares of further hard scenarios that are overwhelming vertices, and vertices that the motors can hold.

Which of those that overwhelm are hard is much the same for all good gains, but hardly depends on how far the vehicle
falls behind.
"""


@dataclass(frozen=True)
class ScenarioChoice:
    """A scenario to be: number `index` of the ensemble's draws, or of the vertices of the box of draws.

    Attributes:
        index: the number.
        vertex: whether it is a vertex.
        hard: whether it counts in what is the worst only.
        beyond_authority: whether it is harder than any draw (`beyond_authority`).
        exact: whether machine and sensors are without errors (`tuning.scoring.training_set`).
    """

    index: int
    vertex: bool = False
    hard: bool = False
    beyond_authority: bool = False
    nominal_hardware: bool = False


def drawn(picks: Sequence[ScenarioChoice], ensemble: Ensemble, seed: int) -> list[Scenario]:
    """The scenarios of picks, in their order."""
    found: dict[ScenarioChoice, Scenario] = {}
    for vertex, perfect in ((False, False), (False, True), (True, False)):
        alike = [picked for picked in picks if (picked.vertex, picked.nominal_hardware) == (vertex, perfect)]
        chosen = ensemble.chosen([picked.index for picked in alike], seed, vertex=vertex)
        chosen = nominal_hardware(chosen) if perfect else chosen
        marked = (
            replace(scenario, hard=picked.hard, beyond_authority=picked.beyond_authority)
            for picked, scenario in zip(alike, chosen, strict=True)
        )
        found |= zip(alike, marked, strict=True)
    return [found[picked] for picked in picks]


def chosen_scenarios(
    ensemble: Ensemble, count: int, more: int, seed: int
) -> tuple[list[ScenarioChoice], list[ScenarioChoice]]:
    """Scenarios of an ensemble, typical and hard ones in turns.

    Args:
        ensemble: what is drawn from.
        count: how many; half of them hard, of these again half draws and half vertices, the last an overwhelming one.
        more: how many further hard ones: draws, overwhelming vertices and others.
        seed: of the draws.

    Returns:
        The scenarios, and the further hard ones.
    """
    number, few = count // 2, count // 4
    further = round(VERTEX_SHARE * more)
    corners = vertices(ensemble, few + further, seed)
    beyond = beyond_authority(ensemble, seed, corners, 1 + round(BEYOND_SHARE * more)) if few else []
    held = few - len(beyond[:1])
    demands = _demands(ensemble.chosen(range(max(LOOKED_AT, count + more)), seed))
    plain = typical_draws(demands, count - number)
    draws = hardest_draws(demands, number + more, {picked.index for picked in plain})
    ours = _in_turns(draws[: number - few], [*corners[:held], *beyond[:1]])
    more_corners = corners[held:][:further]
    more_draws = draws[number - few :][: more - len(beyond[1:]) - len(more_corners)]
    return _in_turns(plain, ours), _in_turns(more_draws, beyond[1:], more_corners)


def _in_turns(*kinds: Sequence[ScenarioChoice]) -> list[ScenarioChoice]:
    """One of each kind, again and again, for as long as there are any."""
    longest = max(map(len, kinds), default=0)
    return [kind[place] for place in range(longest) for kind in kinds if place < len(kind)]


def typical_draws(demands: Sequence[ForceDemand], count: int) -> list[ScenarioChoice]:
    """Draws that stand for all: those in the middle of as many equal shares, by the force that they ask for.

    Two of three are on machines without errors. There gains differ in their own errors alone, and hardly in what a
    filter has to learn; those that are best in the mean of bad machines may be mediocre on a good one.
    """
    order = sorted(range(len(demands)), key=lambda index: demands[index].share)
    middles = (order[int((share + 0.5) / count * len(order))] for share in range(count))
    return [ScenarioChoice(index, nominal_hardware=number % 3 > 0) for number, index in enumerate(middles)]


def hardest_draws(demands: Sequence[ForceDemand], count: int, others: set[int]) -> list[ScenarioChoice]:
    """Draws that ask for the most force, without those too hard (`FURTHEST`) and without some others."""
    waiting = [index for index in range(len(demands)) if index not in others]
    waiting.sort(key=lambda index: (demands[index].shortfall > FURTHEST, -demands[index].share))
    return [ScenarioChoice(index, hard=True) for index in waiting[:count]]


def hardest_among(ensemble: Ensemble, count: int, among: range, seed: int) -> list[ScenarioChoice]:
    """The hardest of some draws, given by their numbers (`hardest_draws`)."""
    demands = _demands(ensemble.chosen(among, seed))
    return [replace(picked, index=among[picked.index]) for picked in hardest_draws(demands, count, set())]


def vertices(ensemble: Ensemble, count: int, seed: int) -> list[ScenarioChoice]:
    """Vertices of the box of draws: of twice as many the first that the motors can hold, then the least too hard."""
    demands = _demands(ensemble.chosen(range(2 * count), seed, vertex=True))
    order = sorted(range(len(demands)), key=lambda index: demands[index].shortfall)
    return [ScenarioChoice(index, vertex=True, hard=True) for index in order[:count]]


def beyond_authority(
    ensemble: Ensemble, seed: int, others: Sequence[ScenarioChoice], count: int = len(BEHIND)
) -> list[ScenarioChoice]:
    """Vertices in which the vehicle falls behind by about `BEHIND` in turns, without some others; fewer if need be."""
    demands = _demands(ensemble.chosen(range(LOOKED_AT), seed, vertex=True))
    taken = {picked.index for picked in others}
    waiting = [index for index, asked in enumerate(demands) if asked.shortfall > FURTHEST and index not in taken]
    found: list[int] = []
    for wanted in islice(cycle(BEHIND), min(count, len(waiting))):
        found.append(min(waiting, key=lambda index: abs(demands[index].shortfall - wanted)))
        waiting.remove(found[-1])
    return [ScenarioChoice(index, vertex=True, hard=True, beyond_authority=True) for index in found]


def within_selection(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """The scenarios in which gains are chosen: where the vehicle falls behind by no more than `FURTHEST`.

    Where it falls behind at all, that is most of the error, and hardly depends on gains: such count as hard ones.
    """
    demands = _demands(scenarios)
    kept = [
        replace(scenario, hard=asked.share > 1)
        for scenario, asked in zip(scenarios, demands, strict=True)
        if asked.shortfall <= FURTHEST
    ]
    return kept if any(not scenario.hard for scenario in kept) else list(scenarios)


def _demands(scenarios: Sequence[Scenario]) -> list[ForceDemand]:
    return map_all(lambda scenario: force_demand(scenario.experiment), scenarios)


HARDEST = 2
"""Drawn machines on which every candidate is looked at: those on which the start has the least margins."""

MACHINES = 32
"""Drawn machines on which candidates are looked at where they are chosen and scored, vertices first."""


def survey(
    problem: TuningProblem,
    scenarios: Sequence[Experiment | Scenario],
    threads: int | None = None,
    *,
    experiment: Experiment | None = None,
) -> MarginSurvey | None:
    """The nominal machine and those of some scenarios; ``None`` where no margin is bounded.

    Args:
        problem: says what is bounded and what varies.
        scenarios: drawn machines, `MACHINES` of which are taken.
        threads: default: one a core.
        experiment: with another controller than the problem's, whose gains do not vary.
    """
    if not problem.margins:
        return None
    machines = [experiment or problem.experiment, *taken(scenarios)]
    return MarginSurvey(machines, () if experiment else problem.space.keys, threads)


def taken(scenarios: Sequence[Experiment | Scenario]) -> list[Scenario]:
    """The scenarios whose machines are looked at: the first `MACHINES`, vertices before draws."""
    drawn = [scenario for scenario in scenarios if isinstance(scenario, Scenario)]
    return sorted(drawn, key=lambda scenario: not scenario.vertex)[:MACHINES]


def hardest_machines(
    problem: TuningProblem, scenarios: Sequence[Experiment | Scenario], threads: int | None = None
) -> list[int]:
    """Indices of the scenarios on whose machines the start has the least margins, of any kind that is bounded."""
    drawn = [index for index, scenario in enumerate(scenarios) if isinstance(scenario, Scenario)]
    if not (problem.margins and drawn):
        return []
    looked_at = MarginSurvey([scenarios[index] for index in drawn], problem.space.keys, threads)
    kinds = [statistic.margin for statistic in problem.margins]
    (found,) = looked_at.each([problem.space.parameters(problem.start)], kinds)
    least = {kind: min(of[kind].value for of in found) for kind in kinds}
    nearness = [min(of[kind].value / (least[kind] or 1.0) for kind in kinds) for of in found]
    order = sorted(range(len(drawn)), key=lambda index: nearness[index])
    chosen: dict[tuple[str, ...], int] = {}
    for index in order:  # vertices may differ in what no margin depends on: one of such twins is enough
        chosen.setdefault(tuple(f"{found[index][kind].value:.9g}" for kind in kinds), drawn[index])
    return list(chosen.values())[:HARDEST]


def machine_name(machine: Experiment | Scenario) -> str:
    """What a machine is called."""
    if not isinstance(machine, Scenario):
        return "the nominal machine"
    return f"{'vertex' if machine.vertex else 'draw'} {machine.index}"


STRESS = 48
"""Number of the further hard scenarios; the best candidates are tried in the hardest of them."""


@dataclass(frozen=True)
class TrainingSet:
    """A problem with all that evaluating a candidate takes.

    Attributes:
        problem: what is tuned.
        scenarios: what every candidate is tried in, the same for all: typical and hard ones of the ensemble, or the
            experiment.
        stress: further hard ones, where the best of the candidates have to hold; none without an ensemble.
        constraints: the problem's, every bound a number.
        paper: the paper's controller in `scenarios`, one row.
        start: the start in `scenarios`, one row.
        margins: the machines on which stability margins of every candidate are looked at; ``None``: none is bounded.
    """

    problem: TuningProblem
    scenarios: tuple[Experiment | Scenario, ...]
    stress: tuple[Experiment | Scenario, ...]
    constraints: tuple[Constraint, ...]
    paper: BatchResult
    start: BatchResult
    margins: MarginSurvey | None = None


def prepare(problem: TuningProblem, threads: int | None = None, watch: TuningProgress = SILENT) -> TrainingSet:
    """Draw the scenarios of a problem, and run the paper's controller and the start in them.

    What the search will call is compiled by then.

    Args:
        problem: what is tuned.
        threads: default: one a core.
        watch: told of both phases.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    watch.phase(DRAWING)
    picks, more = _picks(problem)
    scenarios = _drawn(problem, picks, problem.experiment)
    watch.phase(REFERENCES)
    paper = run_pairs([], [[]], _drawn(problem, picks, problem.paper_experiment), threads)
    start = run_pairs(problem.space.keys, [problem.space.parameters(problem.start)], scenarios, threads)
    stress = _drawn(problem, more, problem.experiment) if more else ()
    hardest = hardest_machines(problem, [*scenarios, *stress], threads)
    bounds = []
    for constraint in problem.constraints:
        reached = 0.0
        if isinstance(constraint.statistic, Statistic):
            reached = over(constraint.statistic, paper, 0, scenarios)
        elif constraint.of_paper:
            drawn = _drawn(problem, [*picks, *more], problem.paper_experiment)
            machines = [problem.paper_experiment, *(drawn[index] for index in hardest)]
            worst = MarginSurvey(machines if problem.ensemble else machines[:1], threads=threads).worst([[]])[0]
            reached = constraint.statistic.of(worst)
        bounds.append(constraint.given(reached))
    return TrainingSet(
        problem=problem,
        scenarios=scenarios,
        stress=stress,
        constraints=tuple(bounds),
        paper=paper,
        start=start,
        margins=survey(problem, [[*scenarios, *stress][index] for index in hardest], threads),
    )


def _picks(problem: TuningProblem) -> tuple[list[ScenarioChoice], list[ScenarioChoice]]:
    """Which scenarios candidates are tuned in, and in which further ones the best of them."""
    if problem.ensemble is None:
        return [], []
    ensemble = replace(problem.ensemble, experiment=problem.experiment)
    return chosen_scenarios(ensemble, problem.scenarios, STRESS, problem.seed)


def _drawn(
    problem: TuningProblem, picks: Sequence[ScenarioChoice], experiment: Experiment
) -> tuple[Experiment | Scenario, ...]:
    if problem.ensemble is None:
        return (experiment,)
    ensemble = replace(problem.ensemble, experiment=experiment)
    return tuple(drawn(picks, ensemble, problem.seed))


Floats = NDArray[np.float64]

KEPT = 0.7
"""What remains of what is known of a scenario whenever some of the best have been tried in it again."""

FURTHER = 16
"""Number of the other hard scenarios, the hardest of them, in which the best are tried."""

WITHIN, BEYOND = -0.02, 0.1
"""Within and beyond its bound, as shares of it, one value is like another: neither near, or both failed."""


class ActiveScenarios:
    """The scenarios of a problem in the order in which they are worth trying.

    The typical ones and as many hard ones as there are in `TrainingSet.scenarios` are for every candidate. Of the
    others the hardest (`FURTHER`) are for the best, and the rest is for finding out whether it has become harder.
    """

    def __init__(self, prepared: TrainingSet) -> None:
        """Start with the scenarios as they were prepared."""
        self._all = [*prepared.scenarios, *prepared.stress]
        self._order = np.arange(len(self._all))
        self._common = len(prepared.scenarios)
        self._constraints = prepared.constraints
        self._hard = np.array([isinstance(scenario, Scenario) and scenario.hard for scenario in self._all])
        self._worst = np.full(len(self._all), WITHIN)

    @property
    def everyones(self) -> tuple[Experiment | Scenario, ...]:
        """What every candidate is tried in, typical and hard ones in turns."""
        return tuple(self._all[index] for index in self._order[: self._common])

    @property
    def further(self) -> tuple[Experiment | Scenario, ...]:
        """The hardest of the other hard ones (`FURTHER`)."""
        return tuple(self._all[index] for index in self._order[self._common :][:FURTHER])

    @property
    def rest(self) -> tuple[Experiment | Scenario, ...]:
        """The least hard ones."""
        return tuple(self._all[index] for index in self._order[self._common :][FURTHER:])

    def learn(self, results: Sequence[BatchResult]) -> None:
        """Learn from results, a row each, in everyone's scenarios, the further ones and maybe the rest, in order."""
        if not results:
            return
        places = self._order[: results[0].outcomes.shape[1]]
        met = [self._all[index] for index in places]
        values = np.array([worst_of(result, self._constraints, met)[0] for result in results]).clip(WITHIN, BEYOND)
        self._worst[places] = KEPT * self._worst[places] + (1 - KEPT) * values.mean(axis=0)
        hard_places = self._hard[self._order]
        hard = self._order[hard_places]
        self._order[hard_places] = hard[np.argsort(-self._worst[hard], kind="stable")]
