"""The result of a tuning study, as data and in sentences, the same on the terminal and in the report."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.paper_controller import adapted
from dualwinch.model.quantities.quantity import behind_number
from dualwinch.model.quantities.tables import page, readable_unit, section, table
from dualwinch.simulation.analysis.authority import infeasible_words
from dualwinch.simulation.analysis.remarks import amplitude_remarks, delay_remarks, loop_remarks
from dualwinch.simulation.analysis.resonance import RESONANCE
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.page import GivenAxes
from dualwinch.tuning.baseline import assumptions, swings
from dualwinch.tuning.constraints import LATE
from dualwinch.tuning.plots import history, short
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import EXEMPT
from dualwinch.tuning.scoring.progress import SearchStatus
from dualwinch.tuning.scoring.ranking import Evaluation, feasibility_first
from dualwinch.tuning.scoring.rollouts import run_pairs
from dualwinch.tuning.scoring.test_set import SelectionResult
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.selection_config import SelectionConfig, default_method
from dualwinch.tuning.space import ContinuousDimension, Point


@dataclass(frozen=True)
class TuningCost:
    """What a study took.

    Attributes:
        rollouts: of this process, choice and score included.
        judging_rollouts: those of choice and score.
        rollout_seconds: wall time in s they took.
        preparing, searching, judging: wall time in s of the parts.
        overhead: share of the search's time that was not spent in rollouts.
        margin_seconds: wall time in s that stability margins took, in all parts.
        compiling: wall time in s of sources and compilers, in all parts; next to none once they are in the cache.
    """

    rollouts: int
    rollout_seconds: float
    preparing: float
    searching: float
    judging: float
    overhead: float
    margin_seconds: float = 0.0
    compiling: float = 0.0
    judging_rollouts: int = 0

    @property
    def mostly_judging(self) -> str:
        """How many rollouts choice and score took, where those are more than the search's; else empty."""
        judging = self.judging_rollouts
        return f"{judging} of them for choosing and scoring" if 2 * judging > self.rollouts else ""

    @property
    def seconds(self) -> float:
        """Wall time in s of all parts."""
        return self.preparing + self.searching + self.judging


