"""A race in words, the same at a prompt, in a notebook, on the terminal and in the report."""

import math

from dualwinch.simulation.ensembles.comparison import CONFIDENCE, Interval
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.tuning.race.ablations import NO_OBSERVER, PAPER
from dualwinch.tuning.race.found import MEAN_ERROR, Found
from dualwinch.tuning.race.pairs import RULE
from dualwinch.tuning.race.scored import Runs, Scored

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


def heading(found: Found) -> str:
    """What was done, in one line."""
    terms = found.terms
    entries = f"{len(found.searches)} entr{'y' if len(found.searches) == 1 else 'ies'}"
    searches = len(found.entries)
    more = f" in {searches} searches" if searches > len(found.searches) else ""
    return (
        f"{entries}{more}, {terms.rollouts} rollouts of '{terms.ensemble}' each, "
        f"scored in {terms.held_out} unseen scenarios, seed {terms.seed}"
    )


def race_table(found: Found) -> tuple[list[str], list[list[str]]]:
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


def _cells(runs: Runs) -> list[str]:
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


def kept_words(runs: Runs) -> str:
    """Whether all is kept to; else how many scenarios were lost, or what is exceeded the furthest."""
    lost = int((~runs.completed).sum())
    if lost:
        return f"{lost} of {len(runs.outcomes)} scenarios not completed"
    return f"broken: {runs.broken[0]}" if runs.broken else "kept"


def notes(found: Found) -> list[str]:
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


def luck_words(found: Found) -> str:
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


def least_words(found: Found) -> str:
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


def ablation_rows(found: Found) -> list[list[str]]:
    """What the paper's law comes to without each of its parts: what is missing, the ratio, and whether they differ."""
    wholes = [scored for scored in found.ranking if scored.entry.law == PAPER and not scored.entry.variant]
    return [row for whole in wholes for row in _ablated(found, whole)]


def _ablated(found: Found, whole: Scored) -> list[list[str]]:
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


def stress_rows(found: Found) -> list[list[str]]:
    """What breaks each entry first, where that was looked for: name, imperfection, size and what is broken."""
    return [
        [found.names[scored.entry.key], first["label"], first["size"], first["broken"]]
        for scored in found.ranking
        for first in (scored.stress or ())[:1]
    ]


def search_rows(found: Found) -> list[list[str]]:
    """What each search found and had: name, how far the error is below the paper's, gains, trials, rollouts, time."""
    return [_search(found, search) for scored in found.ranking for search in found.searches[scored.entry.group]]


def _search(found: Found, scored: Scored) -> list[str]:
    search = scored.search
    numbers = [search.gains, search.trials, search.rollouts]
    below = below_words(found.ratios[scored.entry.key].interval)
    return [found.names[scored.entry.key], below, *map(str, numbers), f"{search.seconds:.0f} s"]
