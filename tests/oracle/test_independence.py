import ast
import sys
from pathlib import Path

import pytest

ALLOWED = {"numpy", "scipy", "tests.oracle"}
FILES = [file for file in Path(__file__).parent.glob("*.py") if not file.name.startswith("test_")]


def imported_modules(file: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add("." * node.level + (node.module or ""))
    return names


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_oracle_uses_nothing_of_the_product(file: Path) -> None:
    for name in imported_modules(file):
        known = name.split(".")[0] in sys.stdlib_module_names or any(
            name == module or name.startswith(module + ".") for module in ALLOWED
        )
        assert known, f"{file.name} imports {name}"


def test_the_scan_sees_the_oracle() -> None:
    assert {"plant", "laws", "sampled", "collocation", "scipy_solver"} <= {file.stem for file in FILES}