@dataclass(frozen=True, repr=False)
class TuningResult:
    """The result of a tuning study; it has a representation for a prompt and for a notebook.

    Attributes:
        training: what was tuned, with training scenarios and bounds.
        method: name of the optimiser.
        trials: every finished trial, in order.
        verdict: the chosen gains and their score beside that of the start and of the paper's gains.
        progress: of the search.
        cost: number of rollouts and times.
        interrupted: whether an interrupt (Ctrl-C) ended the search.
        seconds: time of the search that was asked for, in s; ``None``: none was.
    """

    training: TrainingSet
    method: str
    trials: tuple[Evaluation, ...]
    verdict: SelectionResult
    progress: SearchStatus
    cost: TuningCost
    interrupted: bool
    seconds: float | None = None

    @property
    def problem(self) -> TuningProblem:
        """What was tuned."""
        return self.training.problem

    @property
    def repaired(self) -> dict[str, tuple[float, float]]:
        """Gains of the best that were repaired in validation → their values in the search, and now."""
        best = self.verdict.best
        was = next((trial.point for trial in self.trials if trial.number == best.number), best.point)
        return {name: (float(was[name]), float(now)) for name, now in best.point.items() if now != was[name]}

    @property
    def best(self) -> Experiment:
        """The experiment with the best gains."""
        return self.problem.tuned(self.verdict.best.point)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is wrong with the best's loop on the nominal machine: instabilities, and too little further delay."""
        return *self.instabilities, *self._late

    @cached_property
    def instabilities(self) -> tuple[str, ...]:
        """How the best's loop is unstable on the nominal machine, in motion, too, if no margin is bounded.

        Where drums swing none can be bounded on every machine yet, and none is advised.
        """
        found = list(loop_remarks(self.best))
        if amplitudes := self._amplitudes:
            advice = "" if swings(self.best.plant) else "--constraint 'worst.disk_margin>=0.4' keeps such gains out"
            found += amplitude_remarks(self.best, amplitudes, advice)
        return tuple(found)

    @cached_property
    def _late(self) -> tuple[str, ...]:
        return tuple(delay_remarks(self.best, LATE)) if self._amplitudes else ()

    @property
    def _amplitudes(self) -> tuple[float, ...]:
        """Amplitudes in m/s at which a loop without a bounded margin is looked at."""
        bounded = {statistic.margin for statistic in self.problem.margins} - {RESONANCE}
        return () if bounded else self.problem.selection.margin_amplitudes

    @cached_property
    def idle(self) -> frozenset[str]:
        """Gains at a bound that change nothing: with each amid its range the training runs come to the same figures.

        They are looked for around the best; where the start is kept, around the best that was searched for.
        """
        space, searched = self.problem.space, _searched(self)
        point = searched[0] if searched and not self.verdict.improved else self.verdict.best.point
        ended = [each for each in space.dimensions if isinstance(each, ContinuousDimension) and _bound(each, point)]
        if not ended:
            return frozenset()
        moved = [point | {dimension.name: dimension.decoded(0.5)} for dimension in ended]
        runs = run_pairs(space.keys, [space.parameters(each) for each in (point, *moved)], self.training.scenarios)
        if not runs.completed[0].any():
            return frozenset()
        metrics = np.stack(list(runs.metrics.values()))
        return frozenset(
            dimension.name
            for row, dimension in enumerate(ended, 1)
            if np.allclose(metrics[:, row], metrics[:, 0], rtol=NOTHING, atol=0.0, equal_nan=True)
        )

    @property
    def gains(self) -> dict[str, Any]:
        """Every tuned key of the best and its value."""
        return self.problem.space.settings(self.verdict.best.point)

    def plot(self, *, ax: GivenAxes = None) -> Figure:
        """Draw the history of the search: the first objective of every trial, and the best so far.

        Args:
            ax: axes for it; default: a figure of its own.
        """
        return history(self.problem, self.trials, ax=ax)

    def __repr__(self) -> str:
        return f"TuningResult({'; '.join(filter(None, (worth(self), headline(self), authority(self))))})"

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        headings, rows = statistics_table(self)
        words = [
            headline(self),
            tested(self),
            endings(self),
            *self.remarks,
            authority(self),
            widen(self),
            too_short(self),
            *self.problem.choices,
            *contenders(self),
        ]
        gains = [[key, f"{value:.6g}" if isinstance(value, float) else str(value)] for key, value in self.gains.items()]
        return page(
            worth(self),
            ". ".join(filter(None, words)),
            section("statistics", table(headings, rows, numbers=range(1, len(headings) - 1)), is_open=True),
            section("tuned gains", table(["key", "value"], gains, numbers=(1,)), is_open=True),
        )


EDGE = 0.02
"""Share of a range at either end in which a gain is said to lie at its bound."""

NOTHING = 1e-3
"""Change of a figure of merit, as a share of it, that is none."""

LEADING = 3
"""Trials that tell whether a gain lies at its bound."""

SCORE_NAMES = {"best": "best", "start": "start", "paper": "paper"}
"""Name of a score in a verdict → what it is called."""


def headings(tuned: TuningResult) -> dict[str, str]:
    """Name of each score that says something different → its heading in a table."""
    verdict = tuned.verdict
    names = {name: SCORE_NAMES[name] for name in verdict.shown}
    if not verdict.improved:
        names["best"] = "start, kept" if "paper" in names else "start = paper, kept"
    elif verdict.start_is_papers:
        names["paper"] = "start = paper"
    return names


