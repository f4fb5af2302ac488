"""ES modules as one script: a page that is a single file has nowhere to import from.

Each module becomes a function scope of its own, in the order in which modules need each other, so that equal names in
two modules stay apart. What is understood is what the page's modules use: ``import {a, b} from "./file.js"`` and
``export`` before ``function``, ``async function``, ``class`` and ``const``.
"""

import re
from collections.abc import Mapping
from pathlib import Path

IMPORT = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"(\.[^"]+)";[ \t]*$', re.MULTILINE)
EXPORT = re.compile(r"^export\s+((?:async\s+)?function\*?|class|const)\s+(\w+)", re.MULTILINE)


def bundle(entry: Path, instead: Mapping[Path, Path] | None = None) -> str:
    """One script of a module and all that it imports.

    Args:
        entry: the module to start from; what it exports is dropped.
        instead: file → the file that is read in its stead.

    Raises:
        ValueError: modules import each other in a circle, or in a way that is not understood.
    """
    scopes: dict[Path, str] = {}
    _add(entry.resolve(), scopes, {key.resolve(): path for key, path in (instead or {}).items()}, ())
    return "\n".join(scopes.values())


def _add(path: Path, scopes: dict[Path, str], instead: Mapping[Path, Path], above: tuple[Path, ...]) -> None:
    """Add the scope of a module, behind those of the modules it needs."""
    if path in above:
        raise ValueError(f"{path.name}: imports itself, by way of {', '.join(file.name for file in above)}")
    if path in scopes:
        return
    text = instead.get(path, path).read_text(encoding="utf-8")
    needed = {match[2]: (path.parent / match[2]).resolve() for match in IMPORT.finditer(text)}
    for module in needed.values():
        _add(module, scopes, instead, (*above, path))
    body = IMPORT.sub(lambda match: f"const {{{match[1].replace(' as ', ': ')}}} = {_scope(needed[match[2]])};", text)
    names = [match[2] for match in EXPORT.finditer(body)]
    body = EXPORT.sub(r"\1 \2", body)
    left = re.search(r"^(import|export)\b.*", body, re.MULTILINE)
    if left:
        raise ValueError(f"{path.name}: cannot bundle {left[0]!r}")
    scopes[path] = f"const {_scope(path)} = (() => {{\n{body.strip()}\nreturn {{{', '.join(names)}}};\n}})();"


def _scope(path: Path) -> str:
    """Name of the object that holds what a module exports."""
    return "module_" + re.sub(r"\W", "_", f"{path.parent.name}_{path.stem}")
