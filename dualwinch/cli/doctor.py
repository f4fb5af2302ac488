"""What dualwinch finds on this machine."""

from __future__ import annotations

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version

from cyclopts import App
from rich.table import Table

from dualwinch import __version__
from dualwinch.cli.output import terminal

app = App(name="doctor")


@app.default
def doctor() -> None:
    """Show which compiler, cache folder, processor features and optional parts are in use."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for part, text in findings().items():
        table.add_row(part, text)
    terminal().print(table)


REQUIRED = ("casadi", "numpy", "scipy", "matplotlib", "optuna", "pyarrow")

OPTIONAL = {
    "control": "python-control, for linear systems as its StateSpace (extra: control)",
    "ziglang": "a C compiler as a Python package (extra: zig)",
}


def versions() -> dict[str, str]:
    """Versions of this product, of Python and of what results depend on."""
    return {"dualwinch": __version__, "python": platform.python_version()} | {name: version(name) for name in REQUIRED}


def findings() -> dict[str, str]:
    """Each part → what was found, in words; a missing part says what would help."""
    from dualwinch.codegen.cache import cache_folder, cache_limits, libraries
    from dualwinch.codegen.compiler import find_compiler, processor_name, vector_features
    from dualwinch.codegen.errors import DualwinchError

    found = {"dualwinch": __version__, "python": f"{platform.python_version()} ({sys.executable})"}
    found |= {name: version(name) for name in REQUIRED}
    for name, purpose in OPTIONAL.items():
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = f"not installed; {purpose}"
    try:
        compiler = find_compiler()
        found["C compiler"] = f"{compiler.version} ({' '.join(compiler.command)})"
        found["flags"] = " ".join(compiler.flags)
    except DualwinchError as error:
        found["C compiler"] = str(error)
    try:
        folder = cache_folder()
        kept = libraries(folder)
        size = sum(file.stat().st_size for file in kept) / 1e6
        limits = cache_limits()
        most = f"at most {limits.megabytes:g} MB, unused for {limits.days:g} days"
        found["cache"] = f"{folder} ({len(kept)} libraries, {size:.1f} MB; {most})"
    except DualwinchError as error:
        found["cache"] = str(error)
    found["processor"] = f"{processor_name()}, {os.cpu_count()} cores"
    found["vector instructions"] = ", ".join(vector_features()) or "none known"
    return found
