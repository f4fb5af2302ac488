"""The examples in the docstrings of the public functions run, and each function has one."""

import doctest
import inspect
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

import dualwinch as dw

SLOW = {"excite", "export_fmu", "identify", "race", "tune"}
"""Functions whose examples search, or compile much."""


@cache
def functions() -> dict[str, object]:
    """Name of a public function → the function."""
    public = {name: getattr(dw, name) for name in dir(dw)}
    return {name: value for name, value in public.items() if inspect.isroutine(value)}


def examples(function: object) -> list[doctest.DocTest]:
    """The examples of a docstring."""
    module = import_module(str(getattr(function, "__module__", "")))
    tests = doctest.DocTestFinder(recurse=False).find(function, getattr(function, "__name__", ""), module)
    return [test for test in tests if test.examples]


def check(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Run the examples of a function in a folder of their own."""
    monkeypatch.chdir(folder)
    tests = examples(functions()[name])
    assert tests, f"{name} has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    for test in tests:
        runner.run(test)
    assert runner.summarize(verbose=False).failed == 0, capsys.readouterr().out


@pytest.mark.parametrize("name", sorted(functions().keys() - SLOW))
def test_its_example_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    check(name, tmp_path, monkeypatch, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SLOW))
def test_its_long_example_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    check(name, tmp_path, monkeypatch, capsys)
