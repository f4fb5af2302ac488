"""Parts: objects that own their gains and are chosen by their kind, such as a position law.

A part is a frozen dataclass of its gains with a `kind`, its name in files and on command lines. Its keys stand in the
table of its owner: a number ``k`` of the part ``mine`` of ``controller`` is ``controller.mine.k``, and a group of
numbers keeps the name of its field, ``controller.observer.l0``. Parts with a common group therefore share its keys.

An invalid class raises a one-line error with the correction (`check_class`). Files that record a part note the source
of its class (`source_of`) and a `digest` of it.
"""

import hashlib
import inspect
import re
import site
import sys
import sysconfig
from abc import ABC
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Generic, Self, TypeVar, get_origin, get_type_hints

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import unknown

PACKAGE = __name__.partition(".")[0]

PLUGIN = "_plugin_of_dualwinch_"
"""Prefix of the names of modules imported from a file by its path."""


def built_in(part: type) -> bool:
    """Whether a part belongs to the product."""
    return part.__module__.partition(".")[0] == PACKAGE


def source_of(part: type) -> str:
    """Source of a part: the path of a script or named file, else the name of its module."""
    module = sys.modules.get(part.__module__)
    path = _path(module) if module else None
    if path and (part.__module__ == "__main__" or part.__module__.startswith(PLUGIN)):
        return str(path)
    return part.__module__


def origin(part: type) -> tuple[str, str]:
    """Identity of a part across repeated definitions, as by a notebook's cell: its file, else module, and its name.

    One file may have several module names.
    """
    module = sys.modules.get(part.__module__)
    path = _path(module) if module else None
    return str(path or part.__module__), part.__qualname__


def named(part: type) -> str:
    """Name of a part in errors: its class and source."""
    source, name = source_of(part), part.__qualname__.rpartition("<locals>.")[2]
    return f"{name} of {Path(source).name}" if source.endswith(".py") else f"{source}.{name}"


def digest(part: type) -> str:
    """SHA-256 of the sources that define a part; empty where they cannot be read, as at an interactive prompt.

    These are the modules of its class and base classes, and the modules that these import from the same folder or
    package. Libraries do not count.
    """
    texts = [text_of(module) or text_of(part) for module in modules_of(part)]
    if part.__module__ not in sys.modules or not all(texts):
        return ""
    digests = sorted(hashlib.sha256(text.encode()).hexdigest() for text in texts)
    return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()


def text_of(defined: ModuleType | type) -> str:
    """The source of a module as imported, where its loader keeps that, else the present one; or the source of a class.

    A class in a notebook's cell has a source, the notebook itself has none.
    """
    spec = getattr(defined, "__spec__", None)
    read = getattr(getattr(spec, "loader", None), "get_source", None)
    try:
        return (read(spec.name) if read and spec else inspect.getsource(defined)) or ""
    except (OSError, TypeError, ImportError):
        return ""


def modules_of(part: type) -> list[ModuleType]:
    """The modules that define a part, without those of the product."""
    waiting = [sys.modules[base.__module__] for base in part.__mro__ if _counts(base.__module__)]
    modules: dict[str, ModuleType] = {}
    while waiting:
        module = waiting.pop()
        if module.__name__ not in modules:
            modules[module.__name__] = module
            waiting += _companions(module)
    return list(modules.values())


def _counts(name: str) -> bool:
    top = name.partition(".")[0]
    return name in sys.modules and top != PACKAGE and top not in sys.stdlib_module_names


def _companions(module: ModuleType) -> Iterator[ModuleType]:
    """Modules in the same folder or package from which a module imports names."""
    for value in list(vars(module).values()):
        name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
        other = sys.modules.get(name) if isinstance(name, str) else None
        if other and other is not module and _counts(other.__name__) and _beside(other, module):
            yield other


def _beside(other: ModuleType, module: ModuleType) -> bool:
    top = module.__name__.partition(".")[0]
    if other.__name__.partition(".")[0] == top:
        return True
    other_path, path = _path(other), _path(module)
    return other_path is not None and path is not None and other_path.parent == path.parent not in _libraries()


def _path(module: ModuleType) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file).resolve() if file and Path(file).is_file() else None


@cache
def _libraries() -> frozenset[Path]:
    """Folders of installed modules, which are unrelated to each other."""
    folders = [*sysconfig.get_paths().values(), *site.getsitepackages(), site.getusersitepackages()]
    return frozenset(Path(folder).resolve() for folder in folders)


KIND_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*([-_][A-Za-z0-9]+)*")
"""Kinds that are valid in keys, on command lines and in the names of functions."""

OF_THE_CLASS = ("kind", "label", "colour", "dashes", "rules")
"""Class attributes of a part, which are no fields."""


@cache
def check_class(part: type) -> None:
    """Raise `ConfigurationError` unless a class is a frozen dataclass with a kind and the methods its base requires."""
    _check_fields(part)
    _check_kind(part)
    for method, signature in _asked_for(part).items():
        _check_method(part, method, signature)


def _check_fields(part: type) -> None:
    if not _frozen(part):
        raise ConfigurationError(f"{named(part)}: write @dataclass(frozen=True) right above the class")
    names, hints = {field.name for field in fields(part)}, _hints(part)
    for field in OF_THE_CLASS:
        if field in names:
            raise ConfigurationError(f"{named(part)}: {field} must be no field; write {field}: ClassVar = ...")
    for field in inspect.get_annotations(part):
        hint = hints[field]
        if field not in names and hint is not ClassVar and get_origin(hint) is not ClassVar:
            raise ConfigurationError(
                f"{named(part)}: {field} is no field of it; write @dataclass(frozen=True) right above the class"
            )
    for field in names:
        if is_dataclass(hints[field]) and not _frozen(hints[field]):
            raise ConfigurationError(f"{named(hints[field])}: write @dataclass(frozen=True) right above the class")


