"""The training set of a tuning problem: a sample average approximation with common random numbers.

Every candidate is run in the same scenarios (Shapiro, Dentcheva and Ruszczyński, Lectures on Stochastic Programming,
2009, Chapter 5):

1. Typical draws, for means: draws are divided into equal strata by authority ratio, the required force over the force
   that the actuators deliver; the median draw of each stratum is used. The mean of a few random draws is poor, because
   a draw that needs nearly all the force outweighs the others.
2. Hard draws, for the worst case: the draws with the largest authority ratio. If force is short, the vehicle falls
   behind and must recover without a peak or a slack rope; how far it falls behind does not depend on gains
   (`simulation.analysis.authority`).
3. Vertices, for the worst case: all values deviate at once, each by its standard deviation with a random sign. Of twice
   the number of vertices, those within the actuators' authority are used.

Every candidate is run in a few of the hard scenarios, the active ones (`ActiveScenarios`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.margin_survey import MarginSurvey, WorstMargin
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.batch.authority import ForceDemand, force_demands
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.batch.workers import Workers, map_all, threads_of
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import TRAINING, TuningProblem
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.progress import DRAWING, NO_PROGRESS, REFERENCES, TuningProgress
from dualwinch.tuning.scoring.rollouts import over, run_pairs, worst_of
from dualwinch.tuning.selection_config import SelectionConfig

AnyScenario = TypeVar("AnyScenario", bound=Experiment | Scenario)


Floats = NDArray[np.float64]


def nominal_hardware(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Draws of one ensemble with every error of the machine and its sensors set to 0 (`Mark.UNKNOWN`).

    Disturbance, noise, outages, lags and the plant's uncertain parameters stay.
    """
    if not scenarios:
        return []
    first = scenarios[0]
    values = leaves(first.base)
    errors = {
        key: 0.0
        for key, leaf in describe_parts(first.base).items()
        if Mark.UNKNOWN in leaf.marks and Mark.SHAPE_PARAMETER not in leaf.marks and (key in first.draws or values[key])
    }
    base = with_leaves(first.base, errors)
    return [
        replace(scenario, base=base, draws={key: value for key, value in scenario.draws.items() if key not in errors})
        for scenario in scenarios
    ]


def training_scenarios(
    ensemble: Ensemble, count: int, seed: int, config: SelectionConfig
) -> tuple[list[Scenario], list[Scenario]]:
    """Typical and hard scenarios of an ensemble, alternating: the common ones, and the further hard ones of the pool.

    Of the `count` common scenarios half are hard, and of these half draws and half vertices.
    """
    more, number, few = config.hard_training, count // 2, count // 4
    further = round(config.share_vertices * more)
    corners = vertices(ensemble, few + further, seed)
    draws = ensemble.chosen(range(max(config.demand_among, count + more)), seed)
    demands = force_demands(draws)
    typical = _typical(draws, demands, count - number)
    others = {scenario.index for scenario in typical}
    # the hard draws: those with the largest authority ratio, but last those that fall too far behind
    waiting = [index for index in range(len(draws)) if index not in others]
    waiting.sort(key=lambda index: (demands[index].shortfall > config.largest_lag, -demands[index].share))
    hardest = [replace(draws[index], hard=True) for index in waiting[: number + more]]
    hard = _alternating(hardest[: number - few], corners[:few])
    more_draws = hardest[number - few :][: more - further]
    return _alternating(typical, hard), _alternating(more_draws, corners[few:])


def _alternating(*kinds: Sequence[Scenario]) -> list[Scenario]:
    """The scenarios of several kinds, alternating."""
    longest = max(map(len, kinds), default=0)
    return [kind[place] for place in range(longest) for kind in kinds if place < len(kind)]


def _typical(draws: Sequence[Scenario], demands: Sequence[ForceDemand], count: int) -> list[Scenario]:
    """The median draw of each of `count` equal strata by authority ratio.

    Two of three are on nominal hardware: there the error depends on the gains, and hardly on what a filter must learn.
    The gains with the best mean over bad machines may be mediocre on a good one.
    """
    order = sorted(range(len(demands)), key=lambda index: demands[index].share)
    medians = [draws[order[int((stratum + 0.5) / count * len(order))]] for stratum in range(count)]
    exact = nominal_hardware(medians)
    return [exact[number] if number % 3 else median for number, median in enumerate(medians)]


def vertices(ensemble: Ensemble, count: int, seed: int) -> list[Scenario]:
    """Vertices of the box of draws: of twice `count`, those within authority, then those least beyond it."""
    corners = ensemble.chosen(range(2 * count), seed, vertex=True)
    demands = force_demands(corners)
    order = sorted(range(len(demands)), key=lambda index: demands[index].shortfall)
    return [replace(corners[index], hard=True) for index in order[:count]]


