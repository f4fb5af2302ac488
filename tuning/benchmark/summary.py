"""A race in words, the same at a prompt, in a notebook, on the terminal and in the report."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from dualwinch.simulation.ensembles.comparison import CONFIDENCE, Interval
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.tuning.benchmark.comparison import LEAST_DIFFERENCE, RULE, ErrorRatio, PairComparison
from dualwinch.tuning.benchmark.entries import NO_OBSERVER, PAPER
from dualwinch.tuning.benchmark.found import MEAN_ERROR, BenchmarkFindings
from dualwinch.tuning.benchmark.scores import EntryResult, ScoredRuns

HEADINGS = (
    "",
    f"error below the paper's ({100 * CONFIDENCE:g} %)",
    "RMS error, mm",
    "chatter, N",
    "load, N m",
    "constraints",
    "operations a sample",
    "does not differ from",
)
"""Of the table."""

MILLIMETRES = 1e3

WITHOUT_OBSERVER = "without observer"
"""What the paper's law is called that has none, among its ablations."""


def heading(found: BenchmarkFindings) -> str:
    """What was done, in one line."""
    terms = found.terms
    entries = f"{len(found.searches)} entr{'y' if len(found.searches) == 1 else 'ies'}"
    searches = len(found.entries)
    more = f" in {searches} searches" if searches > len(found.searches) else ""
    return (
        f"{entries}{more}, {terms.rollouts} rollouts of '{terms.ensemble}' each, "
        f"scored in {terms.held_out} unseen scenarios, seed {terms.seed}"
    )


def race_table(found: BenchmarkFindings) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: the entries, the best first, and the paper's gains."""
    numbers = {scored.entry.key: str(rank) for rank, scored in enumerate(found.ranking, 1)}
    rows = []
    for scored in found.ranking:
        key = scored.entry.key
        alike = ", ".join(numbers[other] for other in found.alike(key))
        name = f"{numbers[key]}. {found.names[key]}"
        rows.append([name, below_words(found.ratios[key].interval), *_cells(scored.runs), alike or "–"])
    return list(HEADINGS), [*rows, ["the paper's gains", "1 ×", *_cells(found.paper.runs), ""]]


def below_words(interval: Interval) -> str:
    """How many times an error is below another one, with the interval, from that of their ratio: ``16 500 × (...)``."""
    if math.isnan(interval.estimate):
        return "–"
    factor, least, most = (
        spaced(math.inf if not ratio else 1 / ratio) for ratio in (interval.estimate, interval.high, interval.low)
    )
    return f"{factor} × ({least}–{most})"


def spaced(number: float) -> str:
    """A positive number with three digits, without an exponent, thousands apart."""
    rounded = float(f"{number:.3g}")
    return f"{rounded:,.0f}".replace(",", "\u202f") if 100 <= rounded < math.inf else f"{rounded:.3g}"


def ratio_words(interval: Interval) -> str:
    """A ratio with its interval, three digits each."""
    if math.isnan(interval.estimate):
        return "–"
    return f"{spaced(interval.estimate)} ({spaced(interval.low)}–{spaced(interval.high)})"


def _cells(runs: ScoredRuns) -> list[str]:
    error, chatter, load = (
        runs.over(statistic)
        for statistic in (MEAN_ERROR, Statistic("mean", "chatter"), Statistic("mean", "continuous_load"))
    )
    return [
        f"{MILLIMETRES * math.sqrt(error):.3g}",
        f"{chatter:.3g}",
        f"{load:.3g}",
        kept_words(runs),
        str(runs.operations),
    ]


def kept_words(runs: ScoredRuns) -> str:
    """Whether all is kept to; else how many scenarios were lost, or what is exceeded the furthest."""
    lost = int((~runs.completed).sum())
    if lost:
        return f"{lost} of {len(runs.outcomes)} scenarios not completed"
    return f"broken: {runs.broken[0]}" if runs.broken else "kept"


def notes(found: BenchmarkFindings) -> list[str]:
    """What a reader has to know of the table."""
    words = [
        "Error: how many times the mean square error is below that of the paper's gains, the geometric mean over the "
        "scenarios. " + RULE + " Load: root mean square of the motor torques."
    ]
    words += [f"All keep to, where tuned: {'; '.join(found.terms.constraints) or 'nothing'}."]
    words += [least_words(found), luck_words(found)]
    words += [
        f"{found.names[scored.entry.key]}: no trial was better than the gains that the search started from."
        for scored in found.ranking
        if not scored.search.improved
    ]
    if found.left:
        words.append(f"Interrupted: {found.left} entries are left; the same call goes on with them.")
    return words


def luck_words(found: BenchmarkFindings) -> str:
    """How much of a difference is the luck of a search."""
    if len(found.entries) == len(found.searches):
        return (
            "Each was tuned once: another seed of the search finds other gains, and to leave a part out hardly makes "
            "the best gains there are any better. `--searches 3` tells how much is luck."
        )
    return (
        "Shown is the median search of each. Searches of the same entry that differ by their seed alone are up to a "
        f"factor of {spaced(found.luck)} apart."
    )


