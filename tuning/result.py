"""The result of a tuning study, as data and as the sentences that terminal and report share."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from dualwinch.analysis.large_signal import LargeSignalStability
from dualwinch.analysis.remarks import delay_remarks, loop_notes, stability_of
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.paper_controller import adapted
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import behind_number
from dualwinch.model.quantities.tables import page, readable_unit, section, table
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.page import GivenAxes
from dualwinch.tuning.baseline import SWINGING, assumptions, undamped
from dualwinch.tuning.constraints import LATE
from dualwinch.tuning.options import TuningOptions, default_method
from dualwinch.tuning.plots import history, short
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import EXEMPT
from dualwinch.tuning.scoring.progress import SearchStatus
from dualwinch.tuning.scoring.ranking import Evaluation, feasibility_first
from dualwinch.tuning.scoring.rollouts import run_pairs
from dualwinch.tuning.scoring.test_set import SelectionResult
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.space import EDGE, ContinuousDimension, Point


@dataclass(frozen=True)
class TuningCost:
    """Rollouts and wall times of a study.

    Attributes:
        rollouts: of this process, selection and scoring included.
        judging_rollouts: of selection and scoring.
        rollout_seconds: wall time in s of the rollouts.
        preparing, searching, judging: wall time in s of the phases; judging is selection and scoring.
        overhead: share of the search's time outside of rollouts.
        margin_seconds: wall time in s of stability margins, in all phases.
        compiling: wall time in s of code generation and compilation, in all phases; almost none with a warm cache.
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
        """Number of rollouts of selection and scoring, in words, if they are the majority; else empty."""
        judging = self.judging_rollouts
        return f"{judging} of them for choosing and scoring" if 2 * judging > self.rollouts else ""

    @property
    def seconds(self) -> float:
        """Wall time in s of all phases."""
        return self.preparing + self.searching + self.judging


@dataclass(frozen=True, repr=False)
class TuningResult:
    """The result of a tuning study; it has a representation for a prompt and for a notebook.

    Attributes:
        training: the problem with its training scenarios and bounds.
        method: name of the optimiser.
        trials: every finished trial, in order.
        verdict: the selected gains, and the scores of these, the start and the paper's gains.
        progress: of the search.
        cost: number of rollouts and times.
        interrupted: whether an interrupt (Ctrl-C) ended the search.
        seconds: time budget of the search in s; ``None``: it had none.
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
        """The tuning problem."""
        return self.training.problem

    @property
    def best(self) -> Experiment:
        """The experiment with the best gains."""
        return self.problem.tuned(self.verdict.best.point)

    @property
    def supported(self) -> bool:
        """Whether the best satisfies every bound; in an ensemble by a certificate, not contradicted by the test set."""
        verdict, certificate = self.verdict, self.verdict.certificate
        return certificate.satisfied and not verdict.contradiction if certificate else verdict.scored.feasible

    @property
    def remarks(self) -> tuple[str, ...]:
        """Deficiencies of the best's loop on the nominal machine, and constraints that bound nothing."""
        return *self.instabilities, *self._late, *self._unbounded

    @cached_property
    def instabilities(self) -> tuple[str, ...]:
        """Instabilities of the best's loop on the nominal machine; else up to which speed error it is stable."""
        return tuple(loop_notes(self.best))

    @cached_property
    def large_signal(self) -> LargeSignalStability | None:
        """Range of speed errors in which the best's loop is stable on the nominal machine."""
        return stability_of(self.best)

    @cached_property
    def _late(self) -> tuple[str, ...]:
        return () if self.problem.bounds_loop_margins else tuple(delay_remarks(self.best, LATE))

    @property
    def _unbounded(self) -> tuple[str, ...]:
        pairs = zip(self.problem.constraints, self.training.constraints, strict=True)
        texts = [constraint.text for constraint, bound in pairs if constraint.reference and bound.unbounded]
        return (f"no reference run completes; without effect: {', '.join(texts)}",) if texts else ()

    @cached_property
    def idle(self) -> frozenset[str]:
        """Gains at a bound without effect: training runs have the same metrics with the gain amid its range.

        Evaluated at the best point; where the start is kept, at the best point of the search.
        """
        space, searched = self.problem.space, _search_points(self)
        point = searched[0] if searched and not self.verdict.improved else self.verdict.best.point
        ended = [
            each for each in space.dimensions if isinstance(each, ContinuousDimension) and _bound(self, each, point)
        ]
        if not ended:
            return frozenset()
        neighbours = [point | {dimension.name: dimension.decoded(0.5)} for dimension in ended]
        runs = run_pairs(space.keys, [space.parameters(each) for each in (point, *neighbours)], self.training.scenarios)
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
            ax: axes to draw in; default: a new figure.
        """
        return history(self.problem, self.trials, ax=ax)

    def __repr__(self) -> str:
        return f"TuningResult({'; '.join(filter(None, (worth(self), headline(self), authority(self))))})"

    def _repr_html_(self) -> str:
        """HTML for a notebook."""
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


NOTHING = 1e-3
"""Relative change of a metric below which it counts as unchanged."""

LEADING = 3
"""Number of best trials that must all lie at a gain's bound."""


