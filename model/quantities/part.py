"""Parts: objects that own their gains and are chosen among their likes, such as a position law.

A part is a frozen dataclass of its own gains with a `kind`, its name in files and on command lines. Its keys stand in
the table of what it is part of: a number ``k`` of the part ``mine`` of ``controller`` is ``controller.mine.k``, and a
group of numbers keeps the name of its field, ``controller.observer.l0``. So parts that share a group share its keys.
"""

from abc import ABC
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import nearest


class Part(ABC):
    """Base of everything that is chosen by its kind.

    Attributes:
        kind: name in files and on command lines, such as ``pid-cascade``.
        label: name in figures and tables; default: the kind.
        colour: in figures, as matplotlib names it; default: the next that is free.
        dashes: line style in figures, as matplotlib names it; default: solid.
    """

    kind: ClassVar[str]
    label: ClassVar[str] = ""
    colour: ClassVar[str] = ""
    dashes: ClassVar[Any] = ""

    @classmethod
    def table(cls) -> str:
        """The table of its own numbers: the kind, as it is written in a key; empty: they need no table of their own."""
        return cls.kind.replace("-", "_")


PartType = TypeVar("PartType", bound=Part)


class Registry(Mapping[str, type[PartType]], Generic[PartType]):
    """Parts that files and command lines know, by kind; in the order they are listed to people."""

    def __init__(self, what: str, *parts: type[PartType]) -> None:
        """Make a registry.

        Args:
            what: what its parts are, in one or two words, e.g. ``position law``.
            parts: the built-in ones.
        """
        self.what = what
        self._parts = {part.kind: part for part in parts}

    def __getitem__(self, kind: str) -> type[PartType]:
        return self._parts[kind]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def __hash__(self) -> int:
        return id(self)

    def find(self, kind: Any) -> type[PartType]:
        """The part of a kind.

        Raises:
            ConfigurationError: there is none; the message lists all and names the nearest.
        """
        if isinstance(kind, str) and kind in self._parts:
            return self._parts[kind]
        near, known = nearest(str(kind).lower(), self._parts), ", ".join(self._parts)
        raise ConfigurationError(f"unknown {self.what} {kind!r}; did you mean '{near}'? Must be one of {known}")


@dataclass(frozen=True)
class Choice:
    """A field that holds a part.

    Attributes:
        key: of the part's kind.
        registry: knows the other kinds.
        table: where the part's keys stand below its owner; default: beside the owner's own.
    """

    key: str
    registry: Registry[Any]
    table: str = ""
