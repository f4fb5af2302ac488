"""What a study gained, what that costs, and what to do next, in sentences of its report."""

import math
from pathlib import Path

from dualwinch.simulation.plots.runs import length_unit
from dualwinch.tuning.result import TuningResult, advice

COSTS = {
    "mean.chatter": "chatter",
    "mean.continuous_load": "the motors' load (root mean square torque)",
    "mean.torque_rate": "the rate of torque",
    "mean.energy": "energy",
}
"""Statistics that better tracking is paid with → their names."""


ASSUMED = (
    "All of this holds on ropes without mass and drums as light as the configuration's: on an independent plant, gains "
    "tuned on drums of 1.8 kg m² are lost with 2.36 kg/m of rope, or with 30 kg m² more on the drums."
)
"""What tuned gains rest on."""


def gained(tuned: TuningResult) -> str:
    """The typical error of the best, the start and the paper's gains as lengths; empty where it was not measured."""
    verdict = tuned.verdict
    errors = {name: verdict.statistics(name).get("mean.mse", math.nan) for name in verdict.shown}
    if not verdict.improved or not all(0 < error < math.inf for error in errors.values()):
        return ""
    before = " and ".join(
        f"{_length(errors[name])} with {words}"
        for name, words in (("start", "the start"), ("paper", "the paper's gains"))
        if name in errors
    )
    return f"Root mean square error: {_length(errors['best'])}, where it was {before}." if before else ""


def costs(tuned: TuningResult) -> list[str]:
    """What the best takes more of than the paper's gains, and how near the largest tension is to its limit."""
    verdict = tuned.verdict
    ours, theirs = verdict.scored.statistics, verdict.statistics("paper")
    found = []
    for name, words in COSTS.items():
        if ours.get(name, 0) > 0 and theirs.get(name, 0) > 0:
            ratio = ours[name] / theirs[name]
            found.append(
                f"{words[:1].upper()}{words[1:]}: {ratio:.3g} × the paper's{'' if ratio > 1 else ', no cost'}."
            )
    peak = ours.get("worst.peak_tension", math.nan)
    limit = float(tuned.problem.experiment.controller.limits.tension_max)
    if math.isfinite(peak):
        found.append(f"Largest tension {peak:.0f} N; commands are limited to {limit:.0f} N.")
    return found


def next_steps(tuned: TuningResult, folder: Path) -> list[tuple[str, str]]:
    """What to do next: words, and a command, which is empty for mere advice."""
    best = folder / "best.toml"
    ensemble = tuned.problem.ensemble
    steps = [(f"{sentence[:1].upper()}{sentence[1:]}.", "") for sentence in advice(tuned)]
    if not tuned.verdict.improved:
        return steps
    if ensemble is not None:
        named = f" --ensemble {ensemble.name}"
        words = "Check it against the paper's gains in scenarios of a new seed, with confidence intervals:"
        steps.append((words, f"dualwinch compare paper {best}{named} --seed 1000"))
    steps.append(("Find what breaks it first; this report then shows it:", f"dualwinch stress {best} --out {folder}"))
    steps.append(("Look at a run:", f"dualwinch simulate --config {best} --plot run.png"))
    steps.append(("Put it on hardware, as C99:", f"dualwinch export c --config {best} --out firmware"))
    return steps


def _length(mean_square: float) -> str:
    size = math.sqrt(mean_square)
    unit, name = length_unit(size)
    return f"{size / unit:.3g} {name}"
