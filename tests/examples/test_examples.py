"""Every example runs, tunes, compares and exports; the lesson leads to each and shows the first one's code."""

import importlib.util
import inspect
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from dualwinch.export import export_c
from dualwinch.model.quantities.part import Part
from dualwinch.simulation.blocks import block
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted(path for path in (ROOT / "examples").glob("*.py") if path.stem != "lqr_torques")
"""Those of one part that is tuned; the other one works its gain out before the run."""
LESSON = (ROOT / "docs" / "your-own-parts.md").read_text(encoding="utf-8")
LONGEST = 25
"""Lines of a part."""


def loaded(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"example_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def part_of(module: ModuleType) -> type[Part]:
    """The part an example is about: the last one it defines."""
    own = [value for value in vars(module).values() if isinstance(value, type) and value.__module__ == module.__name__]
    return [value for value in own if issubclass(value, Part)][-1]


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("name", [path.stem for path in EXAMPLES])
def test_it_tunes_compares_and_writes_c(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    loaded(ROOT / "examples" / f"{name}.py").main(trials=8, out="made")
    printed = capsys.readouterr().out
    assert "TuningResult(" in printed
    assert "Comparison in " in printed
    assert "times the MSE of paper" in printed
    code = (tmp_path / "made" / "dualwinch_controller.c").read_text()
    assert "dualwinch_controller_step" in code


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_its_part_is_short_and_the_lesson_leads_to_it(path: Path) -> None:
    source = inspect.getsource(part_of(loaded(path))).strip()
    assert len(source.splitlines()) <= LONGEST
    assert f"(../examples/{path.name})" in LESSON


def test_the_lesson_shows_the_law_as_it_is() -> None:
    source = inspect.getsource(part_of(loaded(ROOT / "examples" / "lqi_law.py"))).strip()
    assert source in LESSON, "copy the class into docs/your-own-parts.md"


@pytest.mark.slow
def test_a_law_is_used_like_any_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The block of the lesson, with a shorter search."""
    monkeypatch.chdir(tmp_path)
    (block,) = (block for block in re.findall(r"```python\n(.*?)```", LESSON, re.DOTALL) if "trials=300" in block)
    names = dict(vars(loaded(ROOT / "examples" / "lqi_law.py")))
    exec(block.replace("trials=300", "trials=8"), names)  # noqa: S102
    printed = capsys.readouterr().out
    assert "LQI: completed at 50 s" in printed
    assert "Margins(" in printed
    assert (tmp_path / "lqi" / "dualwinch_controller.c").exists()


def test_full_state_feedback_commands_torques_and_holds(tmp_path: Path) -> None:
    """A law without states, exported, too."""
    example = loaded(ROOT / "examples" / "lqr_torques.py")
    experiment = example.lqr(override(case(4), {"simulation.duration": 20.0}))
    result = simulate(experiment)
    assert result.outcome == "completed"
    assert result.metrics.max_abs_error < 0.01
    assert result.metrics.slack_share == 0
    assert not block("controller", experiment).states
    export_c(experiment, tmp_path)
    flags = "-std=c99 -pedantic -Wall -Wextra -Wconversion -Wshadow -Werror"
    if cc := shutil.which("cc"):
        sources = sorted(map(str, tmp_path.glob("*.c")))
        subprocess.run([cc, *flags.split(), "-c", *sources], cwd=tmp_path, check=True)