def validation_draws(scenarios: Sequence[Scenario], config: SelectionConfig) -> list[Scenario]:
    """The draws in which the vehicle falls behind by at most `largest_lag`, infeasible ones as hard ones.

    All draws, as they are, if all are infeasible.
    """
    demands = force_demands(scenarios)
    feasible = np.array([demand.share <= 1 for demand in demands], bool)
    near = np.array([demand.shortfall <= config.largest_lag for demand in demands], bool) | ~feasible.any()
    return list(compress(infeasible_as_hard(scenarios, feasible), near))


def infeasible_as_hard(scenarios: Sequence[AnyScenario], feasible: NDArray[np.bool_]) -> list[AnyScenario]:
    """The scenarios, those beyond the actuators' authority as hard ones, which count in the worst case only.

    There the vehicle falls behind; the lag is most of the error and hardly depends on gains. If all scenarios are
    infeasible, none is marked, and an experiment without draws never is. `feasible` is (scenarios,).
    """
    return [
        replace(scenario, hard=True) if isinstance(scenario, Scenario) and not within else scenario
        for scenario, within in zip(scenarios, feasible | ~feasible.any(), strict=True)
    ]


def survey(
    problem: TuningProblem,
    scenarios: Sequence[Experiment | Scenario],
    workers: Workers = None,
    *,
    experiment: Experiment | None = None,
) -> MarginSurvey | None:
    """Survey of the machines on which stability margins are computed; ``None`` if no margin is bounded.

    These are the nominal machine and the first `SelectionConfig.margin_machines_validated` drawn ones, vertices before
    draws. An `experiment` has another controller in place of the problem's, with fixed gains.
    """
    if not problem.margins:
        return None
    drawn = [scenario for scenario in scenarios if isinstance(scenario, Scenario)]
    drawn.sort(key=lambda scenario: not scenario.vertex)
    taken = drawn[: problem.selection.margin_machines_validated]
    keys, machines = () if experiment else problem.space.keys, [experiment or problem.experiment, *taken]
    return MarginSurvey(machines, keys, threads_of(workers), amplitudes=problem.margin_amplitudes)


def hardest_machines(
    problem: TuningProblem, scenarios: Sequence[Experiment | Scenario], workers: Workers = None
) -> list[int]:
    """Indices of the scenarios with the machines on which the start has the least bounded margins.

    Computed at the largest amplitude only, on which the selection hardly depends, in two stages: all machines at the
    points where the nominal machine has the least of each kind; then the machines with the least margins there, at all
    points.
    """
    drawn = [index for index, scenario in enumerate(scenarios) if isinstance(scenario, Scenario)]
    if not (problem.margins and drawn):
        return []
    machines = [problem.experiment, *(scenarios[index] for index in drawn)]
    largest = problem.margin_amplitudes[-1:]
    surveyed = MarginSurvey(machines, problem.space.keys, threads_of(workers), amplitudes=largest)
    kinds, start = [statistic.margin for statistic in problem.margins], [problem.space.parameters(problem.start)]
    (nominal,) = surveyed.of_loops(start, kinds, np.flatnonzero(surveyed.loops[:, 0] == 0))
    hardest = {min(range(len(nominal)), key=lambda point: nominal[point][kind].value) for kind in nominal[0]} or {0}
    counts = np.bincount(surveyed.loops[:, 0])[surveyed.loops[:, 0]]
    looked_at = (counts != len(nominal)) | np.isin(surveyed.loops[:, 1], list(hardest))
    chosen = _least_first(surveyed, kinds, start, np.flatnonzero(looked_at & (surveyed.loops[:, 0] > 0)))
    some = np.isin(surveyed.loops[:, 0], chosen[: problem.selection.margin_machines_screened])
    chosen = _least_first(surveyed, kinds, start, np.flatnonzero(some))
    return [drawn[machine - 1] for machine in chosen[: problem.margin_machines]]


def _least_first(
    surveyed: MarginSurvey, kinds: Sequence[str], values: Sequence[Sequence[float]], loops: NDArray[np.intp]
) -> list[int]:
    """The machines of given loops in ascending order of margin, relative to the least of its kind on any machine.

    Machines with equal margins, such as vertices that differ only in irrelevant values, appear once.
    """
    numbers = np.unique(surveyed.loops[loops, 0]).tolist()
    (found,) = surveyed.each(values, kinds, loops)
    least = {kind: min(of[kind].value for of in found) for kind in kinds}
    order = sorted(
        range(len(found)), key=lambda at: min(found[at][kind].value / (least[kind] or 1.0) for kind in kinds)
    )
    chosen: dict[tuple[str, ...], int] = {}
    for at in order:
        chosen.setdefault(tuple(f"{found[at][kind].value:.9g}" for kind in kinds), numbers[at])
    return list(chosen.values())


