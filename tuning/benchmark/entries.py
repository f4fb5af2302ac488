"""The entries of a race: a law, an estimator and a coordination, as they are or with something held."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from typing import Any

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.model.arguments import whole_number
from dualwinch.model.quantities.part import Registry
from dualwinch.simulation.exogenous.signals import named_seed
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.selection_config import SampleSizes
from dualwinch.tuning.tuning_problem import COORDINATION, ESTIMATOR

ALL = "all"
"""Stands for every kind of a registry."""

LAW = "controller.kind"
"""Key of the law; those of the other two parts are `tuning_problem.ESTIMATOR` and `COORDINATION`."""


@dataclass(frozen=True)
class BenchmarkEntry:
    """One combination of parts that is tuned.

    Attributes:
        law, estimator, coordination: kinds of its parts.
        variant: what is changed, in a few words; empty: nothing.
        settings: key → value of what is changed.
        held: keys that are left out of the search.
        search: number of the search, from 0: each has a seed of its own.
    """

    law: str
    estimator: str
    coordination: str
    variant: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    held: tuple[str, ...] = ()
    search: int = 0

    @property
    def key(self) -> str:
        """What tells it from all others: its parts, what is changed, and which search it is but for the first."""
        return ", ".join(self._words)

    @property
    def _words(self) -> tuple[str, ...]:
        search = f"search {self.search + 1}" if self.search else ""
        return tuple(filter(None, (self.law, self.variant, self.estimator, self.coordination, search)))

    @property
    def stem(self) -> str:
        """Name of its files."""
        return "+".join(re.sub(r"[^a-z0-9]+", "-", word.lower()).strip("-") for word in self._words)

    @property
    def group(self) -> str:
        """Key of its first search: what all its searches share."""
        return replace(self, search=0).key

    @property
    def values(self) -> dict[str, Any]:
        """Every setting that makes it what it is."""
        kinds = {LAW: self.law, ESTIMATOR: self.estimator, COORDINATION: self.coordination}
        return kinds | dict(self.settings)


def kinds(asked: Sequence[str] | str | None, registry: Registry[Any], usual: Sequence[str]) -> list[str]:
    """The kinds that are asked for: `ALL`, one or several, each once; what is usual where nothing is.

    Raises:
        ConfigurationError: there is no such kind; the message names the nearest.
    """
    texts = [asked] if isinstance(asked, str) else list(asked or usual)
    found: list[str] = []
    for text in texts:
        found += list(registry) if text == ALL else [registry.find(text).kind]
    return list(dict.fromkeys(found))


def combinations(laws: Iterable[str], estimators: Iterable[str], coordinations: Iterable[str]) -> list[BenchmarkEntry]:
    """Every law with every estimator and every coordination."""
    return [BenchmarkEntry(*parts) for parts in product(laws, estimators, coordinations)]


def names(entries: Sequence[BenchmarkEntry]) -> dict[str, str]:
    """Key of each entry → what it is called among these: its law, what is changed, and parts that most do not have.

    All searches of an entry are called alike.
    """
    usual = {part: _usual([getattr(entry, part) for entry in entries]) for part in ("estimator", "coordination")}

    def name(entry: BenchmarkEntry) -> str:
        unusual = (getattr(entry, part) for part, kind in usual.items() if getattr(entry, part) != kind)
        return ", ".join(filter(None, (entry.law, entry.variant, *unusual)))

    return {entry.key: name(entry) for entry in entries}


def _usual(kinds_there: Sequence[str]) -> str:
    """The kind that more than half have; empty where there is none."""
    kind = max(kinds_there, key=kinds_there.count, default="")
    return kind if 2 * kinds_there.count(kind) > len(kinds_there) else ""


PAPER_LAW = Controller().law.kind
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


def ablations(estimator: str, coordination: str) -> list[BenchmarkEntry]:
    """The paper's law as it is, and without each of its parts."""
    whole = [BenchmarkEntry(PAPER_LAW, estimator, coordination), BenchmarkEntry(NO_OBSERVER, estimator, coordination)]
    return whole + [
        BenchmarkEntry(PAPER_LAW, estimator, coordination, variant, settings, held)
        for variant, (settings, held) in VARIANTS.items()
    ]


ROLLOUTS, TEST_SCENARIOS = 30_000, SampleSizes().test
"""Budget of a search, and scenarios of the test set, where nothing else is asked for."""


@dataclass(frozen=True)
class BenchmarkTerms:
    """What is the same for all.

    Attributes:
        ensemble: its name.
        configuration: the ensemble with the paper's controller, as TOML.
        constraints: of all searches.
        method: name of the optimiser.
        rollouts: budget of each search.
        scenarios: of the training set.
        test_scenarios: of the test set, which score.
        seed: of scenarios and searches.
    """

    ensemble: str
    configuration: str
    constraints: tuple[str, ...]
    method: str
    rollouts: int
    scenarios: int
    test_scenarios: int
    seed: int

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` where a number is out of range."""
        for name, least in (("rollouts", 1), ("test_scenarios", 2)):
            whole_number(name, getattr(self, name), least)

    @property
    def test_seed(self) -> int:
        """Seed of the test set, whose scenarios take no part in any search, in its choice and in its own score."""
        return named_seed(self.seed, "benchmark test")

    def to_record(self) -> dict[str, Any]:
        """As JSON holds it."""
        return asdict(self)


@dataclass(frozen=True)
class EntryProblem:
    """An entry, ready to be tuned.

    Attributes:
        entry: its parts.
        problem: what is searched for.
        definition: the problem as data that is kept with the result.
    """

    entry: BenchmarkEntry
    problem: TuningProblem
    definition: Mapping[str, Any]
