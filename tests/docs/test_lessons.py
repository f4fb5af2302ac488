"""The Python of a page runs as it stands there, block after block, in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import dualwinch

ROOT = Path(__file__).parents[2]
LESSONS = {
    "start.md": 1,
    "machine.md": 1,
    "sensitivities.md": 1,
    "stepper.md": 5,
    "tuning.md": 1,
    "reference/python.md": 10,
}
"""Page → blocks that it has at least."""

LONG = ("sensitivities.md", "stepper.md", "tuning.md", "reference/python.md")


def blocks(page: str) -> list[str]:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.slow, pytest.mark.nightly] if page in LONG else []) for page in LESSONS],
)
def test_a_lesson_runs(page: str, tmp_path: Path) -> None:
    """In a process of its own: a lesson may register parts."""
    found = blocks(page)
    assert len(found) >= LESSONS[page]
    (tmp_path / "lesson.py").write_text("\n".join(found), encoding="utf-8")
    command, environment = [sys.executable, "lesson.py"], os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_the_plainest_study_is_fifteen_lines_of_optuna() -> None:
    (study,) = blocks("tuning.md")
    assert len([line for line in study.splitlines() if line]) <= 15


def test_the_reference_has_an_example_of_every_public_name() -> None:
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    assert [name for name in dir(dualwinch) if not re.search(rf"\bdw\.{name}\b", text)] == []


def test_the_reference_lists_every_public_name_once() -> None:
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    listed = " ".join(re.findall(r"^```\{dualwinch-public\} (.+)$", text, re.MULTILINE)).split()
    assert sorted(listed) == sorted(dir(dualwinch))