def _hints(part: type) -> dict[str, Any]:
    try:
        return get_type_hints(part)
    except NameError as error:  # of annotations that are kept as text
        raise ConfigurationError(
            f"{named(part)}: {error}; its annotations take names from the top of its file"
        ) from error


def check_defaults(part: type) -> None:
    """Raise `ConfigurationError` where a field of a part has no default."""
    for field in fields(part):
        if field.init and field.default is MISSING and field.default_factory is MISSING:
            raise ConfigurationError(
                f"{named(part)}: {field.name} has no default; write {field.name}: Annotated[...] = ..."
            )


def _frozen(group: Any) -> bool:
    parameters = getattr(group, "__dataclass_params__", None)
    return parameters is not None and parameters.frozen and parameters.eq


def _check_kind(part: type) -> None:
    kind = getattr(part, "kind", None)
    if not isinstance(kind, str) or not KIND_NAME.fullmatch(kind):
        fitting = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", part.__name__).strip("_").lower()
        wrong = "has no kind" if kind is None else f"kind = {kind!r} must be of letters, digits and single hyphens"
        raise ConfigurationError(f'{named(part)}: {wrong}; write kind: ClassVar = "{fitting}"')


def _asked_for(part: type) -> dict[str, Any]:
    """The abstract methods of a part's bases, by name."""
    return {
        method: vars(base)[method]
        for base in part.__mro__
        for method in getattr(base, "__abstractmethods__", ())
        if method in vars(base)
    }


def _check_method(part: type, method: str, asked: Any) -> None:
    if not inspect.isfunction(asked):
        return
    function, parameters = getattr(part, method), list(inspect.signature(asked).parameters)
    written = f"write def {method}({', '.join(parameters)})"
    if getattr(function, "__isabstractmethod__", False):
        raise ConfigurationError(f"{named(part)}: has no {method}; {written}")
    try:
        inspect.signature(function).bind(*parameters)
    except TypeError:
        raise ConfigurationError(f"{named(part)}: its {method} takes other arguments; {written}") from None


@dataclass(frozen=True)
class NoState:
    """The empty state of a component without memory."""


NO_STATE = NoState()
"""The empty state."""


class Part(ABC):
    """Base of everything that is chosen by its kind.

    A direct subclass is the base of one sort of part, such as of all position laws, and defines its methods.

    Attributes:
        registry: registry of the parts with this base; an attribute of the base.
        kind: name in files and on command lines, such as ``pid-cascade``.
        label: name in figures and tables; default: the kind.
        colour: colour in figures, a matplotlib name; default: the next free one.
        dashes: line style in figures, a matplotlib name; default: solid.
    """

    registry: "ClassVar[Registry[Any] | None]" = None
    kind: ClassVar[str]
    label: ClassVar[str] = ""
    colour: ClassVar[str] = ""
    dashes: ClassVar[Any] = ""

    def __new__(cls, *_: Any, **__: Any) -> Self:
        """Raise `ConfigurationError` where the class is no valid part."""
        check_class(cls)
        return super().__new__(cls)

    @classmethod
    def table(cls) -> str:
        """Name of the table of its own numbers: the kind with underscores; empty: no table."""
        return cls.kind.replace("-", "_")


def base_of(part: type[Part]) -> type[Part]:
    """The base of a part: its ancestor that is a direct subclass of `Part`."""
    return next(base for base in part.__mro__ if Part in base.__bases__)


HOW_TO_REGISTER = "a kind of your own: dw.register(YourClass), or --plugin FILE"
"""Hint of errors about an unknown kind."""

PartType = TypeVar("PartType", bound=Part)


class Registry(Mapping[str, type[PartType]], Generic[PartType]):
    """Parts of one base that files and command lines accept, by kind, in the order of listings."""

    def __init__(self, what: str, *parts: type[PartType], base: type[PartType] | None = None) -> None:
        """Make a registry.

        Args:
            what: noun for its parts in messages, e.g. ``position law``.
            parts: the built-in parts; this becomes the registry of their common base.
            base: their base, where there are no built-in parts.
        """
        self.what = what
        self._parts = {part.kind: part for part in parts}
        bases = {base} if base else set(map(base_of, parts))
        if len(bases) == 1:
            bases.pop().registry = self

    @contextmanager
    def adding(self, part: type[PartType]) -> Iterator[None]:
        """Add a part, and remove it again if the context raises an error; a part defined again replaces the old one.

        Raises:
            ConfigurationError: the class is no valid part, or its kind is that of another.
        """
        check_class(part)
        namesake, before = self._parts.get(part.kind), dict(self._parts)
        if namesake is not None and origin(namesake) != origin(part):
            raise ConfigurationError(
                f"{self.what} '{part.kind}' is {named(namesake)}; give {named(part)} a kind of its own"
            )
        self._parts[part.kind] = part
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
            ConfigurationError: unknown kind; the message lists all and suggests the nearest.
        """
        if isinstance(kind, str) and kind in self._parts:
            return self._parts[kind]
        raise ConfigurationError(unknown(self.what, kind, self._parts, f" ({HOW_TO_REGISTER})"))


def registries() -> Iterator[Registry[Any]]:
    """All registries."""
    yield from (base.registry for base in Part.__subclasses__() if base.registry is not None)


@dataclass(frozen=True)
class PartChoice:
    """A field that holds a part.

    Attributes:
        key: key of the part's kind.
        registry: registry of all kinds.
        table: table of the part's keys below its owner; default: that of the owner.
        several: whether the field holds a tuple of parts, no two of a kind.
    """

    key: str
    registry: Registry[Any]
    table: str = ""
    several: bool = False
