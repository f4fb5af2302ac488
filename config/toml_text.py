"""TOML text: reading with errors that name file and line, and writing of values."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import takewhile
from os import PathLike
from pathlib import Path
from typing import Any

from dualwinch.codegen.text import unicode_text
from dualwinch.model.arguments import path_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import with_point


@dataclass(frozen=True)
class Source:
    """A TOML text and its origin.

    Attributes:
        name: of the text in errors, such as the file's path.
        text: the text itself.
        folder: base of relative paths in it.
    """

    name: str
    text: str
    folder: Path = Path()

    def table(self) -> dict[str, Any]:
        """Parse the text.

        Raises:
            ConfigurationError: not valid TOML.
        """
        try:
            return _parsed(self.text)
        except ConfigurationError as error:
            raise ConfigurationError(f"{self.name}: {error}") from error
        except tomllib.TOMLDecodeError as error:
            line = re.search(r"at line (\d+)", str(error))
            value = self.text.splitlines()[int(line[1]) - 1].partition("#")[0].partition("=")[2] if line else ""
            raise ConfigurationError(f"{self.name}: not valid TOML: {error}{with_point(value)}") from error

    @contextmanager
    def located(self, key: str) -> Iterator[None]:
        """Put name and line of a key before the message of a `ConfigurationError`."""
        try:
            yield
        except ConfigurationError as error:
            raise ConfigurationError(f"{self.name}{_line_of(key, self.text)}: {error}") from error


def read_source(path: str | PathLike[str]) -> Source:
    """Read a file.

    Raises:
        ConfigurationError: it cannot be read, or is neither UTF-8 nor UTF-16 with a byte order mark.
    """
    path = path_of("file", path)
    try:
        return Source(str(path), unicode_text(path.read_bytes()), path.parent)
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(
            f"{path}: not UTF-8 text (byte {error.start}: 0x{error.object[error.start]:02x}); save it as UTF-8"
        ) from error


def head_comment(text: str, name: str) -> str:
    """The value of a name in the comments at the head of a TOML text, such as ``# ensemble: sea``; empty if absent."""
    for line in takewhile(lambda line: line.startswith("#"), text.splitlines()):
        label, _, words = line.lstrip("# ").partition(":")
        if label == name:
            return words.strip()
    return ""


DEEPEST = 50
"""Deepest nesting of tables and lists."""


def _parsed(text: str) -> dict[str, Any]:
    """Parse a TOML text.

    Raises:
        tomllib.TOMLDecodeError: not valid TOML.
        ConfigurationError: integers of thousands of digits, or nesting that is too deep.
    """
    too_deep = f"is nested too deep, must be at most {DEEPEST} tables and lists within each other"
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise ConfigurationError(too_deep) from None
    except ValueError as error:  # a whole number of more digits than Python reads
        raise ConfigurationError("has a whole number of thousands of digits, must be a 64-bit number") from error
    level: list[Any] = [table]
    for _ in range(DEEPEST):
        level = [inner for outer in level for inner in (outer.values() if isinstance(outer, dict) else outer)]
        level = [inner for inner in level if isinstance(inner, (dict, list))]
    if level:
        raise ConfigurationError(too_deep)
    return table


def flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of nested tables."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from flattened(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def empty_tables(table: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Dotted names of tables without any key."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from empty_tables(value, f"{prefix}{name}.") if value else (prefix + name,)


def parse_assignment(text: str) -> tuple[str, Any]:
    """Parse ``key=value``, the value as in TOML or as words without quotes.

    Raises:
        ConfigurationError: no key or no ``=``, or a value that TOML parses but no key can have.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ConfigurationError(f"{text!r}: must be key=value, e.g. plant.vehicle.mass=1.1e4")
    try:
        parsed = _parsed(f"value = {value.strip()}")
        return key.strip(), parsed["value"] if len(parsed) == 1 else value.strip()
    except ConfigurationError as error:
        raise ConfigurationError(f"{key.strip()}: {error}") from error
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def toml_value(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and abs(value) >= 1e6 and float(f"{value:g}") == value:
        return f"{value:g}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, str):
        text = value.encode("utf-8", errors="replace").decode("utf-8")  # TOML cannot hold lone surrogates
        return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def _line_of(key: str, text: str) -> str:
    """``:LINE`` of a key in a TOML text; empty if it is not found, such as in an inline table."""
    table = ""
    for number, line in enumerate(text.splitlines(), start=1):
        header = re.match(r"\s*\[\s*([\w.\-]+)\s*\]", line)
        if header:
            table = header.group(1) + "."
        name = re.match(r"\s*\"?([\w.\-]+)\"?\s*=", line)
        if (name and table + name.group(1) == key) or (header and header.group(1) == key):
            return f":{number}"
    return ""
