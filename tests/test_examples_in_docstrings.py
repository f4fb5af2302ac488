"""The examples in the docstrings of the public functions run, and each function has one."""

import doctest
import inspect
from functools import cache
from importlib import import_module

import pytest

import dualwinch as dw

LACKING = """
    block compare compile controller_function ensemble_statistics excite export_c export_casadi export_fmu export_mex
    export_st generate_c identify load load_ensemble load_result nominal_forces override paper_controller plant race
    register rollout run_ensemble save save_ensemble sensitivities simulate stress sweep to_toml tune tuning_problem
    case clip where
"""
"""Public functions whose docstring has no example yet: this list may only shrink."""


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


@pytest.mark.parametrize("name", sorted(functions().keys() - LACKING.split()))
def test_its_example_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    tests = examples(functions()[name])
    assert tests, f"{name} has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    for test in tests:
        runner.run(test)
    assert runner.summarize(verbose=False).failed == 0, capsys.readouterr().out


def test_no_function_with_an_example_is_said_to_lack_one() -> None:
    assert functions().keys() >= set(LACKING.split())
    assert not [name for name in LACKING.split() if examples(functions()[name])]