def statistics_table(tuned: TuningResult) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of every statistic: the best's, the start's and the paper's, and the best over the paper's."""
    verdict, columns = tuned.verdict, headings(tuned)
    compared = ["best / paper"] if "paper" in columns else []
    rows = []
    for name, value in verdict.scored.statistics.items():
        theirs = verdict.statistics("paper")[name]
        ratio = [number(value / theirs, 3) if theirs > 0 <= value else "" for _ in compared]
        values = [number(verdict.statistics(column)[name], 4) for column in columns]
        rows.append([name, *values, *ratio, readable_unit(tuned.problem.units[name])])
    return ["", *columns.values(), *compared, ""], rows


def number(value: float, digits: int = 6) -> str:
    """A number in so many digits; a dash where no run has it."""
    return "–" if np.isnan(value) else f"{value:.{digits}g}"


def where(tuned: TuningResult) -> str:
    """Where the best was scored; how many scenarios that were."""
    if not tuned.verdict.has_test_set:
        return "in the tuned experiment"
    all_sizes, sizes = tuned.problem.selection.sizes, tuned.verdict.sizes
    fewer = f" ({all_sizes.test} with more time)" if sizes.test < all_sizes.test else ""
    return f"in {tuned.verdict.scored.scenarios} test scenarios{fewer}"


def headline(tuned: TuningResult) -> str:
    """Which trial is the best, or why the start is kept; and where that was scored."""
    best, trials = tuned.verdict.best, len(tuned.trials)
    count = f"{trials} trial{'s' * (trials != 1)}"
    if tuned.verdict.improved:
        changed = [f"{name} changed from {was:.4g} to {now:.4g}" for name, (was, now) in tuned.repaired.items()]
        having = f", with {' and '.join(changed)}," if changed else ""
        words = f"trial {best.number} of {trials}{having} is the best; scored {where(tuned)}"
        return f"{words}; {tuned.verdict.contradiction}" if tuned.verdict.contradiction else words
    return f"the start is kept: {tuned.verdict.obstacle} ({count}); scored {where(tuned)}"


def instability(tuned: TuningResult) -> str:
    """How the best's loop is unstable on the nominal machine, in a few words; empty where it is stable."""
    words = next(iter(tuned.instabilities), "").partition(":")[0]
    return f"the loop with these gains is {words}" if words.startswith("unstable") else words


def worth(tuned: TuningResult) -> str:
    """What was gained, whether the loop is unstable, what is violated, with which probability, on which assumptions."""
    verdict = tuned.verdict
    gained = comparison(tuned)
    if not verdict.improved:
        gained = f"no improvement: the start is kept{'' if verdict.start_is_papers else f', {gained}'}"
    if verdict.contradiction:
        gained = f"{verdict.contradiction}: {gained}"
    scored = verdict.scored
    broken = [
        f"{constraint.label} ({number(scored.statistics[constraint.statistic.name], 3)})"
        for constraint in verdict.constraints
        if scored.violations[constraint.label] > 0
    ]
    violated = [f"violates {', '.join(broken)}"] if broken else []
    chance = [verdict.chance.words] if verdict.chance else []
    words = [gained, instability(tuned), *violated, *chance, assumptions(tuned.problem.ensemble)]
    return "; ".join(filter(None, words))


def tested(tuned: TuningResult) -> str:
    """The test set's mean of the first objective, and its share of violations, with intervals; empty without one."""
    verdict, objective = tuned.verdict, tuned.problem.objectives[0]
    if not verdict.has_test_set:
        return ""
    level, words = tuned.problem.selection.confidence, list[str]()
    if objective.kind == "mean" and (mean := verdict.mean_interval(objective.metric, level)):
        words.append(
            f"{objective.name} = {mean[0]:.4g} ({mean[1]:.4g} to {mean[2]:.4g}){behind_number(objective.unit)}"
        )
    low, high = verdict.violation_interval(level)
    words.append(
        f"{verdict.test_violations} of {verdict.scored.scenarios} scenarios violate a bound on the worst case "
        f"({100 * low:.3g} to {100 * high:.3g} %)"
    )
    return f"test set, with {100 * level:g} % intervals: {'; '.join(words)}"


