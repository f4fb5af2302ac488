"""The paper's claims about its simulations, each with a verdict from the runs by an explicit rule."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from dualwinch.toolbox import Result, merits, paper, settings
from dualwinch.toolbox import runs as simulations

Runs: TypeAlias = Mapping[tuple[int, str], Result]
"""(case, controller) → result."""

Verdict: TypeAlias = Literal["holds", "partly", "does not hold"]

PROPOSED, BASELINE, PID = "fando-nftsm", "nftsm", "pid-cascade"

BAND = 0.2
"""A run has converged once its error stays within ± this, in m; two runs that converge together are compared by half
of it."""

AS_REPORTED = 0.05
"""Figure 21 is reproduced if the mean error's reduction differs from the paper's by at most this share of the error
without observer."""

NOTICEABLE = 0.5
"""Least relative reduction of an error by the observer for the paper's word "significantly"."""


@dataclass(frozen=True)
class Claim:
    """A claim of the paper.

    Attributes:
        section: of the paper.
        words: the claim.
        here: results of the runs.
        verdict: whether it holds.
    """

    section: str
    words: str
    here: str
    verdict: Verdict


def claims(runs: Runs, observer_gains: Mapping[float, float] | None = None) -> list[Claim]:
    """Every claim that the completed runs among these can confirm or refute.

    Args:
        runs: (case, controller) → result.
        observer_gains: L₀ = K_f in 1/s → change of Case 4's steady mean error by an observer with these gains.
    """
    complete = {key: run for key, run in runs.items() if run.outcome == "completed"}
    return [
        *_convergence(complete),
        *_steady_errors(complete),
        *_observer_in_case_3(complete),
        *_figure_21(complete, observer_gains or {}),
        *_smooth_profile(complete),
        *_limits(complete),
    ]


def converged_at(result: Result, band: float = BAND) -> float:
    """Time in s after which the error stays within ±`band` m; infinite if it does not."""
    outside = np.flatnonzero(~(np.abs(result["e"]) <= band))
    if not outside.size:
        return float(result["t"][0])
    return float(result["t"][outside[-1] + 1]) if outside[-1] + 1 < len(result["t"]) else np.inf


def verdict_of(*holds: bool) -> Verdict:
    """The verdict on a claim of several parts."""
    return "holds" if all(holds) else "partly" if any(holds) else "does not hold"


def reductions(metrics: Mapping[tuple[int, str], merits.Metrics]) -> dict[str, float] | None:
    """Figure 21's reductions, from (case, controller) → figures of merit; ``None`` if Case 4 was not run with both."""
    return paper.steady_change(
        {kind: merits for (number, kind), merits in metrics.items() if number == paper.COMPARED_CASE}
    )


OTHER_GAINS = (2.5, 50.0)
"""Gains L₀ = K_f in 1/s beside the assumed ones (A9), to show how the results depend on them."""


def other_observers(runs: Runs, engine: simulations.EngineName = "compiled") -> dict[float, float]:
    """Gain of the observer in Case 4 → relative change of the steady mean error against no observer."""
    without = runs[4, "nftsm"].metrics.steady_mae
    comparisons = {}
    for gain in OTHER_GAINS:
        gains = {"controller.observer.l0": gain, "controller.observer.kf": gain}
        with_it = simulations.simulate(settings.override(paper.case(4), gains), stride=0, engine=engine)
        comparisons[gain] = with_it.metrics.steady_mae / without - 1
    return comparisons


def _convergence(runs: Runs) -> Iterator[Claim]:
    for number in (1, 2):
        if {(number, PROPOSED), (number, PID)} <= runs.keys():
            pair = runs[number, PROPOSED], runs[number, PID]
            times = {band: tuple(converged_at(run, band) for run in pair) for band in (BAND, BAND / 2)}
            here = [f"within ±{band:g} m for good {_compared(*both)}" for band, both in times.items()]
            yield Claim(
                "4.2",
                f"Case {number}: the proposed controller converges faster than the PID cascade.",
                f"W{'; '.join(here)[1:]}.",
                verdict_of(
                    next((proposed < baseline for proposed, baseline in times.values() if proposed != baseline), False)
                ),
            )


def _compared(own: float, other: float) -> str:
    """Two times of convergence in words."""
    text_1, text_2 = ("never" if time == np.inf else f"after {time:.3g} s" for time in (own, other))
    return f"{text_1}, the PID cascade {text_2}"


