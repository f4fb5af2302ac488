"""What the disturbance observer is worth: Figure 21's three reductions."""

from collections.abc import Mapping

from dualwinch.simulation.paper import REDUCTIONS
from dualwinch.simulation.results.result import Result

WITH_OBSERVER, WITHOUT_OBSERVER = "fando-nftsm", "nftsm"
"""The controllers Figure 21 compares."""

COMPARED_CASE = 4
"""The case Figure 21 compares them in."""


def steady_change(results: Mapping[str, Result]) -> dict[str, float] | None:
    """Relative change of the steady-state errors by the observer.

    Args:
        results: controller → result, all of one case.

    Returns:
        ``mae``, ``max_abs_error``, ``mse`` → (with observer − without) / without, so −0.76 is 76 % less; NaN where
        a run never reached its steady state. ``None`` where one of the two controllers is missing.
    """
    if WITH_OBSERVER not in results or WITHOUT_OBSERVER not in results:
        return None
    new, old = results[WITH_OBSERVER].metrics, results[WITHOUT_OBSERVER].metrics
    pairs = {key: (getattr(new, f"steady_{key}"), getattr(old, f"steady_{key}")) for key in REDUCTIONS}
    return {key: after / before - 1 if before else float("nan") for key, (after, before) in pairs.items()}


def reductions(runs: Mapping[tuple[int, str], Result]) -> dict[str, float] | None:
    """Figure 21's reductions: `steady_change` of Case 4, ``None`` where it was not run with both controllers.

    Args:
        runs: (case, controller) → result.
    """
    return steady_change({kind: result for (number, kind), result in runs.items() if number == COMPARED_CASE})


def percent(share: float, form: str = "+.1f") -> str:
    """A relative change in percent, with a minus sign that is one, e.g. −74.4 %.

    Args:
        share: the change; −0.744 is 74.4 % less.
        form: how the number is formatted; ``+g`` for as many digits as it has.
    """
    return f"{round(100 * share, 6):{form}} %".replace("-", "−")
