"""Content of the lab, catalogue and modules, built once and kept in the cache folder."""

import base64
import contextlib
import gzip
import hashlib
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

from dualwinch.toolbox import Ensemble, code_cache, compilers, errors, progresses, whole_files
from dualwinch.toolboxes.lab.catalogue import catalogue
from dualwinch.toolboxes.lab.wasm.build import WASM_FLAGS, modules, wasm_compiler
from dualwinch.toolboxes.lab.wasm.structures import LabStructure, structures

PACKAGE = Path(__file__).parents[2]
"""The folder of all packages."""

MADE_FROM = ("codegen", "model", "controllers", "simulation", "toolboxes/lab/wasm", "toolboxes/lab/catalogue.py")
"""Sources of the content; a change of any rebuilds it."""

SUFFIXES = {".py", ".c", ".h", ".toml"}

DAMAGED = (OSError, EOFError, zlib.error, ValueError, KeyError, TypeError, AttributeError)
"""Exceptions of reading a missing or damaged file."""

KEPT_CONTENTS = 4
"""Contents kept in the cache folder; the oldest are deleted first."""


@dataclass(frozen=True)
class Content:
    """Content of the page.

    Attributes:
        catalogue: structures, keys and metrics (`lab.catalogue`).
        modules: name → WebAssembly.
    """

    catalogue: dict[str, Any]
    modules: dict[str, bytes]


def content(
    rig: Ensemble,
    version: str,
    *,
    offered: Sequence[LabStructure] | None = None,
    progress: progresses.Progress = progresses.no_progress,
) -> Content:
    """Catalogue and modules, from the cache folder or newly built.

    Args:
        rig: the ensemble of the page's machines.
        version: of dualwinch.
        offered: the structures; default: all of the lab.
        progress: called with the fraction done.

    Raises:
        CompilerNotFoundError: zig is not installed.
        CompileError: zig failed.
        CacheError: the cache folder cannot be used.
    """
    offered = structures() if offered is None else tuple(offered)
    compiler = wasm_compiler()
    names = ",".join(structure.id for structure in offered)
    key = compilers.fingerprint(
        version, compiler.version, *WASM_FLAGS, installed("casadi"), names, repr(rig), _sources()
    )
    file = code_cache.cache_folder() / f"lab-{key}.json.gz"
    with contextlib.suppress(*DAMAGED):
        return _read(file)
    built = _built(offered, rig, version, progress)
    try:
        _write(file, built)
    except OSError as error:
        raise errors.CacheError(f"cannot write to the cache folder {file.parent}: {error.strerror}") from error
    return built


def _built(offered: Sequence[LabStructure], rig: Ensemble, version: str, progress: progresses.Progress) -> Content:
    modules_by_id = {}
    for structure, code in zip(offered, modules(structure.module for structure in offered), strict=True):
        modules_by_id[structure.id] = code
        progress(len(modules_by_id) / (len(offered) + 1))
    described = catalogue(offered, rig, version)
    progress(1.0)
    return Content(described, modules_by_id)


def _sources() -> str:
    """Digest of all source files of the content."""
    digest = hashlib.sha256()
    for path in (PACKAGE / name for name in MADE_FROM):
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.suffix in SUFFIXES:
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _read(file: Path) -> Content:
    record = json.loads(gzip.decompress(file.read_bytes()))
    return Content(record["catalogue"], {name: base64.b64decode(code) for name, code in record["modules"].items()})


def _write(file: Path, made: Content) -> None:
    packed = {name: base64.b64encode(code).decode() for name, code in made.modules.items()}
    text = json.dumps({"catalogue": made.catalogue, "modules": packed})
    with whole_files.atomic(file) as unfinished:
        unfinished.write_bytes(gzip.compress(text.encode()))
    before = sorted(file.parent.glob("lab-*.json.gz"), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in before[KEPT_CONTENTS:]:
        path.unlink(missing_ok=True)
