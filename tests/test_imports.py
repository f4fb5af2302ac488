"""What may import what, read from the sources: neither files nor sub-packages import in a circle, and folders import
downwards only. A class name stands once.

All imports count, also those inside functions, for type checkers alone and by a string. Not read is the stub of
`dualwinch` itself, the list of all floors' names for users.
"""

import ast
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FLOORS = ("codegen", "model", "controllers", "simulation", "config", "analysis", "tuning", "toolboxes")
"""Folders at the repository's top that are packages of `dualwinch`, the lowest first."""
FACE = ("reports", "cli")
"""`dualwinch`'s own folders, likewise; all stand above the packages of the kernel, and below the toolboxes."""
ORDER = (*FLOORS[:-1], *FACE, FLOORS[-1])


@dataclass(frozen=True)
class Import:
    """One imported name: in which module, on which line, and its full name."""

    module: str
    line: int
    name: str

    def __str__(self) -> str:
        return f"{self.module}, line {self.line}: imports {self.name}"


@cache
def modules() -> dict[str, Path]:
    """Every module of the product, by its name in Python."""
    found: dict[str, Path] = {}
    for folder, prefix in [(ROOT / floor, "dualwinch.") for floor in FLOORS] + [(ROOT / "dualwinch", "")]:
        for path in folder.rglob("*.py"):
            if folder.name == "dualwinch" and path.relative_to(folder).parts[0] in FLOORS:
                continue  # the links to the folders at the top
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[prefix + ".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(module: str, source: str, *, package: bool) -> Iterator[Import]:
    """Every import of a module's source; ``from a import b`` is a.b."""
    parents = module.split(".") if package else module.split(".")[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(module, node.lineno, alias.name)
        elif isinstance(node, ast.ImportFrom):
            above = parents[: len(parents) - node.level + 1] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                yield Import(module, node.lineno, f"{origin}.{alias.name}")
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("import_module", "__import__")):
            for argument in node.args:
                if isinstance(argument, ast.Constant) and str(argument.value).startswith("dualwinch"):
                    yield Import(module, node.lineno, str(argument.value))


@cache
def imports() -> tuple[Import, ...]:
    """Every import of every module."""
    return tuple(
        found
        for module, path in modules().items()
        for found in imports_of(module, path.read_text(encoding="utf-8"), package=path.name == "__init__.py")
    )


def target(name: str) -> str | None:
    """The product's module that an imported name is, or is in; packages stand for their ``__init__.py``."""
    while name and name not in modules():
        name = name.rpartition(".")[0]
    return name or None


def floor(module: str) -> int | None:
    """How high a module stands; None: in `dualwinch` itself, which gives users the names of all floors."""
    parts = module.split(".")
    return ORDER.index(parts[1]) if len(parts) > 1 and parts[1] in ORDER else None


def upward(found: Import) -> bool:
    """Whether an import goes to a higher floor than its own, or to the face's names for users."""
    own, other = floor(found.module), target(found.name)
    if own is None or other is None:
        return False
    theirs = floor(other)
    return theirs > own if theirs is not None else own < len(FLOORS) - 1


def circle(dependencies: dict[str, set[str]]) -> list[str]:
    """Modules each of which imports the next, the first one again at the end; empty: there is no circle."""
    try:
        TopologicalSorter(dependencies).prepare()
    except CycleError as error:
        return error.args[1][::-1]
    return []


def sub_package(module: str) -> str:
    """``simulation.loop`` of ``dualwinch.simulation.loop.closed_loop``; a module directly in a package is its own."""
    return ".".join(module.split(".")[1:3])


def cycles(dependencies: Mapping[str, set[str]]) -> set[frozenset[str]]:
    """Largest sets of nodes each of which reaches all others of its set (strongly connected components)."""

    @cache
    def reached(node: str) -> frozenset[str]:
        found, border = set(dependencies[node]), list(dependencies[node])
        while border:
            further = dependencies.get(border.pop(), set()) - found
            found |= further
            border += further
        return frozenset(found)

    return {
        frozenset(other for other in reached(node) if node in reached(other))
        for node in dependencies
        if node in reached(node)
    }


@cache
def sub_packages() -> dict[str, set[str]]:
    """What every sub-package imports from others."""
    found: dict[str, set[str]] = {sub_package(module): set() for module in modules()}
    for one in imports():
        imported = target(one.name)
        if imported and sub_package(imported) != sub_package(one.module):
            found[sub_package(one.module)].add(sub_package(imported))
    return found


def class_names() -> Counter[str]:
    """How many classes of the product have each name; names that begin with an underscore are a file's own."""
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in modules().values())
    classes = (node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    return Counter(name for name in classes if not name.startswith("_"))


def test_sub_packages_do_not_import_in_a_circle() -> None:
    found = cycles(sub_packages())
    assert not found, "; ".join(" ↔ ".join(sorted(cycle)) for cycle in found)


def test_a_class_name_stands_once() -> None:
    found = {name for name, count in class_names().items() if count > 1}
    assert not found, ", ".join(sorted(found))


def test_all_modules_are_read() -> None:
    found = modules()
    assert {"dualwinch", "dualwinch.cli.app", "dualwinch.codegen.sampled", "dualwinch.model.linear"} <= set(found)
    assert {floor(module) for module in found} == {None, *range(len(ORDER))}
    assert all((ROOT / "dualwinch" / folder).is_dir() for folder in ORDER)
    assert len(imports()) > 5 * len(found)


def test_files_do_not_import_in_a_circle() -> None:
    dependencies: dict[str, set[str]] = {module: set() for module in modules()}
    for found in imports():
        imported = target(found.name)
        if imported and imported != found.module:
            dependencies[found.module].add(imported)
    assert not circle(dependencies), " → ".join(circle(dependencies))


def test_imports_point_down() -> None:
    assert not [str(found) for found in imports() if upward(found)]


def test_folders_are_imported_by_their_names_in_dualwinch() -> None:
    """Not as ``model``, which a user's own file may be called, and not by a relative name."""
    tops = {*FLOORS, "benchmarks", "tests"}
    assert not [str(found) for found in imports() if found.name.split(".")[0] in tops]
    assert not [module for module, path in modules().items() if "\nfrom ." in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("import dualwinch.model.winch", "dualwinch.model.winch"),
        ("def f():\n    from dualwinch.model import winch", "dualwinch.model.winch"),
        ("if TYPE_CHECKING:\n    from dualwinch.tuning.tune import tune", "dualwinch.tuning.tune.tune"),
        ("from .winch import Winch", "dualwinch.model.winch.Winch"),
        ("from ..codegen import cache", "dualwinch.codegen.cache"),
        ("import model.winch", "model.winch"),
        ('importlib.import_module("dualwinch.plots")', "dualwinch.plots"),
    ],
)
def test_every_kind_of_import_is_found(line: str, name: str) -> None:
    assert [found.name for found in imports_of("dualwinch.model.vehicle", line, package=False)] == [name]


def test_a_circle_and_an_import_upwards_are_noticed() -> None:
    assert cycles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}, "e": set()}) == {frozenset("abc")}
    assert cycles({"a": {"b"}, "b": {"a"}, "c": {"a", "d"}, "d": {"c"}}) == {frozenset("ab"), frozenset("cd")}
    found = circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})
    assert "→".join(found) in {"a→b→c→a", "b→c→a→b", "c→a→b→c"}
    assert not circle({"a": {"b", "c"}, "b": {"c"}, "c": set()})
    higher, lower = "dualwinch.simulation.simulate", "dualwinch.model.winch"
    assert upward(Import(lower, 1, f"{higher}.simulate"))
    assert not upward(Import(higher, 1, f"{lower}.Winch"))
    assert upward(Import(lower, 1, "dualwinch.simulate"))
    assert upward(Import("dualwinch.simulation.settings", 1, "dualwinch.cli.tune"))
    assert not upward(Import("dualwinch.cli.tune", 1, "numpy.linalg"))
