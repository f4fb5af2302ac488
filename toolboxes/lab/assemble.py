"""The lab as one HTML file: page, plots, catalogue, compiled loops and a user's run, with its ES modules in one script.

A single file cannot import. Each module becomes a function scope, in the order of their imports, so that equal names in
two modules stay apart. Two statements are supported: ``import {a, b} from "./file.js"``, and ``export`` before
``function``, ``async function``, ``class`` and ``const``.
"""

import base64
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import Experiment, Result, file_formats, leaves

IMPORT = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"(\.[^"]+)";[ \t]*$', re.MULTILINE)
EXPORT = re.compile(r"^export\s+((?:async\s+)?function\*?|class|const)\s+(\w+)", re.MULTILINE)


def bundle(entry: Path, instead: Mapping[Path, Path] | None = None) -> str:
    """Bundle a module and all its imports into one script.

    Args:
        entry: the module to start from; its exports are dropped.
        instead: file → file that replaces it.

    Raises:
        ValueError: a circle of imports, or an unsupported import or export.
    """
    scopes: dict[Path, str] = {}
    _add(entry.resolve(), scopes, {key.resolve(): path for key, path in (instead or {}).items()}, ())
    return "\n".join(scopes.values())


def _add(path: Path, scopes: dict[Path, str], instead: Mapping[Path, Path], above: tuple[Path, ...]) -> None:
    """Add the scope of a module, after those of its imports."""
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
    remainder = re.search(r"^(import|export)\b.*", body, re.MULTILINE)
    if remainder:
        raise ValueError(f"{path.name}: cannot bundle {remainder[0]!r}")
    scopes[path] = f"const {_scope(path)} = (() => {{\n{body.strip()}\nreturn {{{', '.join(names)}}};\n}})();"


def _scope(path: Path) -> str:
    """Name of the object with a module's exports."""
    return "module_" + re.sub(r"\W", "_", f"{path.parent.name}_{path.stem}")


MOST_NUMBERS = 180_000
"""Most numbers of a run in a page, 11 bytes each; rows of longer runs are thinned."""


def own_run(label: str, result: Result) -> dict[str, Any]:
    """A run in the page's format, with columns as little-endian doubles in base64.

    Args:
        label: name of the run in the page.
        result: the run, with its rows.

    Returns:
        ``label``, ``outcome``, ``until`` in s, ``metrics``, ``columns``: name → base64, ``units``, and ``settings``:
        key → value in files, where it differs from the paper's Case 2.
    """
    numbers = len(result.columns) * len(result.columns.get("t", ()))
    stride = max(1, -(-numbers // MOST_NUMBERS))
    return {
        "label": label,
        "outcome": result.outcome,
        "until": result.end_time,
        "metrics": file_formats.plain(dict(result.metrics)),
        "columns": {name: encoded(column[::stride]) for name, column in result.columns.items()},
        "units": result.units,
        "settings": differences(result.experiment),
    }


def encoded(column: NDArray[np.float64]) -> str:
    """A column as little-endian doubles in base64."""
    return base64.b64encode(np.ascontiguousarray(column, "<f8").tobytes()).decode()


def differences(experiment: Experiment) -> dict[str, Any]:
    """Values that differ from the paper's Case 2, by key."""
    usual = leaves(Experiment())
    return {
        key: file_formats.plain(value)
        for key, value in leaves(experiment).items()
        if isinstance(value, (str, bool, int, float, tuple)) and value != usual.get(key)
    }


HERE = Path(__file__).parent
PAGE, VENDOR = HERE / "page", HERE / "vendor"
ENGINE = HERE / "engine" / "engine.js"

STYLES = (VENDOR / "uPlot.min.css", PAGE / "style.css")
UNPACKER = VENDOR / "fzstd.min.js"
LIBRARIES = (VENDOR / "uPlot.min.js", VENDOR / "parquet.min.js", VENDOR / "toml.min.js", UNPACKER)


def assemble(
    catalogue: Mapping[str, Any],
    modules: Mapping[str, bytes],
    run: Mapping[str, Any] | None = None,
    *,
    engine: Path = ENGINE,
) -> str:
    """Assemble the page.

    Args:
        catalogue: structures, keys and metrics (`lab.catalogue`), as plain data.
        modules: name → WebAssembly.
        run: the user's run (`own_run`), shown beside the page's.
        engine: the JavaScript module that runs the WebAssembly.
    """
    replacements = {ENGINE: engine}
    parts = {
        "style": "\n".join(path.read_text(encoding="utf-8") for path in STYLES),
        "libraries": "\n".join(path.read_text(encoding="utf-8") for path in LIBRARIES),
        "catalogue": _json(catalogue),
        "modules": _json(_packed(modules)),
        "run": _json(run),
        "worker": UNPACKER.read_text(encoding="utf-8") + bundle(PAGE / "worker.js", replacements),
        "main": bundle(PAGE / "main.js", replacements),
    }
    page = (PAGE / "index.html").read_text(encoding="utf-8")
    return re.sub(r"/\* (\w+) \*/", lambda match: parts[match[1]].replace("</script", "<\\/script"), page)


def _packed(modules: Mapping[str, bytes]) -> dict[str, Any]:
    """Modules in one Zstandard frame, so that their large common part is stored once."""
    import pyarrow as pa

    frame = pa.Codec("zstd", compression_level=19).compress(b"".join(modules.values()), asbytes=True)
    return {"names": {name: len(code) for name, code in modules.items()}, "zstd": base64.b64encode(frame).decode()}


def _json(content: object) -> str:
    """JSON that is safe inside a script element."""
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