def headings(tuned: TuningResult) -> dict[str, str]:
    """Name of each distinct score → its heading in a table."""
    verdict = tuned.verdict
    names = {name: name for name in verdict.shown}
    if not verdict.improved:
        names["best"] = "start, kept" if "paper" in names else "start = paper, kept"
    elif verdict.start_is_papers:
        names["paper"] = "start = paper"
    return names


def statistics_table(tuned: TuningResult) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of all statistics: the best's, the start's, the paper's, and the ratio of best to paper."""
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
    """A number to `digits` significant digits; a dash for NaN."""
    return "–" if np.isnan(value) else f"{value:.{digits}g}"


def where(tuned: TuningResult) -> str:
    """Where the best was scored: the number of test scenarios, or the tuned experiment."""
    if not tuned.verdict.has_test_set:
        return "in the tuned experiment"
    return f"in {tuned.verdict.scored.scenarios} test scenarios"


def headline(tuned: TuningResult) -> str:
    """The number of the best trial, or why the start is kept; where it was scored, and on which conditions it holds."""
    best, trials = tuned.verdict.best, len(tuned.trials)
    scored = f"scored {where(tuned)}; {assumptions(tuned.problem.ensemble)}"
    if tuned.verdict.improved:
        return f"trial {best.number} of {trials} is the best; {scored}"
    return f"the start is kept: {tuned.verdict.obstacle} ({trials} trial{'s' * (trials != 1)}); {scored}"


def instability(tuned: TuningResult) -> str:
    """The best's first instability on the nominal machine in a few words; empty if it is stable at small amplitudes."""
    words, stability = next(iter(tuned.instabilities), "").partition(":")[0], tuned.large_signal
    if words.startswith("unstable"):
        return f"the loop with these gains is {words}{stability.cycle_words if stability else ''}"
    return "" if words.startswith("stable") else words


def worth(tuned: TuningResult) -> str:
    """What was gained, what is certified, what was not examined, and what is violated, in a sentence each."""
    return " ".join(f"{sentence[:1].upper()}{sentence[1:]}." for sentence in _worth(tuned) if sentence)


def _worth(tuned: TuningResult) -> Iterator[str]:
    verdict = tuned.verdict
    if not verdict.improved:
        yield "no improvement: the start is kept"
    if verdict.improved or not verdict.start_is_papers:
        yield comparison(tuned)
    yield from verdict.certificate.sentences if verdict.certificate else ()
    yield unexamined(tuned)
    yield from _violations(tuned)
    yield verdict.contradiction
    yield instability(tuned)


def _violations(tuned: TuningResult) -> Iterator[str]:
    """Bounds that the best violates where it was scored: those on the worst case, with a test set; and the others."""
    verdict, kinds = tuned.verdict, ("run", "mean", "margin")
    if verdict.has_test_set and (bounds := _violated(tuned, "run")):
        count, kinds = verdict.test_violations, ("mean", "margin")
        verb = "violates" if count == 1 else "violate"
        yield f"{count} of {verdict.scored.scenarios} test scenarios {verb} a bound: {bounds}"
    if bounds := _violated(tuned, *kinds):
        yield f"{where(tuned)} the {'best' if verdict.improved else 'start'} violates {bounds}"


def _violated(tuned: TuningResult, *kinds: str) -> str:
    """Bounds of some kinds (`Constraint.kind`) that the best violates where it was scored, with its values."""
    scored = tuned.verdict.scored
    return ", ".join(
        f"{constraint.label} ({number(scored.statistics[constraint.statistic.name], 4)})"
        for constraint in tuned.verdict.constraints
        if constraint.kind in kinds and scored.violations[constraint.label] > 0
    )


def unexamined(tuned: TuningResult) -> str:
    """How many candidates that rank before the start were not examined, if the best is not certified; else empty."""
    verdict = tuned.verdict
    if not verdict.certificate or verdict.certificate.satisfied or not verdict.unexamined:
        return ""
    budget = "time" if tuned.seconds else "rollouts"
    candidates = "1 more candidate was" if verdict.unexamined == 1 else f"{verdict.unexamined} more candidates were"
    return f"in the training set {candidates} better than the start, but not examined for lack of {budget}"


