"""What tuning imports: no circles, lazy imports included, and nothing that Optuna keeps to itself."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = "dualwinch.tuning"


def imported(file: Path) -> set[str]:
    """Every module that a file imports at run time, wherever it does; names that are typed only are left out."""
    found: set[str] = set()
    waiting: list[ast.AST] = [ast.parse(file.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
        waiting += ast.iter_child_nodes(node)
    return found


def modules() -> dict[str, set[str]]:
    files = {file: file.relative_to(ROOT).with_suffix("") for file in (ROOT / "tuning").rglob("*.py")}
    names = {file: "dualwinch." + ".".join(path.parts).removesuffix(".__init__") for file, path in files.items()}
    return {name: imported(file) for file, name in names.items()}


def test_there_is_no_circle_of_imports() -> None:
    graph = modules()
    assert len(graph) > 30
    order = list(TopologicalSorter({name: found & set(graph) - {name} for name, found in graph.items()}).static_order())
    assert order.index(f"{PACKAGE}.space") < order.index(f"{PACKAGE}.tune")


def test_nothing_private_of_optuna_is_imported() -> None:
    for name, found in modules().items():
        private = [module for module in found if module.startswith("optuna") and "._" in module]
        assert not private, name
