"""What `dualwinch export fmu` is asked for: platforms, compilers, and requests that make no sense."""

from pathlib import Path
from zipfile import ZipFile

import pytest

from dualwinch.cli import main
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.simulation.paper import case
from dualwinch.toolboxes.fmu.build import PLATFORMS, host_platform
from dualwinch.toolboxes.fmu.export import export_fmu
from tests.conftest import Refused
from tests.fmus import Instance


@pytest.mark.external
@pytest.mark.parametrize(("platform", "magic"), [("darwin64", b"\xcf\xfa\xed\xfe"), ("aarch64-linux", b"\x7fELF")])
def test_binaries_for_other_machines_are_what_they_say(platform: str, magic: bytes, tmp_path: Path) -> None:
    path = tmp_path / "controller.fmu"
    export_fmu(case(4), path, platforms=platform)
    with ZipFile(path) as files:
        (binary,) = (name for name in files.namelist() if name.startswith("binaries/"))
        content = files.read(binary)
    assert binary.split("/")[1] == platform
    assert content.startswith(magic)
    assert {"darwin64": content[4:8] == b"\x07\0\0\x01", "aarch64-linux": content[18:20] == b"\xb7\0"}[platform]


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (
            ["--platforms", "linux64,amiga", "--out", "a.fmu"],
            "unknown platform 'amiga'; must be one of linux64, ",
        ),
        (["--fmi", "1", "--out", "a.fmu"], "--fmi. Choose from: 2, 3"),
        (["--kind", "model-exchange", "--out", "a.fmu"], "the controller is sampled"),
        (["--out", "a.zip"], "must end with .fmu"),
        (["--out", "nowhere/a.fmu"], "nowhere: no such folder"),
    ],
)
def test_wrong_requests_are_refused_in_one_line(
    words: list[str], complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    monkeypatch.chdir(tmp_path)
    assert complaint in refused("export fmu", *words)
    assert list(tmp_path.iterdir()) == []


def test_without_zig_there_are_binaries_for_this_machine_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def systems_own(wanted: str | None = None) -> Compiler:
        if wanted == "zig":
            raise CompilerNotFoundError
        return find_compiler(wanted)

    monkeypatch.setattr("dualwinch.codegen.compiler.find_compiler", systems_own)
    other = next(name for name in PLATFORMS if name != host_platform().name)
    with pytest.raises(SystemExit, match="1"):
        main(["export", "fmu", "--platforms", other, "--out", str(tmp_path / "a.fmu")])
    assert f"no compiler for {other}: it needs zig; run: pip install 'dualwinch[zig]'" in capsys.readouterr().err
    export_fmu(case(4), tmp_path / "b.fmu")
    assert Instance(tmp_path / "b.fmu").get("tau_1")[0] > 0
