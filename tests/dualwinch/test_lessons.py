"""The Python of a lesson runs as it stands there, block after block."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("lesson", ["docs/stepper.md"])
def test_a_lesson_runs(lesson: str, capsys: pytest.CaptureFixture[str]) -> None:
    blocks = re.findall(
        r"^```python\n(.*?)^```$", (ROOT / lesson).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    names: dict[str, object] = {}
    for block in blocks:
        exec(block, names)  # noqa: S102
    assert len(blocks) >= 5
    assert "completed" in capsys.readouterr().out
