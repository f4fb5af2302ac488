"""Classes that cannot be parts: each mistake in one line that says what to write instead."""

import inspect
import re
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, ClassVar, get_origin, get_type_hints

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.origin import named

KIND = re.compile(r"[A-Za-z][A-Za-z0-9]*([-_][A-Za-z0-9]+)*")
"""Words that can stand in keys, on command lines and in the names of functions."""

OF_THE_CLASS = ("kind", "label", "colour", "dashes", "rules")
"""What a part says of itself, which is no number of it."""


@cache
def check_class(part: type) -> None:
    """Raise `ConfigurationError` where a class is no frozen dataclass with a kind and all that its base asks for."""
    _check_fields(part)
    _check_kind(part)
    for method, asked in _asked_for(part).items():
        _check_method(part, method, asked)


def _check_fields(part: type) -> None:
    if not _frozen(part):
        raise ConfigurationError(f"{named(part)}: write @dataclass(frozen=True) right above the class")
    known, hints = {field.name for field in fields(part)}, _hints(part)
    for field in OF_THE_CLASS:
        if field in known:
            raise ConfigurationError(f"{named(part)}: {field} must be no field; write {field}: ClassVar = ...")
    for field in inspect.get_annotations(part):
        hint = hints[field]
        if field not in known and hint is not ClassVar and get_origin(hint) is not ClassVar:
            raise ConfigurationError(
                f"{named(part)}: {field} is no field of it; write @dataclass(frozen=True) right above the class"
            )
    for field in known:
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
    """Raise `ConfigurationError` where a part cannot be made from its kind alone."""
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
    if not isinstance(kind, str) or not KIND.fullmatch(kind):
        fitting = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", part.__name__).strip("_").lower()
        wrong = "has no kind" if kind is None else f"kind = {kind!r} must be of letters, digits and single hyphens"
        raise ConfigurationError(f'{named(part)}: {wrong}; write kind: ClassVar = "{fitting}"')


def _asked_for(part: type) -> dict[str, Any]:
    """The methods that a part's bases want written, by name."""
    return {
        method: vars(base)[method]
        for base in part.__mro__
        for method in getattr(base, "__abstractmethods__", ())
        if method in vars(base)
    }


def _check_method(part: type, method: str, asked: Any) -> None:
    if not inspect.isfunction(asked):
        return
    own, wanted = getattr(part, method), list(inspect.signature(asked).parameters)
    written = f"write def {method}({', '.join(wanted)})"
    if getattr(own, "__isabstractmethod__", False):
        raise ConfigurationError(f"{named(part)}: has no {method}; {written}")
    try:
        inspect.signature(own).bind(*wanted)
    except TypeError:
        raise ConfigurationError(f"{named(part)}: its {method} takes other arguments; {written}") from None
