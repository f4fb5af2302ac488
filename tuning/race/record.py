"""A race as data that JSON holds."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from dualwinch.simulation.ensembles.comparison import CONFIDENCE
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.tuning.problem import HELD_OUT, SELECTION
from dualwinch.tuning.race.found import Found
from dualwinch.tuning.race.pairs import LEAST_DIFFERENCE, RULE, Pair, Ratio
from dualwinch.tuning.race.scored import Runs, Scored
from dualwinch.tuning.race.terms import UNSEEN

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


def to_record(found: Found) -> dict[str, Any]:
    """Everything that was found; `docs/race.md` says what the names mean."""
    terms, least = found.terms, found.paper.least
    seeds = {"tuning": terms.seed, "selection": terms.seed + SELECTION}
    return {
        **terms.to_record(),
        "seeds": {**seeds, "choice_confirmed": terms.seed + HELD_OUT, "unseen": terms.seed + UNSEEN},
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


def _entry(found: Found, scored: Scored) -> dict[str, Any]:
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


def _runs(runs: Runs) -> dict[str, Any]:
    names = [name.rpartition(".")[::2] for name in STATISTICS]
    return {
        "statistics": {f"{kind}.{metric}": _finite(runs.over(Statistic(kind, metric))) for kind, metric in names},
        "completed": int(np.count_nonzero(runs.completed)),
        "broken": list(runs.broken),
        "operations": runs.operations,
    }


def _pair(pair: Pair) -> dict[str, Any]:
    ratio = _ratio(pair.ratio)
    levels = {"p_corrected": pair.corrected, "apart": pair.apart, "differ": pair.differ}
    return {"first": pair.first, "second": pair.second, **ratio, **levels}


def _ratio(ratio: Ratio) -> dict[str, Any]:
    interval = {name: _finite(value) for name, value in asdict(ratio.interval).items()}
    return {**interval, "scenarios": ratio.scenarios, "p": ratio.p}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
