from pathlib import Path

import pytest

from dualwinch.codegen.compiler import Compiler, find_compiler, vector_features
from dualwinch.codegen.errors import CompileError, CompilerNotFoundError

ANSWER = "int answer(void) { return 42; }\n"


def test_a_compiler_is_found_and_says_its_version() -> None:
    compiler = find_compiler()
    assert any(character.isdigit() for character in compiler.version)


def test_zig_serves_where_there_is_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ziglang")
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.delenv("DUALWINCH_CC", raising=False)
    assert find_compiler().name == "zig"


@pytest.mark.usefixtures("no_compiler")
def test_without_any_the_error_names_two_things_that_help() -> None:
    with pytest.raises(CompilerNotFoundError, match=r"install gcc or clang.*pip install 'dualwinch\[zig\]'"):
        find_compiler()


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("no-such-compiler", "no-such-compiler"),
        *((half, r"is no command \(DUALWINCH_CC or CC\): no ") for half in ("gcc '", "gcc \\")),
    ],
)
def test_a_wrong_wish_is_named(command: str, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DUALWINCH_CC", command)
    with pytest.raises(CompilerNotFoundError, match=message):
        find_compiler()


def test_a_command_that_makes_nothing_is_no_compiler(tmp_path: Path) -> None:
    with pytest.raises(CompileError, match="true made no library: it is no C compiler"):
        find_compiler("true").build(ANSWER, tmp_path / "answer.so")


def test_a_complaint_of_the_compiler_is_passed_on(tmp_path: Path) -> None:
    with pytest.raises(CompileError, match="error"):
        find_compiler().build("int answer(void) { return nothing; }\n", tmp_path / "broken.so")
    assert list(tmp_path.iterdir()) == []


def test_build_leaves_nothing_but_the_library(tmp_path: Path) -> None:
    find_compiler().build(ANSWER, tmp_path / "answer.so")
    assert [file.name for file in tmp_path.iterdir()] == ["answer.so"]


def test_two_vectors_at_a_time_need_32_registers(tmp_path: Path) -> None:
    def compiler(macro: str, version: str = "gcc 12") -> Compiler:
        command = tmp_path / f"{macro}-cc"
        command.write_text(f"#!/bin/sh\necho '#define {macro} 1'\n")
        command.chmod(0o755)
        return Compiler("cc", (str(command),), version)

    assert [compiler(macro).pairs for macro in ("__AVX512F__", "__aarch64__", "__AVX2__")] == [True, True, False]
    assert not compiler("__AVX512F__", "clang version 19").pairs
    assert not Compiler("cc", (str(tmp_path / "none"),), "gcc 12").pairs


def test_identity_names_compiler_flags_and_processor() -> None:
    compiler = find_compiler()
    assert compiler.version in compiler.identity
    assert "-O3" in compiler.identity
    assert all(feature in compiler.identity for feature in vector_features())
