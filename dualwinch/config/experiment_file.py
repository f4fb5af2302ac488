"""Configuration files: an experiment as annotated TOML, read back with errors that name key, file and line."""

import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantity import Leaf, describe, leaves, nearest, with_leaves
from dualwinch.model.reference import cruise_speed
from dualwinch.simulation.experiment import Experiment


def load(path: str | Path, base: Experiment | None = None) -> Experiment:
    """Read an experiment from a TOML file.

    Args:
        path: the file; keys it does not have keep their defaults.
        base: what the keys are set on (default: ``Experiment()``).

    Raises:
        ConfigurationError: the file cannot be read, is no TOML, or holds an unknown key or a value out of range.
    """
    return loads(read_text(path), base, path)


def loads(text: str, base: Experiment | None = None, source: str | Path = "configuration") -> Experiment:
    """An experiment from a TOML text.

    Args:
        text: as in a file.
        base: what the keys are set on (default: ``Experiment()``).
        source: where the text comes from, for messages.

    Raises:
        ConfigurationError: it is no TOML, or holds an unknown key or a value out of range.
    """
    values = dict(flattened(parse_toml(text, source)))
    for key, value in values.items():
        with located(source, text, key):
            validated(key, value)
    return override(base or Experiment(), values)


def read_text(path: str | Path) -> str:
    """The text of a file.

    Raises:
        ConfigurationError: it cannot be read, or is not UTF-8.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: not UTF-8 text (byte {error.start})") from error


def parse_toml(text: str, source: str | Path) -> dict[str, Any]:
    """The content of a TOML text.

    Raises:
        ConfigurationError: it is no TOML; the message names the source.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{source}: not valid TOML: {error}") from error


@contextmanager
def located(source: str | Path, text: str, key: str) -> Iterator[None]:
    """Put file and line of a key before the message of a `ConfigurationError`."""
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(f"{source}{_line_of(key, text)}: {error}") from error


def override(experiment: Experiment, values: Mapping[str, Any]) -> Experiment:
    """A copy of an experiment with some values set.

    Args:
        experiment: where the other values come from.
        values: dotted key → value, e.g. ``{"plant.vehicle.mass": 1.1e4}``.

    Raises:
        ConfigurationError: an unknown key, or a value of the wrong type or out of range.
    """
    return with_leaves(experiment, {key: validated(key, value) for key, value in values.items()})


