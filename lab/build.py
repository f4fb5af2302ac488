"""The lab as one file: catalogue and modules of every structure, put into the page; kept in the cache folder."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from dualwinch.codegen.cache import cache_folder
from dualwinch.codegen.compiler import fingerprint
from dualwinch.codegen.files import atomic
from dualwinch.lab.assemble import assemble
from dualwinch.lab.catalogue.catalogue import catalogue
from dualwinch.lab.wasm.build import module, wasm_compiler
from dualwinch.lab.wasm.structures import Structure, structures
from dualwinch.simulation.ensembles.ensemble import Ensemble

TOP = Path(__file__).parents[1]
"""Where the product's packages stand."""


def build(
    rig: Ensemble,
    version: str,
    *,
    run: Mapping[str, Any] | None = None,
    offered: Sequence[Structure] | None = None,
    progress: Callable[[float], None] | None = None,
) -> str:
    """The page as HTML text, all in one.

    Args:
        rig: the ensemble that the page draws machines from.
        version: of the product.
        run: a run of one's own, shown beside the page's: ``label``, ``columns``, ``metrics``, ``settings``.
        offered: the structures; default: all of the lab.
        progress: called now and then with the share that is done.

    Raises:
        CompilerNotFoundError: zig is not installed.
        CompileError: it failed.
        CacheError: the cache folder cannot be used.
    """
    wasm_compiler()
    offered = tuple(offered or structures())
    content, modules = _content(offered, rig, version, progress)
    return assemble(content, modules, run)


def _content(
    offered: Sequence[Structure], rig: Ensemble, version: str, progress: Callable[[float], None] | None
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Catalogue and modules."""
    modules = {}
    for count, structure in enumerate(offered, start=1):
        modules[structure.id] = module(structure.module)
        if progress:
            progress(count / (len(offered) + 1))
    content = catalogue(offered, rig, version)
    if progress:
        progress(1.0)
    return content, modules
