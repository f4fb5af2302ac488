"""The lab as one HTML file: page, plots, catalogue and compiled loops, nothing to load from elsewhere."""

import base64
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dualwinch.lab.bundle import bundle

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
