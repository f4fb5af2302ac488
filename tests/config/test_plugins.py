"""Plugins as files and modules, on the command line and below it."""

import sys
from pathlib import Path

import pytest

from dualwinch.cli import main
from dualwinch.config.experiment_file import load
from dualwinch.config.plugins import load_plugin
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import PLUGIN
from tests.conftest import Refused
from tests.spring_law import SPRING, changed

SHORT = ("--set", "simulation.duration=0.05")


@pytest.fixture
def plugin(tmp_path: Path) -> str:
    """A file that defines a law."""
    file = tmp_path / "my_law.py"
    file.write_text(SPRING)
    return str(file)


def test_a_file_becomes_a_module_of_its_own_name(plugin: str, tmp_path: Path) -> None:
    load_plugin(plugin)
    law = POSITION_LAWS["spring"]
    assert law.__module__.startswith(PLUGIN)
    assert sys.modules[law.__module__].__file__ == plugin
    assert not {"my_law", "model"} & set(sys.modules)
    assert not list(tmp_path.glob("__pycache__"))
    assert str(tmp_path) not in sys.path
    load_plugin(plugin)
    assert POSITION_LAWS["spring"] is law, "the same text is the same class"
    Path(plugin).write_text(changed(("= 2e4", "= 3e4")))
    load_plugin(plugin)
    assert POSITION_LAWS["spring"]().damping == 3e4  # pyright: ignore[reportAttributeAccessIssue]


def test_a_plugin_may_use_the_modules_beside_it(tmp_path: Path) -> None:
    (tmp_path / "damping_of_springs.py").write_text("DAMPING = 7e3\n")
    file = tmp_path / "model.py"
    file.write_text("from damping_of_springs import DAMPING\n" + changed(("= 2e4", "= DAMPING")))
    load_plugin(str(file))
    assert POSITION_LAWS["spring"]().damping == 7e3  # pyright: ignore[reportAttributeAccessIssue]


def test_annotations_may_be_texts(tmp_path: Path) -> None:
    file = tmp_path / "law.py"
    file.write_text("from __future__ import annotations\n" + SPRING)
    load_plugin(str(file))
    assert POSITION_LAWS["spring"]().stiffness == 5e3  # pyright: ignore[reportAttributeAccessIssue]
    text = changed(("import annotated_types as at", "from typing import TYPE_CHECKING\nif TYPE_CHECKING: at = 1"))
    file.write_text("from __future__ import annotations\n" + text)
    with pytest.raises(ConfigurationError, match=r"^Spring of law\.py: name 'at' is not defined; its annotations take"):
        load_plugin(str(file))


