"""The entries of a race: a law, an estimator and a coordination, complete or with a part ablated."""

import json
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain, product
from pathlib import Path
from typing import Any

from dualwinch.toolbox import (
    ConfigurationError,
    Controller,
    arguments,
    exogenous_signals,
    parts,
    quantities,
    registries,
    searching,
)

ALL = "all"
"""Name for every kind of a registry."""

LAW = "controller.kind"
"""Key of the law; those of the other two parts are `tuning_problem.ESTIMATOR` and `COORDINATION`."""


@dataclass(frozen=True)
class RaceEntry:
    """One combination of parts to tune.

    Attributes:
        law, estimator, coordination: kinds of its parts.
        variant: the ablation in a few words; empty: none.
        settings: key → value that the ablation sets.
        excluded: keys excluded from the search.
        search: number of the search, from 0; each has its own seed.
    """

    law: str
    estimator: str
    coordination: str
    variant: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    excluded: tuple[str, ...] = ()
    search: int = 0

    @property
    def key(self) -> str:
        """Unique key: its parts, its ablation, and the number of its search unless it is the first."""
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
        """Key of its first search, common to all its searches."""
        return replace(self, search=0).key

    @property
    def values(self) -> dict[str, Any]:
        """All its settings: kinds of parts and those of the ablation."""
        kinds = {LAW: self.law, searching.ESTIMATOR: self.estimator, searching.COORDINATION: self.coordination}
        return kinds | dict(self.settings)


def kinds(asked: Sequence[str] | str | None, registry: parts.Registry[Any], usual: Sequence[str]) -> list[str]:
    """The requested kinds without repetition: one, several or `ALL`; by default the usual ones.

    Raises:
        ConfigurationError: no kind, or an unknown one; the message names the nearest.
    """
    texts = [asked] if isinstance(asked, str) else list(usual if asked is None else asked)
    if not texts:
        raise ConfigurationError(f"no kind is given; known: {', '.join(registry)}, or {ALL}")
    listed = [list(registry) if text == ALL else [registry.find(text).kind] for text in texts]
    return list(dict.fromkeys(chain.from_iterable(listed)))


def combinations(laws: Iterable[str], estimators: Iterable[str], coordinations: Iterable[str]) -> list[RaceEntry]:
    """Every law with every estimator and every coordination."""
    return [RaceEntry(*parts) for parts in product(laws, estimators, coordinations)]


def names(entries: Sequence[RaceEntry]) -> dict[str, str]:
    """Key of each entry → its name among them: its law, its ablation, and parts other than those of most entries.

    All searches of an entry have the same name.
    """
    usual = {part: _usual([getattr(entry, part) for entry in entries]) for part in ("estimator", "coordination")}

    def name(entry: RaceEntry) -> str:
        unusual = (getattr(entry, part) for part, kind in usual.items() if getattr(entry, part) != kind)
        return ", ".join(filter(None, (entry.law, entry.variant, *unusual)))

    return {entry.key: name(entry) for entry in entries}


def _usual(kinds_there: Sequence[str]) -> str:
    """The kind of more than half of the entries; empty if there is none."""
    kind = max(kinds_there, key=kinds_there.count, default="")
    return kind if 2 * kinds_there.count(kind) > len(kinds_there) else ""


PAPER_LAW = Controller().law.kind
"""The paper's law."""

NO_OBSERVER = registries.Nftsm.kind
"""The paper's law without its observer, a law of its own."""

CONSTANT_GAIN, NO_ANTI_SATURATION, LINEAR_SURFACE = (
    "constant observer gain",
    "without anti-saturation",
    "linear surface",
)
"""Names of the ablations."""

VARIANTS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    CONSTANT_GAIN: (
        {"controller.observer.kf": 0.0},
        tuple(f"controller.observer.{name}" for name in ("kf", "error_scale", "rate_scale", "filter_time")),
    ),
    NO_ANTI_SATURATION: (
        {"controller.auxiliary.gamma": 0.0, "controller.auxiliary.gamma_force": 0.0},
        tuple(f"controller.auxiliary.{name}" for name in ("gamma", "gamma_force", "k_a")),
    ),
    # the law needs p > q; with p/q = 1.00002 the surface is linear within 0.03 % above the smoothed speed errors
    LINEAR_SURFACE: (
        {"controller.nftsm.p": 100_001, "controller.nftsm.q": 99_999},
        ("controller.nftsm.p", "controller.nftsm.q"),
    ),
}
"""Ablation → its settings, and the keys excluded from its search."""


def ablations(estimator: str, coordination: str) -> list[RaceEntry]:
    """The complete law of the paper, and the law without each of its parts."""
    entries = [RaceEntry(PAPER_LAW, estimator, coordination), RaceEntry(NO_OBSERVER, estimator, coordination)]
    return entries + [
        RaceEntry(PAPER_LAW, estimator, coordination, variant, settings, excluded)
        for variant, (settings, excluded) in VARIANTS.items()
    ]


ROLLOUTS, TEST_SCENARIOS = 30_000, searching.TuningOptions().test
"""Default budget of a search, and default number of test scenarios."""


@dataclass(frozen=True)
class RaceTerms:
    """Terms of a race, the same for all entries.

    Attributes:
        ensemble: its name.
        configuration: the ensemble with the paper's controller, as TOML; its comments list all registered parts.
        constraints: of all searches.
        method: name of the optimiser.
        rollouts: budget of each search.
        scenarios: number of training scenarios.
        test_scenarios: number of test scenarios, for the scores.
        seed: of scenarios and searches.
    """

    ensemble: str
    configuration: str = field(compare=False)
    constraints: tuple[str, ...]
    method: str
    rollouts: int
    scenarios: int
    test_scenarios: int
    seed: int

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` for a number out of range."""
        for name, smallest in (("rollouts", 1), ("test_scenarios", 2)):
            arguments.whole_number(name, getattr(self, name), smallest)

    @property
    def test_seed(self) -> int:
        """Seed of the test set; no search, selection or score of a single study uses its scenarios."""
        return exogenous_signals.named_seed(self.seed, "benchmark test")


RACE_FILE = "race.json"
"""File with the result of a race, in its folder."""


def earlier_entries(folder: Path, terms: RaceTerms) -> list[RaceEntry]:
    """Entries of an earlier race on the same terms in a folder, by its `RACE_FILE`; none without that file.

    Raises:
        ConfigurationError: the file has a race on other terms, or is not a race's.
    """
    file = folder / RACE_FILE
    if not file.is_file():
        return []
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        entries = [
            RaceEntry(**{name: entry[name] for name in RECORDED}, search=search["search"])
            for entry in record["entries"]
            for search in entry["searches"]
        ]
        here, there_before = (
            {name: _content(name, each[name]) for name in asdict(terms)} for each in (asdict(terms), record)
        )
        differences = [name for name, value in here.items() if value != there_before[name]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(f"{file}: is not the result of a race; remove it") from error
    for name in differences:
        values = "" if name == TOML else f", {record[name]} and not {getattr(terms, name)}"
        raise ConfigurationError(
            f"{folder}: contains a race with {quantities.another(name)}{values}; give another folder"
        )
    return [replace(entry, excluded=tuple(entry.excluded)) for entry in entries]


RECORDED = ("law", "estimator", "coordination", "variant", "settings", "excluded")
"""Names of what `RACE_FILE` has of an entry."""

TOML = "configuration"
"""Name of the term that is TOML; its comments list all registered parts, so it is compared by content."""


def _content(name: str, value: Any) -> Any:
    return tomllib.loads(value) if name == TOML else list(value) if isinstance(value, tuple) else value
