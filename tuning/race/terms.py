"""What is the same for all who take part in a race."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.race.entry import Entry

UNSEEN = 3_000_000
"""Added to the seed of a race: scenarios that score, which no search, no choice and no study's own score has seen."""

ROLLOUTS, HELD_OUT = 30_000, 200
"""Budget of a search, and scenarios that score, where nothing else is asked for."""


@dataclass(frozen=True)
class Terms:
    """What is the same for all.

    Attributes:
        ensemble: its name.
        configuration: the ensemble with the paper's controller, as TOML.
        constraints: what all keep to.
        method: name of the optimiser.
        rollouts: budget of each search.
        scenarios: number of scenarios a candidate is tuned on.
        held_out: number of unseen scenarios that score.
        seed: of scenarios and searches.
    """

    ensemble: str
    configuration: str
    constraints: tuple[str, ...]
    method: str
    rollouts: int
    scenarios: int
    held_out: int
    seed: int

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` where a number is out of range."""
        for name, least in (("rollouts", 1), ("held_out", 2)):
            if getattr(self, name) < least:
                raise ConfigurationError(f"{name} = {getattr(self, name)}: must be a whole number >= {least}")

    def to_record(self) -> dict[str, Any]:
        """As JSON holds it."""
        return asdict(self)


@dataclass(frozen=True)
class Entrant:
    """Who takes part, ready to be tuned.

    Attributes:
        entry: who.
        problem: what is searched for.
        definition: the problem as data that is kept with the result.
    """

    entry: Entry
    problem: Problem
    definition: Mapping[str, Any]
