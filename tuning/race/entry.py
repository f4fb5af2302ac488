"""Who takes part in a race: a law, an estimator and a coordination, as they are or with something held."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from dualwinch.model.quantities.part import Registry

ALL = "all"
"""Stands for every kind of a registry."""

LAW, ESTIMATOR, COORDINATION = "controller.kind", "controller.estimator", "controller.coordination.kind"
"""Keys of the three parts."""


@dataclass(frozen=True)
class Entry:
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


def combinations(laws: Iterable[str], estimators: Iterable[str], coordinations: Iterable[str]) -> list[Entry]:
    """Every law with every estimator and every coordination."""
    return [Entry(*parts) for parts in product(laws, estimators, coordinations)]


def names(entries: Sequence[Entry]) -> dict[str, str]:
    """Key of each entry → what it is called among these: its law, what is changed, and parts that most do not have.

    All searches of an entry are called alike.
    """
    usual = {part: _usual([getattr(entry, part) for entry in entries]) for part in ("estimator", "coordination")}

    def name(entry: Entry) -> str:
        unusual = (getattr(entry, part) for part, kind in usual.items() if getattr(entry, part) != kind)
        return ", ".join(filter(None, (entry.law, entry.variant, *unusual)))

    return {entry.key: name(entry) for entry in entries}


def _usual(kinds_there: Sequence[str]) -> str:
    """The kind that more than half have; empty where there is none."""
    kind = max(kinds_there, key=kinds_there.count, default="")
    return kind if 2 * kinds_there.count(kind) > len(kinds_there) else ""