@dataclass(frozen=True)
class TrainingSet:
    """A tuning problem with its training scenarios.

    Attributes:
        problem: the tuning problem.
        scenarios: in which every candidate is run: typical and hard ones of the ensemble, or the experiment.
        hard: further hard ones of the pool, for the best candidates; none without an ensemble.
        constraints: the problem's, with bounds as numbers.
        paper: runs of the baseline controller in `scenarios`, one row.
        start: runs of the start in `scenarios`, one row.
        margins: survey of the machines for every candidate's stability margins; ``None``: none is bounded.
        workers: for other computations in the scenarios.
        pace: wall time of a rollout in s, without compilation.
    """

    problem: TuningProblem
    scenarios: tuple[Experiment | Scenario, ...]
    hard: tuple[Experiment | Scenario, ...]
    constraints: tuple[Constraint, ...]
    paper: BatchResult
    start: BatchResult
    margins: MarginSurvey | None = None
    workers: Workers = None
    pace: float = 0.0


def prepare(
    problem: TuningProblem,
    workers: Workers = None,
    watch: TuningProgress = NO_PROGRESS,
    ahead: Callable[[Experiment | Scenario], None] | None = None,
) -> TrainingSet:
    """Draw the training scenarios of a problem, and run the baseline controller and the start in them.

    This also compiles the rollouts and the margins of a search, in parallel, and, by `ahead`, what else the search
    calls, for scenarios like the given one. `watch` gets both phases.
    """
    watch.phase(DRAWING)
    scenarios: Sequence[Experiment | Scenario] = [problem.experiment]
    hard: Sequence[Scenario] = []
    if problem.ensemble is not None:
        ensemble = replace(problem.ensemble, experiment=problem.experiment)
        scenarios, hard = training_scenarios(ensemble, problem.scenarios, problem.stream(TRAINING), problem.selection)
    watch.phase(REFERENCES)
    run_paper = partial(run_pairs, [], [[]], _with_paper(problem, scenarios), workers)
    run_start = partial(run_pairs, problem.space.keys, [problem.space.parameters(problem.start)], scenarios, workers)
    compiling: list[Callable[[], Any]] = [partial(ahead, scenarios[0])] if ahead else []  # takes longest
    survey_of = partial(MarginSurvey, threads=threads_of(workers), amplitudes=problem.margin_amplitudes)
    if problem.bounds_loop_margins:
        compiling.append(survey_of([problem.experiment]).compile)
    *_, start, paper = map_all(lambda call: call(), [*compiling, run_start, run_paper], threads_of(workers))
    began = clock.without_compiling()
    run_start()  # timed; the first call also loads libraries
    pace = (clock.without_compiling() - began) / len(scenarios)
    hardest = hardest_machines(problem, [*scenarios, *hard], workers)
    bounds = []
    for constraint in problem.constraints:
        reached = 0.0
        if isinstance(constraint.statistic, Statistic):
            reached = over(constraint.statistic, paper, 0, scenarios)
        elif constraint.of_paper:
            with_paper = _with_paper(problem, [*scenarios, *hard])
            machines = [problem.paper_experiment, *(with_paper[index] for index in hardest)]
            chosen = machines if problem.ensemble else machines[:1]
            reached = constraint.statistic.of(survey_of(chosen).worst([[]])[0])
        bounds.append(constraint.given(reached))
    return TrainingSet(
        problem=problem,
        scenarios=tuple(scenarios),
        hard=tuple(hard),
        constraints=tuple(bounds),
        paper=paper,
        start=start,
        margins=survey(problem, [[*scenarios, *hard][index] for index in hardest], workers),
        workers=workers,
        pace=pace,
    )


def _with_paper(problem: TuningProblem, scenarios: Sequence[Experiment | Scenario]) -> list[Experiment | Scenario]:
    """The scenarios with the paper's controller; those with the same base still share one."""
    paper = problem.paper_experiment
    machines = {id(each.base): each.base for each in scenarios if isinstance(each, Scenario)}
    bases = {key: replace(machine, controller=paper.controller) for key, machine in machines.items()}
    return [replace(each, base=bases[id(each.base)]) if isinstance(each, Scenario) else paper for each in scenarios]


