"""The lab's engine in Node."""

import base64
import gzip
import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.toolboxes.lab.content import Content, content
from dualwinch.toolboxes.lab.wasm.build import wasm_compiler
from dualwinch.toolboxes.lab.wasm.structures import LabStructure, structures

NODE = shutil.which("node")
ENGINE = Path(__file__).parents[3] / "toolboxes" / "lab" / "engine" / "engine.js"
SCRIPT = Path(__file__).parent / "engine_in_node.mjs"


def zig_is_there() -> bool:
    """Whether modules can be built."""
    try:
        wasm_compiler()
    except CompilerNotFoundError:
        return False
    return True


needs_node = pytest.mark.skipif(NODE is None or not zig_is_there(), reason="needs node and zig")


def of_id(name: str) -> LabStructure:
    """A structure of the lab."""
    return next(structure for structure in structures() if structure.id == name)


def content_of(*names: str) -> Content:
    """Catalogue and modules of some structures, the paper's first."""
    return content(load_ensemble("rig"), "0", offered=[of_id(name) for name in ("fando-nftsm", *names)])


def run_in_node(made: Content, folder: Path, requests: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """What the engine answers to each request, columns as arrays."""
    packed = {name: base64.b64encode(gzip.compress(code)).decode() for name, code in made.modules.items()}
    file = folder / "content.json"
    file.write_text(json.dumps({"catalogue": made.catalogue, "modules": packed}))
    done = subprocess.run(
        [str(NODE), str(SCRIPT), str(ENGINE), str(file)],
        input=json.dumps(requests),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answers = list(map(json.loads, done.stdout.splitlines()))
    for answer in answers:
        columns = answer.get("columns", {})
        answer["columns"] = {name: np.frombuffer(base64.b64decode(text)) for name, text in columns.items()}
    return answers
