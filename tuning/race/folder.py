"""Where a race keeps what is finished: a file each, so that it can be gone on with."""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError

ENTRIES = "entries"
"""Folder of the files, in that of the race."""

TOML = "configuration"
"""Name of what is TOML."""

PAPER = "paper"
"""Name of the file with the paper's gains."""


class Folder:
    """What is finished of a race, in a folder or in memory alone."""

    def __init__(self, path: Path | None, terms: Mapping[str, Any]) -> None:
        """Read what is there.

        Args:
            path: folder of the race; ``None``: nothing is kept beyond this object.
            terms: what has to be the same for all, JSON-ready.

        Raises:
            ConfigurationError: what is there was run on other terms, or is nothing of a race.
        """
        self._path = None if path is None else path / ENTRIES
        self._terms = _plain(terms)
        self._records: dict[str, dict[str, Any]] = {}
        if self._path is not None and self._path.is_dir():
            for file in sorted(self._path.glob("*.json")):
                self._records[file.stem] = self._read(file)

    @property
    def stems(self) -> tuple[str, ...]:
        """Names of what is finished."""
        return tuple(self._records)

    def find(self, stem: str, definition: Mapping[str, Any] | None = None) -> dict[str, Any] | None:
        """What is finished under a name; ``None`` where it is not.

        Args:
            stem: the name.
            definition: what it has to be the result of, JSON-ready; ``None``: whatever it is.

        Raises:
            ConfigurationError: it is the result of something else.
        """
        record = self._records.get(stem)
        if record is None:
            return None
        names = _differences(_plain(definition), record["definition"]) if definition is not None else ()
        if names:
            raise ConfigurationError(
                f"{self._path}: {stem}.json was run with another {' and '.join(names)}; remove it, or give another "
                "folder"
            )
        return record["result"]

    def keep(self, stem: str, definition: Mapping[str, Any], result: Mapping[str, Any]) -> None:
        """Keep what is finished.

        Raises:
            OSError: the file cannot be written.
        """
        record = _plain({"terms": self._terms, "definition": definition, "result": result})
        self._records[stem] = record
        if self._path is not None:
            self._path.mkdir(parents=True, exist_ok=True)
            with atomic(self._path / f"{stem}.json") as unfinished:
                unfinished.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")

    def _read(self, file: Path) -> dict[str, Any]:
        try:
            record = json.loads(file.read_text(encoding="utf-8"))
            terms = record["terms"], record["definition"], record["result"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(f"{file}: is nothing that a race has left; remove it") from error
        for name in _differences(self._terms, terms[0]):
            shown = "" if name == TOML else f", {terms[0].get(name)} and not {self._terms[name]}"
            raise ConfigurationError(
                f"{file.parent.parent}: holds a race with another {name}{shown}; give another folder"
            )
        return record


def _differences(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[str]:
    """Names whose values differ; of TOML the content counts, for its comments name every part that is known."""
    return [name for name, value in ours.items() if _content(name, value) != _content(name, theirs.get(name, ""))]


def _content(name: str, value: Any) -> Any:
    return tomllib.loads(value) if name == TOML else value


def _plain(content: Mapping[str, Any]) -> dict[str, Any]:
    """Content as it comes back from a file."""
    return json.loads(json.dumps(content, allow_nan=False))
