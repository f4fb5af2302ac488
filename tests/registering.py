"""Parts known to files and command lines for the time of a test."""

from typing import Any

import pytest

from dualwinch.model.quantities.part import base_of


def register(monkeypatch: pytest.MonkeyPatch, part: Any) -> None:
    """Make a part known."""
    registry = base_of(part).registry
    monkeypatch.setitem(registry._parts, part.kind, part)  # pyright: ignore[reportOptionalMemberAccess]
