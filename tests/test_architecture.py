"""The house as its sources have it: what may import what, and what toolboxes use of the kernel.

All imports count, also those inside functions, for type checkers alone and by a string. Not read is the stub of
`dualwinch` itself, the list of all floors' names for users.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path

import pytest

from dualwinch import toolbox
from dualwinch.simulation import paper
from dualwinch.simulation.experiment import Experiment

ROOT = Path(__file__).parents[1]
FLOORS = ("codegen", "model", "controllers", "simulation", "config", "analysis", "tuning", "dualwinch", "toolboxes")
"""Folders at the repository's top, the lowest first; all but `dualwinch` are packages of it."""
PACKAGES = tuple(folder for folder in FLOORS if folder != "dualwinch")
LIST = "dualwinch.toolbox"
"""The module with the names of the kernel that toolboxes use."""
MOST_NAMES = 80


@dataclass(frozen=True)
class Import:
    """One imported name: in which module, on which line, its full name, and whether it is imported by a string."""

    module: str
    line: int
    name: str
    by_string: bool = False

    def __str__(self) -> str:
        return f"{self.module}, line {self.line}: imports {self.name}"


@cache
def modules() -> dict[str, Path]:
    """Every module of the product, by its name in Python."""
    files: dict[str, Path] = {}
    for folder in FLOORS:
        for path in (ROOT / folder).rglob("*.py"):
            if folder == "dualwinch" and path.relative_to(ROOT / folder).parts[0] in PACKAGES:
                continue  # the links to the folders at the top
            parts = path.relative_to(ROOT).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            files[".".join(parts if folder == "dualwinch" else ("dualwinch", *parts))] = path
    return files


def by_string(call: ast.Call) -> str:
    """The module of the product that a call imports by a string, or the beginning of its name; empty for others."""
    function = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if function not in {"import_module", "__import__"}:
        return ""
    for argument in call.args[:1]:
        text = argument.values[0] if isinstance(argument, ast.JoinedStr) and argument.values else argument
        if isinstance(text, ast.Constant) and str(text.value).startswith("dualwinch"):
            return str(text.value).rstrip(".")
    return ""


@cache
def syntax(module: str) -> ast.Module:
    """A module's syntax tree."""
    return ast.parse(modules()[module].read_text(encoding="utf-8"))


def imports_of(module: str, tree: ast.Module, *, package: bool) -> Iterator[Import]:
    """Every import of a module; ``from a import b`` is a.b."""
    parents = module.split(".") if package else module.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(module, node.lineno, alias.name)
        elif isinstance(node, ast.ImportFrom):
            above = parents[: len(parents) - node.level + 1] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                yield Import(module, node.lineno, f"{origin}.{alias.name}")
        elif isinstance(node, ast.Call) and (name := by_string(node)):
            yield Import(module, node.lineno, name, by_string=True)


@cache
def imports() -> tuple[Import, ...]:
    """Every import of every module."""
    return tuple(
        each
        for module, path in modules().items()
        for each in imports_of(module, syntax(module), package=path.name == "__init__.py")
    )


def target(name: str) -> str | None:
    """The product's module that an imported name is, or is in; packages stand for their ``__init__.py``."""
    while name and name not in modules():
        name = name.rpartition(".")[0]
    return name or None


def floor(module: str) -> int:
    """How high a module stands."""
    package = [*module.split("."), ""][1]
    return FLOORS.index(package if package in PACKAGES else "dualwinch")


def toolbox_of(module: str) -> str:
    """The toolbox that a module belongs to; empty: the kernel."""
    parts = module.split(".")
    return parts[2] if parts[1:2] == ["toolboxes"] and len(parts) > 2 else ""


def upward(each: Import) -> bool:
    """Whether an import goes to a higher floor than its own."""
    goal = target(each.name)
    return goal is not None and floor(goal) > floor(each.module)


def past_the_list(each: Import) -> bool:
    """Whether a toolbox imports another toolbox, or a name of the kernel from elsewhere than the list."""
    goal, own = target(each.name), toolbox_of(each.module)
    return bool(goal and own) and toolbox_of(goal or "") != own and goal != LIST


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


def class_names() -> Counter[str]:
    """How many classes of the product have each name; names that begin with an underscore are a file's own."""
    nodes = (node for module in modules() for node in ast.walk(syntax(module)))
    classes = (node.name for node in nodes if isinstance(node, ast.ClassDef))
    return Counter(name for name in classes if not name.startswith("_"))


@cache
def listed() -> dict[str, str]:
    """Every name of the list, with the comment above its import."""
    lines = modules()[LIST].read_text(encoding="utf-8").splitlines()
    meanings: dict[str, str] = {}
    for above, line in pairwise(lines):
        if match := re.fullmatch(r"    from [\w.]+ import (?:\w+ as )?(\w+)", line):
            meanings[match[1]] = above.strip().removeprefix("# ") if above.strip().startswith("# ") else ""
    return meanings