class ActiveScenarios:
    """A pool of active scenarios (cutting set): the hard scenarios with the largest violations of the best candidates.

    Gains that violate a bound mostly do so in the same few scenarios, which change during the search; with fixed
    scenarios the search would favour gains that satisfy the bounds only there. For each hard scenario, the largest
    violation of the best candidates is smoothed exponentially. The hardest scenarios are run for every candidate
    (`common`), the next ones for the best candidates (`active`), and the others (`inactive`) occasionally.
    """

    def __init__(self, training: TrainingSet) -> None:
        self._all = [*training.scenarios, *training.hard]
        self._order = np.arange(len(self._all))
        self._common = len(training.scenarios)
        self._constraints, self._config = training.constraints, training.problem.selection
        self._hard = np.array([isinstance(scenario, Scenario) and scenario.hard for scenario in self._all])
        self._worst = np.full(len(self._all), self._config.pool_range[0])

    def _ordered(self, first: int, last: int | None) -> tuple[Experiment | Scenario, ...]:
        return tuple(self._all[index] for index in self._order[first:last])

    @property
    def common(self) -> tuple[Experiment | Scenario, ...]:
        """Scenarios for every candidate, typical and hard ones alternating."""
        return self._ordered(0, self._common)

    @property
    def active(self) -> tuple[Experiment | Scenario, ...]:
        """The next hardest scenarios, for the best candidates."""
        return self._ordered(self._common, self._common + self._config.pool_size)

    @property
    def inactive(self) -> tuple[Experiment | Scenario, ...]:
        """The remaining hard ones."""
        return self._ordered(self._common + self._config.pool_size, None)

    def learn(self, results: Sequence[RunOutcomes]) -> None:
        """Update from results of one row each, in the common, active and possibly inactive scenarios, in order."""
        if not results:
            return
        places = self._order[: results[0].outcomes.shape[1]]
        values = np.array([worst_of(result, self._constraints)[0] for result in results])
        mean, memory = values.clip(*self._config.pool_range).mean(axis=0), self._config.pool_memory
        self._worst[places] = memory * self._worst[places] + (1 - memory) * mean
        hard_places = self._hard[self._order]
        hard = self._order[hard_places]
        self._order[hard_places] = hard[np.argsort(-self._worst[hard], kind="stable")]


class ActiveLoops:
    """The active loops of a margin survey (active set): the points of least margin of the machines of least margin.

    Margins at neighbouring points are similar, and the point of least margin hardly depends on the gains; nor do, less
    so, the machines. Two ratios are smoothed exponentially over gains with margins known in all loops, for each kind of
    margin: of each loop's margin to the least of its machine and amplitude, and of that to the least of all.
    """

    def __init__(self, surveyed: MarginSurvey, kinds: Sequence[str], config: SelectionConfig) -> None:
        """Set up; all loops are active until `learn` is called. `kinds` are without that of the drums' resonance."""
        self._kinds, self._memory, self._largest = tuple(kinds), config.pool_memory, config.loop_range
        groups, self._groups = np.unique(surveyed.loops[:, [0, 2]], axis=0, return_inverse=True)
        self._groups = self._groups.ravel()
        self._active = (1 + config.margin_machines_active) * len(np.unique(groups[:, 1]))
        self._nearness: NDArray[np.float64] | None = None
        self._nearness_of_groups: NDArray[np.float64] | None = None

    def learn(self, margins: Sequence[Mapping[str, WorstMargin]]) -> None:
        """Update from the margins of every loop with given gains."""
        values = np.nan_to_num([[of_loop[kind].value for kind in self._kinds] for of_loop in margins])  # some infinite
        least = np.array([values[self._groups == group].min(axis=0) for group in range(int(self._groups.max()) + 1)])
        self._nearness = self._smoothed(values, least[self._groups], self._nearness)
        self._nearness_of_groups = self._smoothed(least, least.min(axis=0), self._nearness_of_groups)

    def _smoothed(self, values: Floats, least: Floats, before: Floats | None) -> Floats:
        """Ratios of values to the least ones, clipped and smoothed."""
        ratios = np.minimum(values / np.maximum(least, np.finfo(float).tiny), self._largest)
        return ratios if before is None else self._memory * before + (1 - self._memory) * ratios

    @property
    def indices(self) -> NDArray[np.intp]:
        """Indices of the active loops, in ascending order."""
        nearness, of_groups, chosen = self._nearness, self._nearness_of_groups, set[int]()
        if nearness is None or of_groups is None:
            return np.arange(len(self._groups))
        for group in of_groups.min(axis=1).argsort(kind="stable")[: self._active]:
            mine = np.flatnonzero(self._groups == group)
            chosen.update(mine[nearness[mine].argmin(axis=0)].tolist())
        return np.array(sorted(chosen), dtype=np.intp)
