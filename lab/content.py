"""What the lab is made of, catalogue and modules: built once and kept in the cache folder."""

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

from dualwinch.codegen.cache import cache_folder
from dualwinch.codegen.compiler import fingerprint
from dualwinch.codegen.errors import CacheError
from dualwinch.codegen.files import atomic
from dualwinch.lab.catalogue import catalogue
from dualwinch.lab.wasm.build import WASM_FLAGS, modules, wasm_compiler
from dualwinch.lab.wasm.structures import LabStructure, structures
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.progress import Progress, no_progress

PACKAGE = Path(__file__).parents[1]
"""The folder that holds the product's packages."""

MADE_FROM = ("codegen", "model", "controllers", "simulation", "lab/wasm", "lab/catalogue.py")
"""Files and folders that the content follows from."""

SUFFIXES = {".py", ".c", ".h", ".toml"}

DAMAGED = (OSError, EOFError, zlib.error, ValueError, KeyError, TypeError, AttributeError)
"""What reading a file raises that is not there, or is not what it was."""

KEPT_CONTENTS = 4
"""Contents kept; the ones made longest ago go first."""


@dataclass(frozen=True)
class Content:
    """What the page is filled with.

    Attributes:
        catalogue: what can be run and changed (`lab.catalogue`).
        modules: name → WebAssembly.
    """

    catalogue: dict[str, Any]
    modules: dict[str, bytes]


def content(
    rig: Ensemble, version: str, *, offered: Sequence[LabStructure] | None = None, progress: Progress = no_progress
) -> Content:
    """Catalogue and modules, from the cache folder or newly built.

    Args:
        rig: the ensemble that the page draws machines from.
        version: of the product.
        offered: the structures; default: all of the lab.
        progress: called now and then with the share that is done.

    Raises:
        CompilerNotFoundError: zig is not installed.
        CompileError: it failed.
        CacheError: the cache folder cannot be used.
    """
    offered = structures() if offered is None else tuple(offered)
    compiler = wasm_compiler()
    names = ",".join(structure.id for structure in offered)
    key = fingerprint(version, compiler.version, *WASM_FLAGS, installed("casadi"), names, repr(rig), _sources())
    file = cache_folder() / f"lab-{key}.json.gz"
    with contextlib.suppress(*DAMAGED):
        return _read(file)
    built = _built(offered, rig, version, progress)
    try:
        _write(file, built)
    except OSError as error:
        raise CacheError(f"cannot write to the cache folder {file.parent}: {error.strerror}") from error
    return built


def _built(offered: Sequence[LabStructure], rig: Ensemble, version: str, progress: Progress) -> Content:
    found = {}
    for structure, code in zip(offered, modules(structure.module for structure in offered), strict=True):
        found[structure.id] = code
        progress(len(found) / (len(offered) + 1))
    described = catalogue(offered, rig, version)
    progress(1.0)
    return Content(described, found)


def _sources() -> str:
    """A digest of all files that the content follows from."""
    digest = hashlib.sha256()
    for path in (PACKAGE / name for name in MADE_FROM):
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.suffix in SUFFIXES:
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _read(file: Path) -> Content:
    kept = json.loads(gzip.decompress(file.read_bytes()))
    return Content(kept["catalogue"], {name: base64.b64decode(code) for name, code in kept["modules"].items()})


def _write(file: Path, made: Content) -> None:
    packed = {name: base64.b64encode(code).decode() for name, code in made.modules.items()}
    text = json.dumps({"catalogue": made.catalogue, "modules": packed})
    with atomic(file) as unfinished:
        unfinished.write_bytes(gzip.compress(text.encode()))
    before = sorted(file.parent.glob("lab-*.json.gz"), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in before[KEPT_CONTENTS:]:
        path.unlink(missing_ok=True)
