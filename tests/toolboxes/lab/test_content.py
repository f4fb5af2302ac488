"""What the lab is made of is kept, and made anew where the kept one is damaged."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from dualwinch.codegen.cache import NAME
from dualwinch.codegen.errors import CompileError
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.progress import no_progress
from dualwinch.toolboxes.lab import content as kept
from dualwinch.toolboxes.lab.content import Content, content
from dualwinch.toolboxes.lab.wasm import build
from dualwinch.toolboxes.lab.wasm.build import modules
from tests.toolboxes.lab.in_node import of_id, zig_is_there

pytestmark = [pytest.mark.external, pytest.mark.skipif(not zig_is_there(), reason="needs zig")]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder of its own, and a catalogue that says little."""
    monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(kept, "catalogue", lambda *_: {"version": "0"})
    return tmp_path / "cache" / NAME


def made(shares: list[float] | None = None) -> Content:
    progress = no_progress if shares is None else shares.append
    return content(load_ensemble("rig"), "0", offered=[of_id("nftsm")], progress=progress)


def test_it_is_built_once(folder: Path) -> None:
    shares: list[float] = []
    first = made(shares)
    assert shares == [0.5, 1.0]
    assert first.modules["nftsm"].startswith(b"\0asm")
    assert len(list(folder.glob("lab-*.json.gz"))) == 1
    again: list[float] = []
    assert made(again) == first
    assert not again


def test_a_damaged_file_is_made_anew(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = made()
    (file,) = folder.glob("lab-*.json.gz")
    whole = file.read_bytes()
    builds: list[int] = []

    def built_before(sources: Iterable[object]) -> list[bytes]:
        builds.append(len(list(sources)))
        return list(first.modules.values())

    monkeypatch.setattr(kept, "modules", built_before)
    damages = (b"", b"\x1f\x8b", b"nothing of the kind", whole[: len(whole) // 2])
    for count, damage in enumerate(damages, 1):
        file.write_bytes(damage)
        assert made() == first
        assert len(builds) == count
        assert made() == first, "which is kept"
        assert len(builds) == count


def test_other_sources_make_another_one(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = made()
    monkeypatch.setattr(kept, "_sources", lambda: "others")
    assert made().modules == first.modules, "zig writes the same bytes again"
    assert len(list(folder.glob("lab-*.json.gz"))) == 2


def test_modules_need_nothing_from_outside_and_come_in_order() -> None:
    one, other = (next(modules([of_id(name).module])) for name in ("nftsm", "pid-cascade"))
    assert list(modules(of_id(name).module for name in ("nftsm", "pid-cascade"))) == [one, other]
    sections, at = [], 8
    while at < len(one):  # a section: its kind, its length in groups of seven bits, its content
        kind, length, shift, at = one[at], 0, 0, at + 1
        while True:
            length |= (one[at] & 0x7F) << shift
            shift, at, last = shift + 7, at + 1, one[at] < 0x80
            if last:
                break
        sections.append(kind)
        at += length
    assert 2 not in sections, "imports"


def test_what_does_not_compile_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "module_source", lambda _: "no C")
    with pytest.raises(CompileError, match=r"zig.* failed with exit code 1: .*error: unknown type name 'no'"):
        list(modules([of_id("nftsm").module]))
