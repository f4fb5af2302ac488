"""The wheel and the source archive: one importable name, whatever a user's own files are called."""

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("codegen", "controllers", "model", "simulation", "tuning")
PROGRAM = """
import dualwinch as dw, dualwinch.model, dualwinch.controllers, pathlib
assert pathlib.Path(dw.__file__).is_relative_to({unpacked!r}), dw.__file__
assert pathlib.Path(dualwinch.model.__file__).is_relative_to({unpacked!r}), dualwinch.model.__file__
print(dw.simulate(dw.override(dw.case(4), {{"simulation.duration": 0.1}}), engine="interpreter").outcome)
"""


def build(source: Path, *targets: str) -> list[Path]:
    """Archives of a source folder, by the project's own build backend."""
    out = source / "dist"
    words = [word for target in targets for word in ("--target", target)]
    subprocess.run([sys.executable, "-m", "hatchling", "build", *words, "-d", str(out)], cwd=source, check=True)
    return sorted(out.iterdir())


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Source archive and wheel of this checkout, as git has it."""
    source = tmp_path_factory.mktemp("checkout") / "dualwinch"
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).exists():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, source / name, follow_symlinks=False)
    wheel, archive = sorted(build(source, "sdist", "wheel"), key=lambda path: path.suffix == ".gz")
    return archive, wheel


def contents(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as file:
        return sorted(file.namelist())


def test_the_wheel_holds_one_name(archives: tuple[Path, Path]) -> None:
    names = contents(archives[1])
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"dualwinch"}
    assert len(names) == len(set(names))
    assert {"dualwinch/py.typed", "dualwinch/__init__.pyi"} <= set(names)
    for package in PACKAGES:
        tracked = {
            str(path.relative_to(ROOT)) for path in (ROOT / package).rglob("*.*") if "__pycache__" not in str(path)
        }
        assert {
            name.removeprefix("dualwinch/") for name in names if name.startswith(f"dualwinch/{package}/")
        } == tracked


def test_a_wheel_from_the_source_archive_is_the_same(archives: tuple[Path, Path], tmp_path: Path) -> None:
    """The archive holds no links, so this is also what a system without links builds."""
    with tarfile.open(archives[0]) as file:
        assert not [member.name for member in file if member.issym() or member.islnk()]
        file.extractall(tmp_path, filter="data")
    (unpacked,) = tmp_path.iterdir()
    (wheel,) = build(unpacked, "wheel")
    assert contents(wheel) == contents(archives[1])


def test_files_of_a_user_with_our_names_do_no_harm(archives: tuple[Path, Path], tmp_path: Path) -> None:
    unpacked, folder = tmp_path / "installed", tmp_path / "work"
    with zipfile.ZipFile(archives[1]) as file:
        file.extractall(unpacked)  # noqa: S202 # our own archive
    folder.mkdir()
    for name in PACKAGES:
        if name in {"tuning", "codegen"}:
            (folder / name).mkdir()
            (folder / name / "__init__.py").write_text("raise ImportError('the wrong one')\n")
        else:
            (folder / f"{name}.py").write_text("raise ImportError('the wrong one')\n")
    (folder / "script.py").write_text(PROGRAM.format(unpacked=str(unpacked)))
    command = [sys.executable, "script.py"]
    environment = {"PYTHONPATH": str(unpacked), "PATH": "", "HOME": str(tmp_path)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "completed", done.stderr
