"""The lab as one HTML file: page, plots, catalogue, compiled loops and a run of one's own; ES modules as one script.

A page that is a single file has nowhere to import from. Each module becomes a function scope, in the order in which
modules need each other, so that equal names in two modules stay apart. Two statements are understood:
``import {a, b} from "./file.js"``, and ``export`` before ``function``, ``async function``, ``class`` and ``const``.
"""

import base64
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.file_formats import plain
from dualwinch.simulation.results.result import Result

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


MOST_NUMBERS = 180_000
"""Numbers of a run that a page takes, 11 bytes each; of a longer run every so many rows."""


def own_run(label: str, result: Result) -> dict[str, Any]:
    """A run as the page takes it, every number of its columns in the eight bytes of a little-endian double.

    Args:
        label: what it is called.
        result: the run, with its rows.

    Returns:
        ``label``, ``outcome``, ``until`` in s, ``metrics``, ``columns``: name → base64, ``units``, and ``settings``:
        key → value of what is not as in the paper's Case 2, as in a file.
    """
    numbers = len(result.columns) * len(result.columns.get("t", ()))
    stride = max(1, -(-numbers // MOST_NUMBERS))
    return {
        "label": label,
        "outcome": result.outcome,
        "until": result.end_time,
        "metrics": plain(dict(result.metrics)),
        "columns": {name: encoded(column[::stride]) for name, column in result.columns.items()},
        "units": result.units,
        "settings": differences(result.experiment),
    }


def encoded(column: NDArray[np.float64]) -> str:
    """Numbers as the page takes them."""
    return base64.b64encode(np.ascontiguousarray(column, "<f8").tobytes()).decode()


def differences(experiment: Experiment) -> dict[str, Any]:
    """Single values that are not as in the paper's Case 2."""
    usual = leaves(Experiment())
    return {
        key: plain(value)
        for key, value in leaves(experiment).items()
        if isinstance(value, (str, bool, int, float)) and value != usual.get(key)
    }


HERE = Path(__file__).parent
PAGE, VENDOR = HERE / "page", HERE / "vendor"
ENGINE = HERE / "engine" / "engine.js"

STYLES = (VENDOR / "uPlot.min.css", PAGE / "style.css")
UNPACKER = VENDOR / "fzstd.min.js"
LIBRARIES = (VENDOR / "uPlot.min.js", VENDOR / "parquet.min.js", UNPACKER)


def assemble(
    catalogue: Mapping[str, Any],
    modules: Mapping[str, bytes],
    run: Mapping[str, Any] | None = None,
    *,
    engine: Path = ENGINE,
) -> str:
    """The page.

    Args:
        catalogue: what can be run and changed, as JSON has it.
        modules: name → WebAssembly; the page unpacks the one it runs.
        run: a run of one's own, shown beside the page's: ``label``, ``columns`` and ``metrics``.
        engine: the module that runs them.
    """
    instead = {ENGINE: engine}
    parts = {
        "style": "\n".join(path.read_text(encoding="utf-8") for path in STYLES),
        "libraries": "\n".join(path.read_text(encoding="utf-8") for path in LIBRARIES),
        "catalogue": _json(catalogue),
        "modules": _json(_packed(modules)),
        "run": _json(run),
        "worker": UNPACKER.read_text(encoding="utf-8") + bundle(PAGE / "worker.js", instead),
        "main": bundle(PAGE / "main.js", instead),
    }
    page = (PAGE / "index.html").read_text(encoding="utf-8")
    return re.sub(r"/\* (\w+) \*/", lambda match: parts[match[1]].replace("</script", "<\\/script"), page)


def _packed(modules: Mapping[str, bytes]) -> dict[str, Any]:
    """Modules in one Zstandard frame: what they have in common, which is most of them, is kept once."""
    import pyarrow as pa

    frame = pa.Codec("zstd", compression_level=19).compress(b"".join(modules.values()), asbytes=True)
    return {"names": {name: len(code) for name, code in modules.items()}, "zstd": base64.b64encode(frame).decode()}


def _json(content: object) -> str:
    """JSON that may stand in a script element."""
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