def test_all_modules_are_read() -> None:
    names = set(modules())
    assert {"dualwinch", "dualwinch.cli.app", "dualwinch.codegen.sampled", "dualwinch.model.linear", LIST} <= names
    assert {floor(module) for module in names} == set(range(len(FLOORS)))
    assert all((ROOT / "dualwinch" / folder).is_dir() for folder in PACKAGES)
    assert len(imports()) > 5 * len(names)


def test_imports_point_down() -> None:
    assert not [str(each) for each in imports() if upward(each)]


def test_no_module_is_imported_by_a_string() -> None:
    """Entry points are loaded by their names, which are not the kernel's."""
    assert not [str(each) for each in imports() if each.by_string]


def test_nothing_is_imported_that_a_library_keeps_to_itself() -> None:
    assert not [str(each) for each in imports() if "._" in each.name and not each.name.startswith("dualwinch")]


def test_files_do_not_import_in_a_circle() -> None:
    dependencies: dict[str, set[str]] = {module: set() for module in modules()}
    for each in imports():
        goal = target(each.name)
        if goal and goal != each.module:
            dependencies[each.module].add(goal)
    assert not circle(dependencies), " → ".join(circle(dependencies))


def test_sub_packages_do_not_import_in_a_circle() -> None:
    dependencies: dict[str, set[str]] = {sub_package(module): set() for module in modules()}
    for each in imports():
        goal = target(each.name)
        if goal and sub_package(goal) != sub_package(each.module):
            dependencies[sub_package(each.module)].add(sub_package(goal))
    circles = cycles(dependencies)
    assert not circles, "; ".join(" ↔ ".join(sorted(cycle)) for cycle in circles)


def test_a_toolbox_imports_itself_and_the_list_alone() -> None:
    assert not [str(each) for each in imports() if past_the_list(each)]


def test_the_list_is_short_and_says_what_each_name_is() -> None:
    names = listed()
    assert set(names) == set(toolbox.SOURCES)
    assert len(names) <= MOST_NAMES
    assert not [name for name, meaning in names.items() if len(meaning.split()) < 3 or meaning.startswith("-")]
    assert len(set(names.values())) == len(names)


def test_a_name_of_the_list_is_imported_when_first_used() -> None:
    assert (toolbox.Experiment, toolbox.paper) == (Experiment, paper)
    assert dir(toolbox) == sorted(listed())
    with pytest.raises(AttributeError, match="nothing_here"):
        toolbox.nothing_here  # noqa: B018


def test_every_name_of_the_list_is_used() -> None:
    used = {each.name.removeprefix(f"{LIST}.") for each in imports() if each.name.startswith(f"{LIST}.")}
    missing_toolboxes = {"fmu", "identification", "lab", "paper", "plc", "race", "server", "stepper", "stress"} - {
        toolbox_of(module) for module in modules()
    }
    assert missing_toolboxes or used == set(listed())


def test_a_class_name_stands_once() -> None:
    repeated = {name for name, count in class_names().items() if count > 1}
    assert not repeated, ", ".join(sorted(repeated))


def test_folders_are_imported_by_their_names_in_dualwinch() -> None:
    """Not as ``model``, which a user's own file may be called, and not by a relative name."""
    tops = {*PACKAGES, "benchmarks", "tests"}
    assert not [str(each) for each in imports() if each.name.split(".")[0] in tops]
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
        ("importlib.import_module('dualwinch.plots')", "dualwinch.plots"),
        ("import_module(f'dualwinch.cli.{name}')", "dualwinch.cli"),
        ("__import__('dualwinch.plots')", "dualwinch.plots"),
    ],
)
def test_every_kind_of_import_is_read(line: str, name: str) -> None:
    assert [each.name for each in imports_of("dualwinch.model.vehicle", ast.parse(line), package=False)] == [name]


def test_circles_and_forbidden_imports_are_noticed() -> None:
    assert cycles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}, "e": set()}) == {frozenset("abc")}
    assert cycles({"a": {"b"}, "b": {"a"}, "c": {"a", "d"}, "d": {"c"}}) == {frozenset("ab"), frozenset("cd")}
    assert "→".join(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) in {"a→b→c→a", "b→c→a→b", "c→a→b→c"}
    assert not circle({"a": {"b", "c"}, "b": {"c"}, "c": set()})
    higher, lower = "dualwinch.simulation.simulate", "dualwinch.model.winch"
    assert upward(Import(lower, 1, f"{higher}.simulate"))
    assert not upward(Import(higher, 1, f"{lower}.Winch"))
    assert upward(Import(lower, 1, "dualwinch.simulate"))
    assert upward(Import("dualwinch.simulation.settings", 1, "dualwinch.cli.tune"))
    assert not upward(Import("dualwinch.cli.tune", 1, "numpy.linalg"))
    any_toolbox = "dualwinch.toolboxes.lab.live"
    if any_toolbox in modules():
        assert upward(Import("dualwinch.cli.tune", 1, f"{any_toolbox}.live_page"))
    assert past_the_list(Import(any_toolbox, 1, f"{lower}.Winch"))
    assert not past_the_list(Import(any_toolbox, 1, f"{LIST}.Experiment"))
    assert not past_the_list(Import("dualwinch.cli.tune", 1, f"{lower}.Winch"))