def tested(tuned: TuningResult) -> str:
    """Mean of the first objective and share of violations on the test set, with intervals; empty without a test set."""
    verdict, objective = tuned.verdict, tuned.problem.objectives[0]
    if not verdict.has_test_set:
        return ""
    level, words = tuned.problem.options.confidence, list[str]()
    if mean := verdict.mean_interval(objective, level):
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
    """The controllers that the best is compared with, as explanations of the headings."""
    start = controller_in_words(tuned.problem.experiment.controller)
    paper = controller_in_words(tuned.problem.paper_experiment.controller)
    adaptation = adapted(tuned.problem.paper_experiment.controller)
    words = [f"paper: {paper} with the paper's gains{adaptation and f', and the {adaptation} of the start'}"]
    return words if tuned.verdict.start_is_papers else [f"start: {start} {tuned.problem.start_words}", *words]


def margin_places(tuned: TuningResult) -> list[str]:
    """Where each bounded stability margin is smallest, with each score's controller."""
    verdict, words = tuned.verdict, headings(tuned)
    return [
        f"{statistic.name} ({words[name]}): {attained.words}"
        for statistic in tuned.problem.margins
        for name in verdict.shown
        if (attained := verdict.scores[name].attained.get(statistic.name))
    ]


def endings(tuned: TuningResult) -> str:
    """Outcomes of the best's scored runs, with their counts."""
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
    """The best's first objective in comparison with the paper's and the start's.

    If test scenarios are infeasible, over the feasible ones, by which the best was chosen; `authority` has all.
    """
    verdict, objective = tuned.verdict, tuned.problem.objectives[0]
    within, every = verdict.feasible_scenarios, verdict.scored.scenarios
    words = f"{objective.name} is {ratios(tuned, feasible=True)}"
    if within in (0, every) or objective.kind == "worst":
        return words
    return f"{words} in the {within} test scenarios within the motors' authority"


def ratios(tuned: TuningResult, *, feasible: bool) -> str:
    """The best's first objective against the paper's and the start's, in all test scenarios or the feasible ones."""
    verdict, objective = tuned.verdict, tuned.problem.objectives[0]
    references = {"paper": "the paper's"} | ({"start": "the start's"} if "start" in verdict.shown else {})
    return " and ".join(
        times(verdict.improvement(objective.name, over, feasible=feasible), whose) for over, whose in references.items()
    )


def times(ratio: float, whose: str) -> str:
    """A ratio of theirs to ours in words: the factor by which ours is lower, or its multiple of theirs if worse."""
    if not (ratio > 0 and np.isfinite(ratio)):
        return f"not comparable with {whose}"
    if _digits(max(ratio, 1 / ratio)) == "1":
        return f"as large as {whose}"
    return f"{_digits(ratio)} times lower than {whose}" if ratio > 1 else f"{_digits(1 / ratio)} × {whose} (worse)"


def _digits(ratio: float) -> str:
    """Three digits, without an exponent, thousands separated by a space."""
    rounded = float(f"{ratio:.3g}")
    return f"{rounded:,.0f}".replace(",", " ") if rounded >= 100 else f"{rounded:.3g}"


def authority(tuned: TuningResult) -> str:
    """Number of test scenarios beyond the motors' authority, and the comparison with them, in words; or empty."""
    verdict, share = tuned.verdict, tuned.problem.options.authority
    infeasible, objective = verdict.scored.scenarios - verdict.feasible_scenarios, tuned.problem.objectives[0]
    if not infeasible or not verdict.has_test_set:
        return ""
    verb = "demands" if infeasible == 1 else "demand"
    words = f"{infeasible} of the scenarios {verb} more than {100 * share:g} % of the motors' force"
    return f"{words}: no gains keep up there; with them {objective.name} is {ratios(tuned, feasible=False)}"