def test_a_module_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "package_of_springs").mkdir()
    (tmp_path / "package_of_springs" / "law.py").write_text(SPRING)
    (tmp_path / "package_of_springs" / "__init__.py").write_text("from package_of_springs.law import Spring\n")
    monkeypatch.syspath_prepend(tmp_path)
    load_plugin("package_of_springs")
    assert POSITION_LAWS["spring"].__module__ == "package_of_springs.law"
    file = tmp_path / "package_of_springs" / "law.py"
    load_plugin(str(file))
    assert POSITION_LAWS["spring"].__module__.startswith(PLUGIN), "the same file under another name is the same source"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", "plugin {}: defines no part; a part is a class that subclasses dw.PositionLaw, say"),
        ("import dualwinch as dw\nLaw = dw.Nftsm\n", "plugin {}: defines no part"),
        ("x = 1\ny = = 2\n", "plugin my.py: line 2: invalid syntax"),
        ("x = 1\n\n1 / 0\n", "plugin my.py: line 3: ZeroDivisionError: division by zero"),
        ("import no_such_library\n", "plugin my.py: line 1: ModuleNotFoundError: No module named 'no_such_library'"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "my.py"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load_plugin(str(file))
    assert message.format(file) in str(caught.value)
    assert "\n" not in str(caught.value)
    kept = [module.__file__ for name, module in sys.modules.items() if name.startswith(PLUGIN)]
    assert (str(file) in kept) == ("defines no part" in message)


@pytest.mark.parametrize(
    ("plugin", "message"),
    [
        ("no_such_law.py", "cannot be read (No such file or directory)"),
        (
            "no_such_module.laws",
            "plugin no_such_module.laws: no such module; must be a Python file, FILE.py",
        ),
        ("json", "plugin json: defines no part"),
    ],
)
def test_a_plugin_that_is_not_there_is_named(plugin: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        load_plugin(plugin)
    assert message in str(caught.value)


def test_simulate_knows_its_parts(plugin: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["simulate", "--plugin", plugin, "--controller", "spring", "--set", "controller.spring.damping=3e4", *SHORT])
    assert "spring: completed" in capsys.readouterr().out


def test_config_writes_its_parts(plugin: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["config", "--plugin", plugin])
    text = capsys.readouterr().out
    lines = text.splitlines()
    heading = lines.index("[controller.spring]")
    assert lines[heading - 1] == '# where controller.kind = "spring":'
    assert lines[heading + 1] == "stiffness = 5000.0  # [N/m] force a metre; > 0 (by hand)"
    assert lines[heading + 2] == "damping = 20000.0   # [N s/m] force at 1 m/s; >= 0"
    file = tmp_path / "mine.toml"
    file.write_text(text.replace('\nkind = "fando-nftsm"', '\nkind = "spring"', 1).replace("= 20000.0", "= 30000.0"))
    assert load(file).controller.law == POSITION_LAWS["spring"](damping=3e4)  # pyright: ignore[reportCallIssue]
    main(["config", "--plugin", plugin, "--set", "controller.kind=spring"])
    assert capsys.readouterr().out.count("[controller.spring]") == 1


def test_every_command_that_reads_experiments_knows_its_parts(
    plugin: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text('controller.kind = "spring"\n')
    words = ("--plugin", plugin, "--config", str(mine), *SHORT)
    main(["export", "casadi", "--out", str(tmp_path / "functions"), *words])
    main(["linearise", "--loop", "closed", "--v", "0.5", *words])
    main(["compare", "paper", str(mine), "--plugin", plugin, "--scenarios", "2", *SHORT])
    assert "2 scenarios of 'sea'" in capsys.readouterr().out
    main(["linearise", "--estimator", "kalman", "--controller", "spring", "--plugin", plugin])
    assert "x" in capsys.readouterr().out


@pytest.mark.parametrize("command", [["simulate"], ["linearise"], ["certify"], ["export", "c", "--out", "x"], ["tune"]])
def test_without_it_the_kind_is_unknown_and_what_to_do_is_told(
    command: list[str], tmp_path: Path, refused: Refused
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text('[controller]\nkind = "spring"\n\n[controller.spring]\ndamping = 3e4\n')
    error = refused(*command, "--config", str(mine))
    assert f'{mine}:2: controller.kind = "spring": must be "fando-nftsm" or ' in error
    assert "(a kind of your own: dw.register(YourClass), or --plugin FILE)" in error


@pytest.mark.parametrize(
    "command",
    [["simulate"], ["linearise"], ["compare"], ["tune"], ["config"], ["certify"]]
    + [["export", what] for what in ("c", "fmu", "mex", "casadi")],
)
def test_every_command_takes_plugins(command: list[str], refused: Refused) -> None:
    out = ["--out", "x"] if command[0] == "export" else []
    assert "no_such_law.py: cannot be read" in refused(*command, "--plugin", "no_such_law.py", *out)


def test_help_names_the_built_in_parts(capsys: pytest.CaptureFixture[str]) -> None:
    main(["simulate", "--help"])
    said = " ".join(word for word in capsys.readouterr().out.split() if word != "│")
    for registry in (POSITION_LAWS, ESTIMATORS, COORDINATIONS):
        assert f"{registry.what.capitalize()}: {', '.join(registry)}, or the kind of a part of your own" in said
