"""Parts known to files and command lines for the time of a test."""

from typing import Any

import pytest

from dualwinch.simulation.ensembles.distributions import DISTRIBUTIONS, Distribution
from dualwinch.simulation.metrics.registry import METRICS


def register(monkeypatch: pytest.MonkeyPatch, part: Any) -> None:
    """Make a metric or a distribution known."""
    registry = DISTRIBUTIONS if issubclass(part, Distribution) else METRICS
    monkeypatch.setitem(registry._parts, part.kind, part)  # pyright: ignore[reportArgumentType]
