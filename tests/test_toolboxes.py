"""Each toolbox can be deleted with its folder: the rest runs, and says in a line what it lacks."""

import os
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from dualwinch.extensions import COMMANDS, EXPORTS, FUNCTIONS, TOOLBOXES

ROOT = Path(__file__).parents[1]
PRODUCT = ("analysis", "codegen", "config", "controllers", "dualwinch", "model", "simulation", "toolboxes", "tuning")
NAMES = sorted(path.parent.name for path in (ROOT / "toolboxes").glob("*/__init__.py"))

PROGRAM = """
import contextlib, io, re, sys
import dualwinch as dw
from dualwinch.cli import main
from dualwinch.cli.app import COMMANDS
from dualwinch.extensions import FUNCTIONS, extension

toolbox, functions = sys.argv[1], sys.argv[2:]
assert dw.__file__ == {package!r} + "/__init__.py", dw.__file__
with contextlib.redirect_stdout(io.StringIO()) as text, contextlib.suppress(SystemExit):
    main(["--help"])
print(*sorted(re.findall(r"^│ ([a-z]+) ", text.getvalue(), re.MULTILINE)))
print(*sorted(name for name in COMMANDS["export"] if not name.startswith("-")))
complaint = f"needs the toolbox {{toolbox}}, which is not installed"
stub = open({package!r} + "/__init__.pyi").read()
for name in re.findall(rf"^from \\.toolboxes\\.{{toolbox}}\\.\\S+ import (\\w+)", stub, re.MULTILINE):
    try:
        getattr(dw, name)
    except ImportError as error:
        assert str(error) == f"dualwinch.{{name}}: {{complaint}}", error
    else:
        raise AssertionError(name)
for name in functions:
    try:
        extension(FUNCTIONS, name, "--option")
    except dw.ConfigurationError as error:
        assert str(error) == f"--option: {{complaint}}", error
    else:
        raise AssertionError(name)
result = dw.simulate(dw.override(dw.case(4), {{"simulation.duration": 0.1}}), engine="interpreter")
assert result.outcome == "completed"
"""


def sources(folder: Path, *more: str) -> None:
    """Copy the product's sources, and further files or folders, as git has them: links stay links."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "--", *PRODUCT, *more]
    listing = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listing.split("\0")):
        if (ROOT / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)


def registered(group: str, toolbox: str, *, present: bool = True) -> list[str]:
    """Names in a group of entry points of a toolbox, or of all others."""
    prefix = f"{TOOLBOXES}{toolbox}."
    return sorted(entry.name for entry in entry_points(group=group) if entry.module.startswith(prefix) is present)


def run(folder: Path, *words: str) -> str:
    """What a program of a copy prints."""
    environment = os.environ | {"PYTHONPATH": str(folder), "COLUMNS": "200"}
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout


def without(toolbox: str, folder: Path, *more: str) -> None:
    """Copy the sources, delete a toolbox, and run what does not need it."""
    sources(folder, *more)
    shutil.rmtree(folder / "toolboxes" / toolbox)
    program = PROGRAM.format(package=str(folder / "dualwinch"))
    commands, exports = run(folder, "-c", program, toolbox, *registered(FUNCTIONS, toolbox)).splitlines()
    assert set(registered(COMMANDS, toolbox, present=False)) <= set(commands.split())
    assert not set(registered(COMMANDS, toolbox)) & set(commands.split())
    assert {"simulate", "tune"} <= set(commands.split())
    assert exports.split() == sorted({"c", "casadi", "mex", *registered(EXPORTS, toolbox, present=False)})


def test_without_the_toolbox_of_stress_the_rest_runs(tmp_path: Path) -> None:
    without("stress", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("toolbox", [NAMES[0], *(pytest.param(name, marks=pytest.mark.nightly) for name in NAMES[1:])])
def test_without_any_toolbox_the_rest_runs(toolbox: str, tmp_path: Path) -> None:
    without(toolbox, tmp_path, "tests", "pyproject.toml")
    run(tmp_path, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", "tests/test_architecture.py")


def test_every_toolbox_is_registered() -> None:
    """A name that is misspelt would be left out as if the toolbox were deleted."""
    modules = [entry.module for group in (COMMANDS, EXPORTS, FUNCTIONS) for entry in entry_points(group=group)]
    assert {module.removeprefix(TOOLBOXES).partition(".")[0] for module in modules} <= set(NAMES)
    for module in modules:
        path = ROOT / "toolboxes" / Path(*module.removeprefix(TOOLBOXES).split("."))
        assert path.with_suffix(".py").is_file() or (path / "__init__.py").is_file(), module