def parse_assignment(text: str) -> tuple[str, Any]:
    """Key and value of ``key=value``; the value is written as in TOML, words without quotes allowed.

    Raises:
        ConfigurationError: there is no ``=``.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ConfigurationError(f"{text!r}: must be key=value, e.g. plant.vehicle.mass=1.1e4")
    try:
        parsed = tomllib.loads(f"value = {value.strip()}")
        return key.strip(), parsed["value"] if len(parsed) == 1 else value.strip()
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def to_toml(experiment: Experiment) -> str:
    """The complete experiment as TOML; each key with unit, meaning, source and range as a comment.

    A value that is taken from elsewhere stands as a comment with the value it takes.
    """
    values = leaves(experiment)
    taken = _taken_from_elsewhere(experiment)
    lines: list[str] = ["# dualwinch experiment; every key has a default, so a file may hold only what differs."]
    for table, keys in _tables(Experiment, ""):
        lines += ["", f"[{table}]"]
        entries = []
        for leaf in keys:
            value, name = values[leaf.key], leaf.key.rsplit(".", 1)[1]
            entry = f"# {name} = {toml_value(taken[leaf.key])}" if value is None else f"{name} = {toml_value(value)}"
            entries.append((entry, _comment(leaf)))
        width = max(len(entry) for entry, _ in entries)
        lines += [f"{entry:<{width}}  # {comment}" for entry, comment in entries]
    return "\n".join(lines) + "\n"


def known_keys() -> dict[str, Leaf]:
    """Every configuration key and what it is."""
    return describe(Experiment)


def _taken_from_elsewhere(experiment: Experiment) -> dict[str, Any]:
    vehicle = experiment.plant.vehicle
    return {
        "controller.nominal.mass": vehicle.mass + vehicle.added_mass,
        "controller.nominal.drag_coefficient": vehicle.drag_coefficient,
        "controller.nominal.friction_coefficient": vehicle.friction_coefficient,
        "reference.jerk_limit": math.inf,
        "reference.speed": cruise_speed(experiment.reference),
        "simulation.duration": experiment.duration,
    }


def _tables(group: type, prefix: str) -> Iterator[tuple[str, list[Leaf]]]:
    """Tables of a nested dataclass in order, each with its own scalars."""
    known = describe(group)
    own = [leaf for leaf in known.values() if "." not in leaf.key]
    if own:
        yield prefix.rstrip("."), [known_keys()[prefix + leaf.key] for leaf in own]
    for field in fields(group):
        if isinstance(field.type, type) and is_dataclass(field.type):
            yield from _tables(field.type, f"{prefix}{field.name}.")


def _comment(leaf: Leaf) -> str:
    quantity = leaf.quantity
    unit = "" if quantity.unit in {"", "1"} else f"[{quantity.unit}] "
    source = f" ({quantity.source})" if quantity.source else ""
    allowed = f"; {leaf.allowed}" if leaf.allowed else ""
    return f"{unit}{quantity.meaning}{allowed}{source}"


def toml_value(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and abs(value) >= 1e6 and float(f"{value:g}") == value:
        return f"{value:g}"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of nested tables."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from flattened(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def validated(key: str, value: Any) -> Any:
    """The value of a key, of the key's type.

    Raises:
        ConfigurationError: an unknown key, or a value of the wrong type or out of range.
    """
    leaf = known_keys().get(key)
    if leaf is None:
        raise ConfigurationError(unknown(key))
    from pydantic import TypeAdapter, ValidationError

    try:
        return TypeAdapter(_strict_type(leaf)).validate_python(value)
    except ValidationError:
        raise ConfigurationError(f"{key} = {_shown(value)}: must be {wanted(leaf)}") from None


def _strict_type(leaf: Leaf) -> Any:
    from pydantic import AllowInfNan, Strict

    strict: list[Any] = [] if leaf.choices else [Strict()]
    if leaf.kind is float:
        strict.append(AllowInfNan(allow_inf_nan=False))
    kind = leaf.kind
    for item in (*strict, *leaf.constraints):
        kind = Annotated[kind, item]
    return kind


def _shown(value: Any) -> str:
    return toml_value(value) if isinstance(value, (bool, int, float, str)) else str(value)


def wanted(leaf: Leaf) -> str:
    """What a value must be, in words."""
    if leaf.choices or leaf.kind is bool:
        return leaf.allowed
    noun = "a whole number" if leaf.kind is int else "a finite number"
    unit = "" if leaf.quantity.unit in {"", "1"} else f" {leaf.quantity.unit}"
    return f"{noun} {leaf.allowed}{unit}".rstrip()


def unknown(key: str) -> str:
    """Say that a key names nothing, and what may be meant."""
    keys = list(known_keys())
    below = [known for known in keys if known.startswith(key + ".")]
    if below:
        return f"{key} is a table; its keys are {', '.join(name.removeprefix(key + '.') for name in below[:6])}" + (
            ", ..." if len(below) > 6 else ""
        )
    return f"unknown key '{key}'; did you mean '{nearest(key, keys)}'?"


def _line_of(key: str, text: str) -> str:
    """``:LINE`` of a key in a TOML text, empty where it is written in a way this does not see."""
    table = ""
    for number, line in enumerate(text.splitlines(), start=1):
        header = re.match(r"\s*\[\s*([\w.\-]+)\s*\]", line)
        if header:
            table = header.group(1) + "."
        name = re.match(r"\s*\"?([\w.\-]+)\"?\s*=", line)
        if name and table + name.group(1) == key:
            return f":{number}"
    return ""
