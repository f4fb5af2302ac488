"""The command ``doctor``: versions, compiler, cache and processor of this machine."""

from __future__ import annotations

import os
import sys
from typing import Any

from rich.table import Table

from dualwinch.cli.options import Json
from dualwinch.cli.output import print_json, terminal, versions


def doctor(*, json: Json = False) -> None:
    """Show which compiler, cache folder, processor features and optional parts are in use."""
    facts = findings()
    if json:
        print_json({"units": {"size": "MB", "most": "MB", "unused": "d"}, **facts})
        return
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for part, what in facts.items():
        table.add_row(part, what["text"] if isinstance(what, dict) else what)
    terminal().print(table)


OPTIONAL = {
    "control": "python-control, for linear systems as its StateSpace (extra: control)",
    "ziglang": "a C compiler as a Python package (extra: zig)",
}


def findings() -> dict[str, str | dict[str, Any]]:
    """Part → finding in words, or what to install where it is missing; for the cache a mapping with its figures."""
    from importlib.metadata import PackageNotFoundError, version

    from dualwinch.codegen.cache import cache_folder, cache_limits, libraries
    from dualwinch.codegen.compiler import find_compiler, processor_name, vector_features
    from dualwinch.codegen.errors import DualwinchError

    facts: dict[str, str | dict[str, Any]] = {**versions()}
    facts["python"] = f"{facts['python']} ({sys.executable})"
    for name, purpose in OPTIONAL.items():
        try:
            facts[name] = version(name)
        except PackageNotFoundError:
            facts[name] = f"not installed; {purpose}"
    try:
        compiler = find_compiler()
        facts["C compiler"] = f"{compiler.version} ({' '.join(compiler.command)})"
        facts["flags"] = " ".join(compiler.flags)
    except DualwinchError as error:
        facts["C compiler"] = str(error)
    try:
        folder, limits = cache_folder(), cache_limits()
        stored = libraries(folder)
        size = sum(file.stat().st_size for file in stored) / 1e6
        limit = f"at most {limits.megabytes:g} MB, unused for {limits.days:g} days"
        text = f"{folder} ({len(stored)} libraries, {size:.1f} MB; {limit})"
        facts["cache"] = {"text": text, "folder": str(folder), "libraries": len(stored), "size": size}
        facts["cache"] |= {"most": limits.megabytes, "unused": limits.days}
    except DualwinchError as error:
        facts["cache"] = str(error)
    facts["processor"] = f"{processor_name()}, {os.cpu_count()} cores"
    facts["vector instructions"] = ", ".join(vector_features()) or "none known"
    return facts