def advice(tuned: TuningResult) -> list[str]:
    """Remedies if the start is kept, or the best is not supported; else empty."""
    verdict, problem = tuned.verdict, tuned.problem
    if verdict.improved and tuned.supported:
        return []
    remedies: list[str] = []
    if undamping := undamped(problem.experiment):
        remedies.append(f"damping of the drums (--set): {' and '.join(undamping)} = 0, though {SWINGING}")
    trials = problem.options.trials_needed(len(problem.space.dimensions))
    if len(tuned.trials) < trials:
        remedies.append(f"more trials (--time, --trials, --resume): {trials} or more for this many gains")
    if hardest := _hardest(tuned):
        remedies.append(f"a looser bound (--constraint): {hardest}")
    if at_bounds := _at_bounds(tuned):
        remedies.append(f"wider bounds (--space): the best trials lie at those of {', '.join(at_bounds)}")
    if tuned.method != (usual := default_method(len(problem.objectives))):
        remedies.append(f"another method (--method {usual})")
    return remedies or ["another start (--set), another seed (--seed), or more gains (--space)"]


def too_short(tuned: TuningResult) -> str:
    """Remark on a search with fewer trials than its gains need, with the budget it needs; else empty."""
    config, gains = tuned.problem.options, len(tuned.problem.space.dimensions)
    rollouts = tuned.progress.spent if tuned.progress.share else None
    return short_of(len(tuned.trials), gains, config, tuned.cost.searching if tuned.seconds else None, rollouts)


def short_of(trials: int, gains: int, config: TuningOptions, seconds: float | None, rollouts: int | None = None) -> str:
    """Remark on a search with fewer trials than its gains need, with the budget it needs; else empty.

    `seconds`, in s, or `rollouts` are what the search took, if they were its budget.
    """
    trials_needed = config.trials_needed(gains)
    if trials >= trials_needed:
        return ""
    option = f"--trials {trials_needed}"
    if seconds is not None:
        option = f"--time {_duration(seconds * trials_needed / trials)}"
    elif rollouts is not None:
        option = f"--rollouts {math.ceil(rollouts * trials_needed / trials / 500) * 500}"
    return f"a short search: {trials} trials, and {gains} gains need about {trials_needed}: {option}"


def _duration(seconds: float) -> str:
    """A time in the format of `--time`, rounded up."""
    return f"{math.ceil(seconds / 60):.0f}min" if seconds >= 90 else f"{math.ceil(seconds / 5) * 5:.0f}s"


def gains_at_bounds(tuned: TuningResult) -> list[tuple[str, float]]:
    """Gains of the best that lie at a bound of the search and have an effect, each with that bound."""
    return [
        (dimension.name, bound)
        for dimension in tuned.problem.space.dimensions
        if tuned.verdict.improved
        and isinstance(dimension, ContinuousDimension)
        and (bound := _bound(tuned, dimension, tuned.verdict.best.point))
        and dimension.name not in tuned.idle
    ]


def _bound(tuned: TuningResult, dimension: ContinuousDimension, point: Point) -> float:
    """The bound at which a gain lies; 0 if it lies at none, or at one that cannot be widened."""
    share = dimension.encoded(point[dimension.name])
    bound = dimension.upper if share >= 1 - EDGE else dimension.lower if share <= EDGE else 0.0
    return 0.0 if bound in describe_parts(tuned.problem.experiment)[dimension.keys[0]].bounds else bound


def _search_points(tuned: TuningResult) -> list[Point]:
    """The points of the search, the best first."""
    searched = [trial for trial in tuned.trials if trial.candidate.origin not in EXEMPT]
    return [searched[index].point for index in feasibility_first(searched)]


def widen(tuned: TuningResult) -> str:
    """Remark on gains of the best at a bound of the search, with those bounds; empty if there are none."""
    at_bounds = ", ".join(f"{name} ({bound:.4g})" for name, bound in gains_at_bounds(tuned))
    return f"gains end at a bound of the search (--space); widen: {at_bounds}" if at_bounds else ""


def _hardest(tuned: TuningResult) -> str:
    """The constraint that most complete trials violate, if at most one in ten satisfies all; else empty."""
    complete = [trial for trial in tuned.trials if not trial.pruned]
    if sum(trial.feasible for trial in complete) > len(complete) // 10:
        return ""
    counts = {
        constraint.label: sum(trial.violations[constraint.label] > 0 for trial in complete)
        for constraint in tuned.training.constraints
    }
    label = max(counts, key=lambda name: counts[name], default="")
    return f"{counts[label]} of {len(complete)} complete trials violate {label}" if label and counts[label] else ""


def _at_bounds(tuned: TuningResult) -> list[str]:
    """Gains with an effect that lie at a bound in all of the search's `LEADING` best trials."""
    points = _search_points(tuned)[:LEADING]
    return [
        short(dimension.name)
        for dimension in tuned.problem.space.dimensions
        if isinstance(dimension, ContinuousDimension)
        and len(points) == LEADING
        and all(_bound(tuned, dimension, point) for point in points)
        and dimension.name not in tuned.idle
    ]
