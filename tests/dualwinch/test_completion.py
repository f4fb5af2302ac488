"""The Tab key in a real shell: commands and options, those of subcommands too."""

import shutil
import subprocess
from pathlib import Path

import pytest

from dualwinch.cli import main
from dualwinch.cli.app import COMMANDS, app

BASH = shutil.which("bash")


def completed(script: Path, *words: str) -> list[str]:
    array = " ".join(f"'{word}'" for word in words)
    program = (
        f"source '{script}'; COMP_WORDS=({array}); COMP_CWORD={len(words) - 1}; _dualwinch; echo ${{COMPREPLY[@]}}"
    )
    assert BASH
    return subprocess.run([BASH, "-c", program], capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.skipif(not BASH, reason="needs bash")
def test_commands_and_options_are_completed(tmp_path: Path) -> None:
    script = tmp_path / "dualwinch.bash"
    script.write_text(app.generate_completion(shell="bash"))  # noqa: S604  # the shell is its subject
    assert set(completed(script, "dualwinch", "")) >= set(COMMANDS)
    assert completed(script, "dualwinch", "repro") == ["reproduce"]
    assert "--animate" in completed(script, "dualwinch", "simulate", "--")
    assert set(completed(script, "dualwinch", "export", "")) >= {"c", "fmu", "mex", "casadi"}


def test_it_is_installed_by_an_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", "/bin/bash")
    monkeypatch.delenv("XDG_DATA_HOME", raising=False)
    (tmp_path / ".bashrc").write_text("# mine\n")
    main(["--install-completion"])
    assert (tmp_path / ".bashrc").read_text().startswith("# mine\n")
    assert [file.name for file in tmp_path.rglob("dualwinch")] == ["dualwinch"]
