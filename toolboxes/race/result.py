"""The result of a race: laws with the best gains found on one budget, as table, text, JSON and figures."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from dualwinch.toolbox import batches, drawing, intervals, merit_statistics, merits, searching, tables
from dualwinch.toolboxes.race.comparison import LEAST_DIFFERENCE, RULE, ErrorRatio, PairComparison, holm, ratio_of
from dualwinch.toolboxes.race.entries import NO_OBSERVER, PAPER_LAW, RaceTerms, names
from dualwinch.toolboxes.race.scores import (
    COSTS,
    ERROR,
    BaselineScore,
    EntryResult,
    ScoredRuns,
    below_words,
    ratio_words,
    spaced,
)

HEADINGS = (
    "",
    f"error below the paper's ({100 * intervals.CONFIDENCE:g} %)",
    "RMS error, mm",
    "chatter, N",
    "load, N m",
    "constraints",
    "operations a sample",
    "does not differ from",
)
"""Headings of the table."""

MILLIMETRES = 1e3

WITHOUT_OBSERVER = "without observer"
"""Name of the paper's law without observer among its ablations."""

MEAN_ERROR = merit_statistics.Statistic("mean", ERROR)
"""Objective of the searches."""


@dataclass(frozen=True, repr=False)
class RaceResult:
    """Result of a race: laws tuned with the same number of rollouts, scored in the same scenarios, shown as a table.

    Attributes:
        terms: of the race.
        paper: score of the paper's gains, and lower bounds on the error.
        entries: the finished ones, one per search.
        remaining: number of entries that an interrupt left out.
    """

    terms: RaceTerms
    paper: BaselineScore
    entries: tuple[EntryResult, ...]
    remaining: int = 0

    @cached_property
    def names(self) -> dict[str, str]:
        """Key of each entry → its name, the same for all its searches."""
        return names([scored.entry for scored in self.entries])

    @cached_property
    def searches(self) -> dict[str, tuple[EntryResult, ...]]:
        """Key of an entry's first search → all its searches, in ascending order of error."""
        groups: dict[str, list[EntryResult]] = {}
        for scored in sorted(self.entries, key=self._order):
            groups.setdefault(scored.entry.group, []).append(scored)
        return {key: tuple(group) for key, group in groups.items()}

    @cached_property
    def by_key(self) -> dict[str, EntryResult]:
        """Key of each entry → its result."""
        return {scored.entry.key: scored for scored in self.entries}

    @cached_property
    def ratios(self) -> dict[str, ErrorRatio]:
        """Key of each entry → its errors over those of the paper's gains."""
        return {scored.entry.key: _ratio(scored.runs, self.paper.runs) for scored in self.entries}

    @cached_property
    def ranking(self) -> tuple[EntryResult, ...]:
        """The median search of every entry, in ascending order of error; entries with incomplete runs last.

        The median of an even number of searches is the worse of the two in the middle.
        """
        return tuple(sorted((group[len(group) // 2] for group in self.searches.values()), key=self._order))

    def _order(self, scored: EntryResult) -> tuple[int, float]:
        incomplete, ratio = int((~scored.runs.completed).sum()), self._estimate(scored)
        return incomplete, math.inf if math.isnan(ratio) else ratio

    def _estimate(self, scored: EntryResult) -> float:
        return self.ratios[scored.entry.key].interval.estimate

    @cached_property
    def pairs(self) -> tuple[PairComparison, ...]:
        """Comparisons of all pairs in the ranking, in its order."""
        couples = list(combinations(self.ranking, 2))
        ratios = [_ratio(entry_1.runs, entry_2.runs) for entry_1, entry_2 in couples]
        corrected = holm([ratio.p for ratio in ratios])
        return tuple(
            PairComparison(entry_1.entry.key, entry_2.entry.key, ratio, level, self._separated(entry_1, entry_2))
            for (entry_1, entry_2), ratio, level in zip(couples, ratios, corrected, strict=True)
        )

    def _separated(self, first: EntryResult, second: EntryResult) -> bool:
        orders, other_orders = (
            [self._order(search) for search in self.searches[scored.entry.group]] for scored in (first, second)
        )
        return max(orders) < min(other_orders) or max(other_orders) < min(orders)

    @property
    def search_spread(self) -> float:
        """Largest ratio of the errors of two searches of the same entry; 1 if each was tuned once."""
        groups = [[self._estimate(search) for search in group] for group in self.searches.values()]
        spans = [[ratio for ratio in group if math.isfinite(ratio)] for group in groups]
        return max((max(span) / min(span) for span in spans if span), default=1.0)

    def not_different(self, key: str) -> tuple[str, ...]:
        """Keys in the ranking that do not differ from `key`, by `RULE`."""
        return tuple(
            pair.second_key if pair.first_key == key else pair.first_key
            for pair in self.pairs
            if key in (pair.first_key, pair.second_key) and not pair.differ
        )

    def pair(self, first: str, second: str) -> PairComparison:
        """Comparison of two entries in either order; the ratio is of the first over the second."""
        comparison = next(pair for pair in self.pairs if {pair.first_key, pair.second_key} == {first, second})
        if comparison.first_key == first:
            return comparison
        ratio = _ratio(self.by_key[first].runs, self.by_key[second].runs)
        return replace(comparison, first_key=first, second_key=second, ratio=ratio)

    @property
    def heading(self) -> str:
        """The terms in one line."""
        terms = self.terms
        entries = f"{len(self.searches)} entr{'y' if len(self.searches) == 1 else 'ies'}"
        searches = len(self.entries)
        searches_text = f" in {searches} searches" if searches > len(self.searches) else ""
        return (
            f"{entries}{searches_text}, {terms.rollouts} rollouts of '{terms.ensemble}' each, "
            f"scored in {terms.test_scenarios} test scenarios, seed {terms.seed}"
        )

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Headings and rows: the entries in order of the ranking, then the paper's gains."""
        numbers = {scored.entry.key: str(rank) for rank, scored in enumerate(self.ranking, 1)}
        rows = []
        for scored in self.ranking:
            key = scored.entry.key
            equal = ", ".join(numbers[other] for other in self.not_different(key))
            name = f"{numbers[key]}. {self.names[key]}"
            rows.append([name, below_words(self.ratios[key].interval), *_cells(scored.runs), equal or "–"])
        return list(HEADINGS), [*rows, ["the paper's gains", "1 ×", *_cells(self.paper.runs), ""]]

    def notes(self) -> list[str]:
        """Explanations of the table."""
        words = [
            "Error: factor by which the mean square error is below that of the paper's gains, the geometric mean over "
            "the scenarios. " + RULE + " Load: root mean square of the motor torques."
        ]
        words += [f"Constraints of all searches: {'; '.join(self.terms.constraints) or 'none'}."]
        words += [self._lower_bound_words(), self._spread_words()]
        words += [
            f"{self.names[scored.entry.key]}: no trial was better than the gains that the search started from."
            for scored in self.ranking
            if not scored.search.improved
        ]
        if self.remaining:
            words.append(f"Interrupted: {self.remaining} entries remain; the same call continues with them.")
        return words

    def _spread_words(self) -> str:
        """Note on the influence of the search's seed."""
        if len(self.entries) == len(self.searches):
            return (
                "Each was tuned once: another seed of the search finds other gains. A law without one of its parts can "
                "hardly be better than the whole. `--searches 3` shows the spread."
            )
        return (
            "The median search of each is shown. Searches of the same entry, which differ only in their seed, are up "
            f"to a factor of {spaced(self.search_spread)} apart."
        )

    def _lower_bound_words(self) -> str:
        """Lower bounds on the error of any controller, without and with foresight."""
        bounds = self.paper.lower_bounds
        if not bounds.infeasible:
            return "The reference is feasible in all scenarios: an ideal controller could follow it exactly."
        causal, foresighted = ("–" if math.isnan(mean) else f"{_rms(mean):.3g}" for mean in bounds.means)
        words = (
            f"{batches.infeasible_words(bounds.infeasible)}. Lower bound on the RMS error: {causal} mm for a "
            f"non-anticipating optimal controller, {foresighted} mm with full foresight."
        )
        return " ".join(filter(None, (words, bounds.unknown_words)))

    def ablations(self) -> list[list[str]]:
        """The paper's law without each of its parts: the ablation, the ratio, and whether they differ."""
        complete = [scored for scored in self.ranking if scored.entry.law == PAPER_LAW and not scored.entry.variant]
        return [row for law in complete for row in self._ablated(law)]

    def _ablated(self, whole: EntryResult) -> list[list[str]]:
        parts = whole.entry.estimator, whole.entry.coordination
        keys = {
            scored.entry.variant or WITHOUT_OBSERVER: scored.entry.key
            for scored in self.ranking
            if (scored.entry.estimator, scored.entry.coordination) == parts
            and (scored.entry.law == NO_OBSERVER or (scored.entry.law == PAPER_LAW and scored.entry.variant))
        }
        if WITHOUT_OBSERVER in keys and len(keys) == 1 and not any(scored.entry.variant for scored in self.entries):
            return []
        pairs = {words: self.pair(key, whole.entry.key) for words, key in keys.items()}
        return [
            [words, ratio_words(pair.ratio.interval), "yes" if pair.differ else "no"] for words, pair in pairs.items()
        ]

    def stress_rows(self) -> list[list[str]]:
        """Least robustness margin of each entry, where computed: name, imperfection, size and violated limit."""
        return [
            [self.names[scored.entry.key], margin["label"], margin["size"], margin["violated"]]
            for scored in self.ranking
            for margin in (scored.stress or ())[:1]
        ]

    def search_rows(self) -> list[list[str]]:
        """Rows of all searches: name, factor below the paper's error, gains, trials, rollouts, time."""
        return [
            [
                self.names[search.entry.key],
                below_words(self.ratios[search.entry.key].interval),
                *map(str, (search.search.gains, search.search.trials, search.search.rollouts)),
                f"{search.search.seconds:.0f} s",
            ]
            for scored in self.ranking
            for search in self.searches[scored.entry.group]
        ]

    def __repr__(self) -> str:
        return "\n".join([f"Race: {self.heading}", "", tables.markdown(*self.table()), "", *self.notes()])

    def _repr_html_(self) -> str:
        """HTML for a notebook."""
        return tables.page("RaceResult", " ".join([f"{self.heading}.", *self.notes()]), tables.table(*self.table()))

    def plot(self, *, ax: drawing.GivenAxes = None) -> Figure:
        """Draw the ratios of errors to those of the paper's gains, with intervals, in order of the ranking.

        Args:
            ax: axes to draw into; default: a new figure.
        """
        return _figure(self, ax)

    def plot_fronts(self, *, ax: drawing.GivenAxes = None) -> Figure:
        """Draw the fronts of error against chatter and load, and lower bounds on the error.

        Args:
            ax: axes for chatter and load; default: a new figure.
        """
        return _fronts_figure(self, ax)

    def to_record(self) -> dict[str, Any]:
        """The complete result as plain data, with units; `docs/race.md` explains the names."""
        terms, (causal, foresighted) = self.terms, self.paper.lower_bounds.means
        metrics = {name: quantity.unit for name, quantity in merits.metric_quantities().items()}
        units = {"statistics": metrics, "lower_bounds": "m^2", "over_paper": "1", "times_below": "1", "seconds": "s"}
        units |= dict.fromkeys(("rms_error", "rms_without_foresight", "rms_with_foresight"), "m")
        return {
            **asdict(terms),
            "seeds": {"searches": terms.seed, "test": terms.test_seed},
            "rule": {"text": RULE, "confidence": intervals.CONFIDENCE, "least_difference": LEAST_DIFFERENCE},
            "lower_bounds": {
                "beyond_authority": self.paper.lower_bounds.infeasible,
                "without_bound": self.paper.lower_bounds.unknown,
                "without_foresight": causal,
                "with_foresight": foresighted,
                "rms_without_foresight": math.sqrt(causal),
                "rms_with_foresight": math.sqrt(foresighted),
            },
            "paper": self.paper.runs.to_record(),
            "entries": [self._entry(scored) for scored in self.ranking],
            "pairs": [
                {
                    "first": pair.first_key,
                    "second": pair.second_key,
                    **pair.ratio.to_record(),
                    "p_corrected": pair.corrected,
                    "separated": pair.separated,
                    "differ": pair.differ,
                }
                for pair in self.pairs
            ],
            "search_spread": self.search_spread,
            "remaining": self.remaining,
            "units": units,
        }

    def _entry(self, scored: EntryResult) -> dict[str, Any]:
        entry = scored.entry
        return {
            "key": entry.key,
            "name": self.names[entry.key],
            **{name: value for name, value in asdict(entry).items() if name != "search"},
            "over_paper": self.ratios[entry.key].to_record(),
            "not_different": list(self.not_different(entry.key)),
            "searches": [
                {"search": search.entry.search, **self.ratios[search.entry.key].to_record()}
                for search in self.searches[entry.group]
            ],
            **scored.runs.to_record(),
            "gains": scored.gains,
            "search": asdict(scored.search),
            "fronts": {cost: [asdict(point) for point in points] for cost, points in scored.fronts.items()},
            "stress": scored.stress,
        }


def _cells(runs: ScoredRuns) -> list[str]:
    error, chatter, load = (runs.over(merit_statistics.Statistic("mean", name)) for name in (ERROR, *COSTS))
    return [
        f"{MILLIMETRES * math.sqrt(error):.3g}",
        f"{chatter:.3g}",
        f"{load:.3g}",
        runs.verdict,
        str(runs.operations),
    ]


def _ratio(runs: ScoredRuns, others: ScoredRuns) -> ErrorRatio:
    both = runs.completed & others.completed
    return ratio_of(runs.metrics[ERROR][both], others.metrics[ERROR][both])


ENTRY_COLOURS = (
    drawing.BLUE,
    drawing.VERMILION,
    drawing.GREEN,
    drawing.PURPLE,
    drawing.GOLD,
    drawing.WINE,
    drawing.SKY,
)
"""Colours of the entries in order of the ranking; they repeat with other dashes."""

LEGEND_ROOM = 1.6
"""Factor by which the axis is extended to the right, for text."""

CLUSTER = 6.0
"""Largest ratio of neighbouring searches whose marks count as one group; the number stands behind it."""

HEADING, A_ROW = 1.45, 0.27
"""Heights in inches."""

WIDE = frozenset({"chatter"})
"""Metrics on a logarithmic axis."""

SMALL_RATIO = 0.1
"""Ratios below this are written as fractions."""

DRAWN_FROM = 0.05
"""A lower bound on the error is drawn if it is at least this share of the least error of all entries."""


def _figure(race: RaceResult, ax: drawing.GivenAxes) -> Figure:
    terms = race.terms
    words = (
        f"{terms.rollouts} rollouts in “{drawing.plain(terms.ensemble)}” to tune each, "
        f"scored in {terms.test_scenarios} test scenarios"
    )
    with drawing.new_page(
        ax, HEADING + A_ROW * max(len(race.ranking), 3), "Tuned alike: which law tracks best?", words
    ) as page:
        (axes,) = page.panels()
        best = race.ranking[0].entry.key if race.entries else ""
        tied = {best, *race.not_different(best)} if best else set()
        for row, scored in enumerate(race.ranking):
            _dot(axes, race, scored, row, drawing.BLUE if scored.entry.key in tied else drawing.INK)
        axes.axvline(1, color=drawing.VERMILION, linewidth=1.0, zorder=1)
        drawing.logarithmic(axes, (1, 2, 3, 5))
        axes.set_yticks(range(len(race.ranking)), [drawing.plain(race.names[each.entry.key]) for each in race.ranking])
        axes.set_ylim(len(race.ranking) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        low, high = axes.get_xlim()
        axes.set_xlim(low, LEGEND_ROOM * high)
        axes.set_xlabel("mean square error over that of the paper's gains, with 95 % interval; less is better")
        dot = partial(Line2D, [], [], marker="o", markersize=5, linestyle="none")
        handles = [
            dot(color=drawing.BLUE, label="best, or not different from it"),
            dot(color=drawing.INK, label="other"),
            dot(color=drawing.INK, markerfacecolor="white", label="violates a constraint"),
            Line2D([], [], color=drawing.VERMILION, label="the paper's gains"),
        ]
        if len(race.entries) > len(race.ranking):
            handles.insert(3, dot(color=drawing.INK, marker="|", markersize=8, label="its searches"))
        page.legend(*handles)
    return page.figure


def _dot(axes: Axes, race: RaceResult, scored: EntryResult, row: int, colour: str) -> None:
    interval = race.ratios[scored.entry.key].interval
    if math.isnan(interval.estimate):
        return
    face = "white" if scored.runs.violated else colour
    axes.plot((interval.low, interval.high), (row, row), color=colour, linewidth=2.0, alpha=0.5)
    axes.plot(interval.estimate, row, "o", color=colour, markerfacecolor=face, markersize=5, zorder=3)
    ratios = [race.ratios[search.entry.key].interval.estimate for search in race.searches[scored.entry.group]]
    if len(ratios) > 1:
        axes.plot(ratios, [row] * len(ratios), "|", color=colour, markersize=8)
    axes.annotate(
        _share(interval.estimate),
        (end_of_marks(interval.high, ratios), row),
        xytext=(5, 0),
        textcoords="offset points",
        va="center_baseline",
        fontsize=7,
        color=colour,
        annotation_clip=False,
    )


def end_of_marks(high: float, ratios: Iterable[float]) -> float:
    """Right end of the marks grouped with an interval, without searches far off (`CLUSTER`)."""
    for ratio in sorted(ratios):
        if high < ratio < CLUSTER * high:
            high = ratio
    return high


def _share(ratio: float) -> str:
    """A ratio such as ``6.4×`` or ``1/16 000``."""
    return f"{ratio:.2g}×" if ratio >= SMALL_RATIO else f"1/{spaced(float(f'{1 / ratio:.2g}'))}"


def _fronts_figure(race: RaceResult, ax: drawing.GivenAxes) -> Figure:
    styles = drawing.looks((scored.entry.key for scored in race.ranking), ENTRY_COLOURS)
    count = race.terms.test_scenarios
    words = f"Trials that satisfy every constraint, in {count} test scenarios; ●: the best, ×: the paper's"
    with drawing.new_page(ax, 3.4 + 0.1 * len(styles), "What less chatter and less load cost", words) as page:
        panels = page.panels(1, len(COSTS), "C", sharey=True)
        for axes, cost in zip(panels, COSTS, strict=True):
            for scored in race.ranking:
                _front(axes, scored, cost, styles[scored.entry.key])
            axes.plot(*_means(race.paper.runs, cost), "x", color=drawing.VERMILION, markersize=6)
            if cost in WIDE:
                drawing.logarithmic(axes, (1, 2, 3, 5))
            axes.set_xlabel(f"mean {merits.metric_quantities()[cost].axis}")
            for value, dashes, name in _least_lines(race):
                axes.axhline(value, color=drawing.GREY, linestyle=dashes, linewidth=1.0, label=name)
        panels[0].set_yscale("log")
        panels[0].yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panels[0].set_ylabel("RMS error (mm)")
        page.legend(*(Line2D([], [], **style, label=drawing.plain(race.names[key])) for key, style in styles.items()))
    return page.figure


def _front(axes: Axes, scored: EntryResult, cost: str, look: dict[str, Any]) -> None:
    feasible = [point for point in scored.fronts.get(cost, ()) if point.feasible]
    best = _means(scored.runs, cost)
    points = [(point.cost, _rms(point.error)) for point in feasible] + ([] if scored.runs.violated else [best])
    if points:
        front_points = [points[index] for index in searching.undominated(*zip(*points, strict=True))]
        axes.plot(*zip(*front_points, strict=True), linewidth=1.1, alpha=0.8, marker=".", markersize=3, **look)
    face = "white" if scored.runs.violated else look["color"]
    axes.plot(*best, "o", color=look["color"], markerfacecolor=face, markersize=4)


def _means(runs: ScoredRuns, cost: str) -> tuple[float, float]:
    return runs.over(merit_statistics.Statistic("mean", cost)), _rms(runs.over(MEAN_ERROR))


def _rms(mean_square: float) -> float:
    """Root mean square in mm of a mean square in m²."""
    return MILLIMETRES * math.sqrt(mean_square)


def _least_lines(race: RaceResult) -> Iterable[tuple[float, tuple[int, tuple[float, ...]], str]]:
    """Lower bounds on the error in mm, if near the entries' errors: value, dashes and name."""
    nearest = min(
        (_rms(scored.runs.over(MEAN_ERROR)) for scored in race.entries if scored.runs.completed.any()), default=0
    )
    lines = (((0, (4, 2)), "least error without foresight"), ((0, (1, 1.5)), "with foresight"))
    for mean, (dashes, name) in zip(race.paper.lower_bounds.means, lines, strict=True):
        value = _rms(mean)
        if value > DRAWN_FROM * nearest:
            yield value, dashes, name