def contenders(tuned: TuningResult) -> list[str]:
    """What the best is compared with: what stands under each heading."""
    start = controller_in_words(tuned.problem.experiment.controller)
    paper = controller_in_words(tuned.problem.paper_experiment.controller)
    own = adapted(tuned.problem.paper_experiment.controller)
    words = [f"paper: {paper} with the paper's gains{own and f', and the {own} of the start'}"]
    return words if tuned.verdict.start_is_papers else [f"start: {start} as it was before tuning", *words]


def margin_places(tuned: TuningResult) -> list[str]:
    """Where each bounded stability margin is the worst: the best's, and the paper's."""
    verdict, words = tuned.verdict, headings(tuned)
    return [
        f"{statistic.name} ({words[name]}): {attained.words}"
        for statistic in tuned.problem.margins
        for name in verdict.shown
        if (attained := verdict.scores[name].attained.get(statistic.name))
    ]


def endings(tuned: TuningResult) -> str:
    """How the best's runs ended where it is scored."""
    scored = tuned.verdict.scored
    if scored.scenarios == 1:
        return next(iter(scored.outcomes)).replace("_", " ")
    return ", ".join(
        f"{count} of {scored.scenarios} {word.replace('_', ' ')}" for word, count in scored.outcomes.items()
    )


def controller_in_words(controller: Controller) -> str:
    """Law, estimator and coordination of a controller."""
    estimator = controller.estimator.kind
    filtered = "no estimator" if estimator == "none" else f"estimator {estimator}"
    return f"{controller.law.kind} ({filtered}, {controller.coordination.kind})"


def comparison(tuned: TuningResult) -> str:
    """How the first objective of the best compares with the paper's, and with the start's.

    Where test scenarios are infeasible, first in the feasible ones, by which the best was chosen.
    """
    verdict, objective = tuned.verdict, tuned.problem.objectives[0]
    others = {"paper": "the paper's"} | ({"start": "the start's"} if "start" in verdict.shown else {})

    def compared(*, feasible: bool) -> str:
        ratios = [
            times(verdict.improvement(objective.name, over, feasible=feasible), whose) for over, whose in others.items()
        ]
        return " and ".join(ratios)

    words, within, every = f"{objective.name} is {compared(feasible=True)}", verdict.feasible, verdict.scored.scenarios
    if within in (0, every) or objective.kind == "worst":
        return words
    return f"{words} in the {within} feasible test scenarios ({compared(feasible=False)} in all {every})"


def times(ratio: float, whose: str) -> str:
    """A ratio of theirs to ours in words: how many times lower ours is, or how many times theirs, if that is worse."""
    if not (ratio > 0 and np.isfinite(ratio)):
        return f"not comparable with {whose}"
    if f"{ratio:.3g}" == "1":
        return f"as large as {whose}"
    return f"{_digits(ratio)} times lower than {whose}" if ratio > 1 else f"{_digits(1 / ratio)} × {whose} (worse)"


def _digits(ratio: float) -> str:
    """Three digits, without an exponent, thousands apart."""
    rounded = float(f"{ratio:.3g}")
    return f"{rounded:,.0f}".replace(",", " ") if rounded >= 100 else f"{rounded:.3g}"


def authority(tuned: TuningResult) -> str:
    """How many of the test scenarios are infeasible; empty for none."""
    beyond = tuned.verdict.scored.scenarios - tuned.verdict.feasible
    return infeasible_words(beyond) if beyond and tuned.verdict.has_test_set else ""


def advice(tuned: TuningResult) -> list[str]:
    """What would help where the start is kept or the best breaks a constraint; empty where there is no need."""
    verdict, problem = tuned.verdict, tuned.problem
    if verdict.improved and verdict.scored.feasible:
        return []
    found: list[str] = []
    wanted = problem.selection.trials_needed(len(problem.space.dimensions))
    if len(tuned.trials) < wanted:
        found.append(f"more trials (--time, --trials, --resume): {wanted} or more for this many gains")
    if hardest := _hardest(tuned):
        found.append(f"a looser bound (--constraint): {hardest}")
    if at_bounds := _at_bounds(tuned):
        found.append(f"wider bounds (--space): the best trials lie at those of {', '.join(at_bounds)}")
    if tuned.method != (usual := default_method(len(problem.objectives))):
        found.append(f"another method (--method {usual})")
    return found or ["another start (--set), another seed (--seed), or more gains (--space)"]


