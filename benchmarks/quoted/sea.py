"""What the paper's cases say of an uncertain plant in a real sea, without any search: a minute together."""

from dataclasses import replace

import numpy as np

import dualwinch as dw
from benchmarks.document import markdown

SCENARIOS, SEED = 200, 7
"""Of the ensembles, as the page's commands give them."""

NOISE = {"sensors.speed_noise": 2e-3}
"""Noise of the speed sensor alone."""

CHATTER = ("chatter", "chatter, N/sample", 1.0, ".3g")
FIGURES = {
    "fando-nftsm": [
        ("mse", "FANDO-NFTSM: MSE, mm²", 1e6, ".3g"),
        ("max_abs_error", "largest error, mm", 1e3, ".3g"),
        CHATTER,
        ("slack_share", "rope slack, % of the time", 1e2, ".2g"),
    ],
    "nftsm": [("mse", "NFTSM: MSE, mm²", 1e6, ".3g"), CHATTER],
    "pid-cascade": [("mse", "PID cascade: MSE, mm²", 1e6, ".4g"), CHATTER],
}
"""Position law → metric, in words, factor and format."""


def ensemble() -> str:
    """Case 4 beside the sea."""
    sea, rows, completed = dw.load_ensemble("sea"), [], 0
    for law, figures in FIGURES.items():
        own = dw.override(sea.experiment, {"controller.kind": law})
        found = dw.run_ensemble(replace(sea, experiment=own), SCENARIOS, SEED, traces=False)
        completed += found.outcome_counts["completed"]
        alone = dw.simulate(dw.case(4, law), stride=0).metrics
        for metric, words, factor, form in figures:
            values = [
                alone[metric],
                *(found.statistic(f"{kind}.{metric}") for kind in ("mean", "median", "p95", "worst")),
            ]
            rows.append([words, *(_plain(factor * value, form) for value in values)])
    table = markdown(["", "Case 4", "sea: mean", "median", "95 %", "worst"], rows)
    return f"{table}\n\n*{completed} of {SCENARIOS * len(FIGURES)} runs completed.*"


def _plain(value: float, form: str) -> str:
    """A value to so many digits, without an exponent."""
    return np.format_float_positional(float(f"{value:{form}}"), trim="-")


def noise() -> str:
    """Why the paper's controller follows better at sea than in its own Case 4."""
    quiet, noisy = (dw.simulate(dw.override(dw.case(4), settings)) for settings in ({}, NOISE))
    gains = [float(np.mean(run["L1"])) for run in (quiet, noisy)]
    as_fast = {"controller.observer.kf": 0.0, "controller.observer.l0": float(f"{gains[1]:.1f}")}
    fixed = dw.simulate(dw.override(dw.case(4), as_fast), stride=0)
    return f"""\
The speed noise alone does that (`--case 4 --set sensors.speed_noise=2e-3`: {1e6 * noisy.metrics.mse:.2g} mm²):
the fuzzy rules mistake it for a fast change and raise the observer's gain, from {gains[0]:.1f} to {gains[1]:.1f} 1/s
on average. As the gain moves with the noise, the effect is larger than that average: a fixed gain of {gains[1]:.1f}
without noise gives {1e6 * fixed.metrics.mse:.1f} mm²."""