def _steady_errors(runs: Runs) -> Iterator[Claim]:
    cases = [number for number in (1, 2, 3, 4) if {(number, PROPOSED), (number, PID)} <= runs.keys()]
    if cases:
        pairs = [(runs[n, PROPOSED].metrics.steady_mae, runs[n, PID].metrics.steady_mae) for n in cases]
        words = "; ".join(
            f"Case {number}: {1e3 * proposed:.3g} against {1e3 * baseline:.3g} mm"
            for number, (proposed, baseline) in zip(cases, pairs, strict=True)
        )
        yield Claim(
            "4.2, 4.4",
            "Its steady-state error is smaller than the PID cascade's.",
            f"Mean |e|, {words}.",
            verdict_of(*(proposed < baseline for proposed, baseline in pairs)),
        )


def _observer_in_case_3(runs: Runs) -> Iterator[Claim]:
    if {(3, PROPOSED), (3, BASELINE)} <= runs.keys():
        proposed, baseline = runs[3, PROPOSED], runs[3, BASELINE]
        change = proposed.metrics.steady_mae / baseline.metrics.steady_mae - 1
        times = converged_at(proposed), converged_at(baseline)
        yield Claim(
            "4.3",
            "Case 3: the observer makes convergence and steady-state error significantly better.",
            f"Mean steady |e| {paper.percent(change, '+.0f')}; within ±{BAND:g} m after {times[0]:.3g} s with it and "
            f"{times[1]:.3g} s without.",
            "holds" if change <= -NOTICEABLE else verdict_of(change < 0, times[0] < (1 - NOTICEABLE) * times[1]),
        )


def _figure_21(runs: Runs, observer_gains: Mapping[float, float]) -> Iterator[Claim]:
    change = reductions({key: run.metrics for key, run in runs.items()})
    if change is not None:
        here = ", ".join(paper.percent(change[name]) for name in ("mae", "max_abs_error", "mse"))
        gains = ", ".join(
            f"with {gain:g} 1/s the mean changes by {paper.percent(share)}" for gain, share in observer_gains.items()
        )
        rests = f" This rests on the assumed L₀ = K_f = 5 1/s (A9): {gains}." if gains else ""
        yield Claim(
            "4.3",
            "Case 4: the observer takes 76 % off the mean, 67 % off the largest and 93.5 % off the mean square error.",
            f"{here}.{rests}",
            verdict_of(abs(change["mae"] + 0.76) <= AS_REPORTED, *(change[name] <= -NOTICEABLE for name in change)),
        )


def _smooth_profile(runs: Runs) -> Iterator[Claim]:
    if {(1, PROPOSED), (2, PROPOSED)} <= runs.keys():
        step, profile = runs[1, PROPOSED].metrics, runs[2, PROPOSED].metrics
        yield Claim(
            "4.2",
            "A reference that accelerates slowly (Case 2) makes the rope tensions smoother than a step (Case 1).",
            f"Peak tension {profile.peak_tension / 1e3:.3g} against {step.peak_tension / 1e3:.3g} kN, chatter "
            f"{profile.chatter:.2g} against {step.chatter:.2g} N a sample.",
            verdict_of(profile.peak_tension < step.peak_tension, profile.chatter < step.chatter),
        )


def _limits(runs: Runs) -> Iterator[Claim]:
    cases = [number for number in (1, 2, 3, 4) if (number, PROPOSED) in runs]
    if cases:
        excesses = {number: _exceeded(runs[number, PROPOSED]) for number in cases}
        satisfied = [f"Case {number}" for number, words in excesses.items() if not words]
        violated = [f"Case {number}: {words}" for number, words in excesses.items() if words]
        sentences = [
            f"Satisfied in {' and '.join(satisfied)}." if satisfied else "",
            *(f"{words}." for words in violated),
        ]
        yield Claim(
            "5",
            "The coordination avoids actuator saturation and keeps the tensions under control.",
            " ".join(filter(None, sentences)),
            verdict_of(*(not words for words in excesses.values())),
        )


def _exceeded(run: Result) -> str:
    """Violations of limits in a run, in words; empty if there are none."""
    m, limit = run.metrics, float(run.experiment.controller.limits.tension_max)
    words = []
    if m.saturated_share > 0:
        words.append(f"force at its limit {100 * m.saturated_share:.2g} % of the time")
    if m.peak_tension > limit:
        words.append(f"peak of {m.peak_tension / 1e3:.3g} kN (commands: {limit / 1e3:g} kN)")
    if m.slack_share > 0:
        words.append(f"a rope slack for {1e3 * m.slack_share * run.end_time:.2g} ms")
    return ", ".join(words)
