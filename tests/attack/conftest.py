"""How hard to attack: ``pytest tests/attack --attack 50``."""

import pytest


@pytest.fixture
def attack(request: pytest.FixtureRequest) -> int:
    """How many times as hard as in every run."""
    return request.config.getoption("attack")
