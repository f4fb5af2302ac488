"""Parts: objects that own their gains and are chosen among their likes, such as a position law.

A part is a frozen dataclass of its own gains with a `kind`, its name in files and on command lines. Its keys stand in
the table of what it is part of: a number ``k`` of the part ``mine`` of ``controller`` is ``controller.mine.k``, and a
group of numbers keeps the name of its field, ``controller.observer.l0``. So parts that share a group share its keys.
"""

from abc import ABC
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Self, TypeVar

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.origin import named, origin
from dualwinch.model.quantities.quantity import nearest
from dualwinch.model.quantities.wrong_parts import check_class


class Part(ABC):
    """Base of everything that is chosen by its kind.

    A class that subclasses it directly is a base, such as that of all position laws: it says what a part has to do.

    Attributes:
        registry: of the parts that share a base; it stands at the base.
        kind: name in files and on command lines, such as ``pid-cascade``.
        label: name in figures and tables; default: the kind.
        colour: in figures, as matplotlib names it; default: the next that is free.
        dashes: line style in figures, as matplotlib names it; default: solid.
    """

    registry: "ClassVar[Registry[Any] | None]" = None
    kind: ClassVar[str]
    label: ClassVar[str] = ""
    colour: ClassVar[str] = ""
    dashes: ClassVar[Any] = ""

    def __new__(cls, *_: Any, **__: Any) -> Self:
        """Raise `ConfigurationError` where the class is none that a part can have."""
        check_class(cls)
        return super().__new__(cls)

    @classmethod
    def table(cls) -> str:
        """The table of its own numbers: the kind, as it is written in a key; empty: they need no table of their own."""
        return cls.kind.replace("-", "_")


def base_of(part: type[Part]) -> type[Part]:
    """The base of a part: the class it is made from that subclasses `Part` directly."""
    return next(base for base in part.__mro__ if Part in base.__bases__)


HOW_TO_REGISTER = "a kind of your own: dw.register(YourClass), or --plugin FILE"
"""What to do about a kind that is not known."""

PartType = TypeVar("PartType", bound=Part)


class Registry(Mapping[str, type[PartType]], Generic[PartType]):
    """Parts of one base that files and command lines know, by kind; in the order they are listed to people."""

    def __init__(self, what: str, *parts: type[PartType], base: type[PartType] | None = None) -> None:
        """Make a registry.

        Args:
            what: what its parts are, in one or two words, e.g. ``position law``.
            parts: the built-in ones. Where they share a base, this is its registry.
            base: their base, where there are no built-in ones.
        """
        self.what = what
        self._parts = {part.kind: part for part in parts}
        bases = {base} if base else set(map(base_of, parts))
        if len(bases) == 1:
            bases.pop().registry = self

    def register(self, part: type[PartType]) -> None:
        """Add a part; one that is defined again takes the place of what it was.

        Raises:
            ConfigurationError: the class cannot be a part, or its kind is that of another.
        """
        check_class(part)
        known = self._parts.get(part.kind)
        if known is not None and origin(known) != origin(part):
            raise ConfigurationError(
                f"{self.what} '{part.kind}' is {named(known)}; give {named(part)} a kind of its own"
            )
        self._parts[part.kind] = part

    @contextmanager
    def with_part(self, part: type[PartType]) -> Iterator[None]:
        """Add a part as `register` does, for good where nothing is wrong with it in there."""
        before = dict(self._parts)
        self.register(part)
        try:
            yield
        except BaseException:
            self._parts = before
            raise

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
        if not self._parts:
            raise ConfigurationError(f"unknown {self.what} {kind!r}: none is registered ({HOW_TO_REGISTER})")
        near, known = nearest(str(kind).lower(), self._parts), ", ".join(self._parts)
        raise ConfigurationError(
            f"unknown {self.what} {kind!r}; did you mean '{near}'? Must be one of {known} ({HOW_TO_REGISTER})"
        )


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


@dataclass(frozen=True)
class Choices:
    """A field that holds a tuple of parts, no two of a kind, and the registry that knows the kinds there are."""

    registry: Registry[Any]
