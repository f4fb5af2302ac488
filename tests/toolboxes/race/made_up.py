"""A race that nobody ran, with numbers that are easy to check."""

from collections.abc import Mapping

import numpy as np

from dualwinch.simulation.batch.authority import LeastErrors
from dualwinch.toolboxes.race.entries import CONSTANT_GAIN, RaceEntry, RaceTerms
from dualwinch.toolboxes.race.result import RaceResult
from dualwinch.toolboxes.race.scores import BaselineScore, EntryResult, FrontPoint, ScoredRuns, SearchRecord

SCENARIOS = 40

TERMS = RaceTerms("rig", "[ensemble]\nname = 'rig'\n", ("mean.chatter<=1*paper",), "hybrid", 3000, 8, SCENARIOS, 5)

METRICS = ("mse", "chatter", "continuous_load", "max_abs_error", "peak_tension", "min_tension", "slack_share", "energy")


def runs(error: float, *, violated: Mapping[str, float] | None = None, lost: int = 0, scatter: int = 0) -> ScoredRuns:
    """Runs whose errors are some multiple of 1e-6 m², the same scatter for the same number."""
    factors = np.exp(0.1 * np.random.default_rng(scatter).standard_normal(SCENARIOS))
    shared = np.exp(np.random.default_rng(99).standard_normal(SCENARIOS))
    metrics = {name: np.full(SCENARIOS, 2.0) for name in METRICS} | {"mse": 1e-6 * error * shared * factors}
    outcomes = np.array(["completed"] * (SCENARIOS - lost) + ["diverged"] * lost)
    ends = np.full(SCENARIOS, 25.0)
    return ScoredRuns(outcomes, ends, metrics, {"mean.chatter <= 3 N": -0.1} | dict(violated or {}), 200)


def scored(law: str, error: float, variant: str = "", **more: object) -> EntryResult:
    """An entry with a front of three points, the last of which breaks a constraint."""
    scatter = sum(map(ord, law + variant))
    return EntryResult(
        entry=RaceEntry(law, "kalman", "differential-tension", variant),
        runs=runs(error, scatter=scatter, **more),  # pyright: ignore[reportArgumentType]
        gains={"controller.winch_1.kp": 1.0},
        fronts={
            cost: (
                FrontPoint(1.0, 4e-6 * error, feasible=True, gains={}),
                FrontPoint(1.5, 5e-6 * error, feasible=True, gains={}),
                FrontPoint(1.8, 1e-9, feasible=False, gains={}),
            )
            for cost in ("chatter", "continuous_load")
        },
        search=SearchRecord(300, 3010, 12, 61.0, improved=True, version="0.1.0"),
    )


def made_up(least: float = 0.0, foreseeing: float = 0.0) -> RaceResult:
    """Two that do not differ, one behind them that breaks a constraint, and the paper's law without a part."""
    entries = (
        scored("fando-nftsm", 0.5, violated={"worst.peak_tension <= 6000 N": 0.02}),
        scored("adrc", 0.1),
        scored("fando-nftsm", 0.7, CONSTANT_GAIN),
        scored("nftsm", 0.102),
    )
    paper = BaselineScore(runs(1.0), LeastErrors(np.full(SCENARIOS, least), np.full(SCENARIOS, foreseeing)))
    return RaceResult(TERMS, paper, entries)