def least_words(found: BenchmarkFindings) -> str:
    """What no controller gets below, without and with foresight."""
    least, foreseeing = found.paper.least, found.paper.least_foreseeing
    beyond = int((least > 0).sum())
    if not beyond:
        return "The reference is feasible in all scenarios: an ideal controller could follow it exactly."
    without, given = (MILLIMETRES * math.sqrt(values.mean()) for values in (least, foreseeing))
    return (
        f"{beyond} of the scenarios are infeasible: they need more force than the motors can deliver. Lower bound on "
        f"the RMS error: {without:.3g} mm for a non-anticipating optimal controller, {given:.3g} mm with full "
        "foresight."
    )


def ablation_rows(found: BenchmarkFindings) -> list[list[str]]:
    """What the paper's law comes to without each of its parts: what is missing, the ratio, and whether they differ."""
    wholes = [scored for scored in found.ranking if scored.entry.law == PAPER and not scored.entry.variant]
    return [row for whole in wholes for row in _ablated(found, whole)]


def _ablated(found: BenchmarkFindings, whole: EntryResult) -> list[list[str]]:
    parts = whole.entry.estimator, whole.entry.coordination
    others = {
        scored.entry.variant or WITHOUT_OBSERVER: scored.entry.key
        for scored in found.ranking
        if (scored.entry.estimator, scored.entry.coordination) == parts
        and (scored.entry.law == NO_OBSERVER or (scored.entry.law == PAPER and scored.entry.variant))
    }
    if WITHOUT_OBSERVER in others and len(others) == 1 and not any(each.entry.variant for each in found.entries):
        return []
    pairs = {words: found.pair(key, whole.entry.key) for words, key in others.items()}
    return [[words, ratio_words(pair.ratio.interval), "yes" if pair.differ else "no"] for words, pair in pairs.items()]


def stress_rows(found: BenchmarkFindings) -> list[list[str]]:
    """What breaks each entry first, where that was looked for: name, imperfection, size and what is broken."""
    return [
        [found.names[scored.entry.key], first["label"], first["size"], first["broken"]]
        for scored in found.ranking
        for first in (scored.stress or ())[:1]
    ]


def search_rows(found: BenchmarkFindings) -> list[list[str]]:
    """What each search found and had: name, how far the error is below the paper's, gains, trials, rollouts, time."""
    return [_search(found, search) for scored in found.ranking for search in found.searches[scored.entry.group]]


def _search(found: BenchmarkFindings, scored: EntryResult) -> list[str]:
    search = scored.search
    numbers = [search.gains, search.trials, search.rollouts]
    below = below_words(found.ratios[scored.entry.key].interval)
    return [found.names[scored.entry.key], below, *map(str, numbers), f"{search.seconds:.0f} s"]


STATISTICS = (
    "mean.mse",
    "median.mse",
    "p95.mse",
    "worst.max_abs_error",
    "mean.chatter",
    "mean.continuous_load",
    "worst.peak_tension",
    "worst.min_tension",
    "mean.slack_share",
    "mean.energy",
)
"""What is said of everybody in the unseen scenarios."""


def to_record(found: BenchmarkFindings) -> dict[str, Any]:
    """Everything that was found; `docs/race.md` says what the names mean."""
    terms, least = found.terms, found.paper.least
    return {
        **terms.to_record(),
        "seeds": {"searches": terms.seed, "test": terms.test_seed},
        "rule": {"text": RULE, "confidence": CONFIDENCE, "least_difference": LEAST_DIFFERENCE},
        "least": {
            "beyond_authority": int((least > 0).sum()),
            "without_foresight": float(least.mean()),
            "with_foresight": float(found.paper.least_foreseeing.mean()),
        },
        "paper": _runs(found.paper.runs),
        "entries": [_entry(found, scored) for scored in found.ranking],
        "pairs": [_pair(pair) for pair in found.pairs],
        "luck": found.luck,
        "left": found.left,
    }


def _entry(found: BenchmarkFindings, scored: EntryResult) -> dict[str, Any]:
    entry, key = scored.entry, scored.entry.key
    return {
        "key": key,
        "name": found.names[key],
        "law": entry.law,
        "estimator": entry.estimator,
        "coordination": entry.coordination,
        "variant": entry.variant,
        "settings": dict(entry.settings),
        "held": list(entry.held),
        "over_paper": _ratio(found.ratios[key]),
        "alike": list(found.alike(key)),
        "searches": [
            {"search": search.entry.search, **_ratio(found.ratios[search.entry.key])}
            for search in found.searches[entry.group]
        ],
        **_runs(scored.runs),
        "gains": scored.gains,
        "search": asdict(scored.search),
        "fronts": {name: [asdict(point) for point in points] for name, points in scored.fronts.items()},
        "stress": None if scored.stress is None else list(scored.stress),
    }


def _runs(runs: ScoredRuns) -> dict[str, Any]:
    names = [name.rpartition(".")[::2] for name in STATISTICS]
    return {
        "statistics": {f"{kind}.{metric}": _finite(runs.over(Statistic(kind, metric))) for kind, metric in names},
        "completed": int(np.count_nonzero(runs.completed)),
        "broken": list(runs.broken),
        "operations": runs.operations,
    }


def _pair(pair: PairComparison) -> dict[str, Any]:
    ratio = _ratio(pair.ratio)
    levels = {"p_corrected": pair.corrected, "apart": pair.apart, "differ": pair.differ}
    return {"first": pair.first, "second": pair.second, **ratio, **levels}


def _ratio(ratio: ErrorRatio) -> dict[str, Any]:
    interval = {name: _finite(value) for name, value in asdict(ratio.interval).items()}
    return {**interval, "scenarios": ratio.scenarios, "p": ratio.p}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
