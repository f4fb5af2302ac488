"""Parts that installed packages offer."""

import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest

from dualwinch.cli import main
from dualwinch.config.experiment_file import load
from dualwinch.config.plugins import EntryPointWarning, load_entry_points
from dualwinch.controllers.registry import POSITION_LAWS
from tests.spring_law import SPRING, changed

METADATA = "Metadata-Version: 2.1\nName: {}\nVersion: 1.0\n"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of installed packages, two of which offer parts, and two fail to."""
    offers = {
        "springs": "law = springs_of_steel.laws",
        "dampers": "one = dampers_of_oil:Damper",
        "broken": "law = springs_of_glass",
        "odd": "law = springs_of_steel:NAME",
    }
    for name, offer in offers.items():
        folder = tmp_path / f"{name}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(METADATA.format(name))
        (folder / "entry_points.txt").write_text(f"[dualwinch.parts]\n{offer}\n")
    package = tmp_path / "springs_of_steel"
    package.mkdir()
    (package / "__init__.py").write_text("NAME = 'steel'\n")
    (package / "laws.py").write_text(SPRING)
    (tmp_path / "dampers_of_oil.py").write_text(changed(("Spring(", "Damper("), ('"spring"', '"damper"')))
    (tmp_path / "springs_of_glass.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    load_entry_points.cache_clear()
    yield tmp_path
    load_entry_points.cache_clear()


def test_installed_parts_are_known_to_files_and_broken_ones_are_warned_of(installed: Path) -> None:
    file = installed / "mine.toml"
    file.write_text('controller.kind = "spring"\ncontroller.spring.damping = 3e4\n')
    with pytest.warns(EntryPointWarning) as caught:
        experiment = load(file)
    assert experiment.controller.law == POSITION_LAWS["spring"](damping=3e4)  # pyright: ignore[reportCallIssue]
    assert POSITION_LAWS["damper"].__module__ == "dampers_of_oil"
    told = sorted(str(warning.message) for warning in caught)
    assert told[0] == (
        "broken: its part 'law' (dualwinch.parts, springs_of_glass) is left out: ZeroDivisionError: division by zero"
    )
    assert told[1].startswith("odd: its part 'law' (dualwinch.parts, springs_of_steel:NAME) is left out: 'steel': must")
    assert len(told) == 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(file)


def test_the_command_line_knows_them_too(installed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["config", "--set", "controller.kind=damper"])
    told = capsys.readouterr()
    assert "[controller.damper]" in told.out
    lines = told.err.splitlines()
    assert len(lines) == 2
    assert all(line.startswith(("dualwinch: warning: broken: ", "dualwinch: warning: odd: ")) for line in lines)
    assert installed.is_dir()
