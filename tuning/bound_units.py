"""Numbers with a unit behind them, as bounds may be given: ``5ms``, ``6 kN``, ``6dB``."""

import math
import re

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.signals.units import UNITS, factor
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.tuning.margin_statistic import MarginStatistic

ANGLES = {"deg": 1.0, "rad": 180 / math.pi}
"""Units of a phase margin, and what brings them to degrees."""

DECIBEL = "dB"
"""Unit of a gain margin beside the plain factor."""


def in_si(text: str, statistic: Statistic | MarginStatistic) -> float:
    """A number in the unit of a statistic.

    Args:
        text: the number, with or without a unit.
        statistic: what it bounds.

    Raises:
        ValueError: no number.
        ConfigurationError: a unit that the statistic does not come in.
    """
    parts = re.fullmatch(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z].*)", text.strip())
    if not parts or re.fullmatch(r"[eE][-+]?\d+", parts[2]):
        return float(text)
    value, unit = float(parts[1]), parts[2]
    if unit == statistic.unit:
        return value
    if statistic.metric == "gain_margin":
        return 10 ** (value / 20) if unit == DECIBEL else _refused(unit, [DECIBEL])
    if statistic.unit == "deg":
        return value * ANGLES[unit] if unit in ANGLES else _refused(unit, list(ANGLES))
    if statistic.unit in UNITS:
        return value * factor(unit, statistic.unit)
    return _refused(unit, [] if statistic.unit == "1" else [statistic.unit])


def _refused(unit: str, allowed: list[str]) -> float:
    known = f"must be one of {', '.join(allowed)}" if allowed else "must be a plain number"
    raise ConfigurationError(f'unit "{unit}": {known}')
