"""The paper's law with one of its parts taken away: settings that are held, nothing else."""

from typing import Any

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.tuning.race.entry import Entry

PAPER = Controller().law.kind
"""The paper's law."""

NO_OBSERVER = Nftsm.kind
"""The paper's law without its observer is a law of its own."""

CONSTANT_GAIN, NO_ANTI_SATURATION, LINEAR_SURFACE = (
    "constant observer gain",
    "without anti-saturation",
    "linear surface",
)
"""What is taken away, in words."""

VARIANTS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    CONSTANT_GAIN: (
        {"controller.observer.kf": 0.0},
        tuple(f"controller.observer.{name}" for name in ("kf", "error_scale", "rate_scale", "filter_time")),
    ),
    NO_ANTI_SATURATION: (
        {"controller.auxiliary.gamma": 0.0, "controller.auxiliary.gamma_force": 0.0},
        tuple(f"controller.auxiliary.{name}" for name in ("gamma", "gamma_force", "k_a")),
    ),
    # the law needs p > q; with 1.00002 the surface is linear within 0.03 % from the smoothed speed errors on upwards
    LINEAR_SURFACE: (
        {"controller.nftsm.p": 100_001, "controller.nftsm.q": 99_999},
        ("controller.nftsm.p", "controller.nftsm.q"),
    ),
}
"""What is taken away → settings, and keys that are not searched then."""


def ablations(estimator: str, coordination: str) -> list[Entry]:
    """The paper's law as it is, and without each of its parts."""
    whole = [Entry(PAPER, estimator, coordination), Entry(NO_OBSERVER, estimator, coordination)]
    return whole + [
        Entry(PAPER, estimator, coordination, variant, settings, held) for variant, (settings, held) in VARIANTS.items()
    ]