def too_short(tuned: TuningResult) -> str:
    """What the search lacks, where it had fewer trials than so many gains need; empty where it had enough."""
    config, gains = tuned.problem.selection, len(tuned.problem.space.dimensions)
    rollouts = tuned.progress.spent if tuned.progress.share else None
    return short_of(len(tuned.trials), gains, config, tuned.cost.searching if tuned.seconds else None, rollouts)


def short_of(
    trials: int, gains: int, config: SelectionConfig, seconds: float | None, rollouts: int | None = None
) -> str:
    """What a search lacks, in words.

    Args:
        trials: that it had.
        gains: that it searched for.
        config: says how many trials a gain needs.
        seconds: time in s that it took, where that was its budget.
        rollouts: that it had, where that was its budget.
    """
    wanted = config.trials_needed(gains)
    if trials >= wanted:
        return ""
    more = f"--trials {wanted}"
    if seconds is not None:
        more = f"--time {_duration(seconds * wanted / trials)}"
    elif rollouts is not None:
        more = f"--rollouts {math.ceil(rollouts * wanted / trials / 500) * 500}"
    return f"a short search: {trials} trials, and {gains} gains need about {wanted}: {more}"


def _duration(seconds: float) -> str:
    """A time that `--time` takes, rounded up."""
    return f"{math.ceil(seconds / 60):.0f}min" if seconds >= 90 else f"{math.ceil(seconds / 5) * 5:.0f}s"


def gains_at_bounds(tuned: TuningResult) -> list[tuple[str, float]]:
    """Gains of the best that lie at a bound of the search and do something there, and that bound."""
    return [
        (dimension.name, bound)
        for dimension in tuned.problem.space.dimensions
        if tuned.verdict.improved
        and isinstance(dimension, ContinuousDimension)
        and (bound := _bound(dimension, tuned.verdict.best.point))
        and dimension.name not in tuned.idle
    ]


def _bound(dimension: ContinuousDimension, point: Point) -> float:
    """The bound at which a gain lies; 0 where it lies at none, or at 0, where nothing can be wider."""
    share = dimension.encoded(point[dimension.name])
    return dimension.upper if share >= 1 - EDGE else dimension.lower if share <= EDGE else 0.0


def _searched(tuned: TuningResult) -> list[Point]:
    """The points that the search has found, the best first."""
    searched = [trial for trial in tuned.trials if trial.candidate.origin not in EXEMPT]
    return [searched[index].point for index in feasibility_first(searched)]


def widen(tuned: TuningResult) -> str:
    """Gains of the best that end at a bound of the search, by name and bound; empty where there are none."""
    at_bounds = ", ".join(f"{name} ({bound:.4g})" for name, bound in gains_at_bounds(tuned))
    return f"gains end at a bound of the search (--space); widen: {at_bounds}" if at_bounds else ""


def _hardest(tuned: TuningResult) -> str:
    """The constraint that most of the complete trials break, where hardly any satisfies all."""
    whole = [trial for trial in tuned.trials if not trial.pruned]
    if sum(trial.feasible for trial in whole) > len(whole) // 10:
        return ""
    counts = {
        constraint.label: sum(trial.violations[constraint.label] > 0 for trial in whole)
        for constraint in tuned.training.constraints
    }
    label = max(counts, key=lambda name: counts[name], default="")
    return f"{counts[label]} of {len(whole)} complete trials break {label}" if label and counts[label] else ""


def _at_bounds(tuned: TuningResult) -> list[str]:
    """Gains that lie at a bound in all of the best trials that the search has found, and do something there."""
    points = _searched(tuned)[:LEADING]
    return [
        short(dimension.name)
        for dimension in tuned.problem.space.dimensions
        if isinstance(dimension, ContinuousDimension)
        and len(points) == LEADING
        and all(_bound(dimension, point) for point in points)
        and dimension.name not in tuned.idle
    ]
