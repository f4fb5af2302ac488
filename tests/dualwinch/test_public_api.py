# pyright: reportArgumentType=false
import pkgutil
import pydoc
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import dualwinch

NAMES = dir(dualwinch)


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    thing = getattr(dualwinch, name)
    assert thing.__doc__
    assert getattr(dualwinch, name) is thing


def test_the_public_names_are_those_of_the_stub() -> None:
    stub = Path(dualwinch.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    names = re.findall(r"^from \.\S+ import (\w+) as \1\b", stub, re.MULTILINE)
    assert sorted(names) == sorted(set(names)) == sorted(NAMES)
    assert re.fullmatch(r"\d+\.\d+\.\d+", dualwinch.__version__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nothing_here"):
        _ = dualwinch.nothing_here  # pyright: ignore[reportAttributeAccessIssue]


CASE = dualwinch.case(4)
SEA = dualwinch.load_ensemble("sea")


@pytest.mark.parametrize(
    ("called", "message"),
    [
        (lambda: dualwinch.identify(None, "plant.vehicle.mass"), "logs: must be a Log, a Result, a path or a text"),
        (lambda: dualwinch.identify([3], "plant.vehicle.mass"), "logs: must be a Log, a Result, a path or a text"),
        (lambda: dualwinch.identify("a.csv", ["plant.vehicle.mass", 3], CASE), "keys: must be a text or a list of"),
        (lambda: dualwinch.identify("a.csv", "plant.vehicle.mass", CASE, hold_out="a"), "hold_out: must be a number"),
        (lambda: dualwinch.identify("a.csv", "plant.vehicle.mass", 3), "experiment: must be an Experiment, not int"),
        (lambda: dualwinch.identify("a.csv", "plant.vehicle.mass", priors=3), "priors: must be a dictionary, not int"),
        (lambda: dualwinch.excite([None], CASE), "keys: must be a text or a list of texts, not None"),
        (lambda: dualwinch.export_c(CASE, 3), "folder: must be a path, not int"),
        (lambda: dualwinch.export_fmu(CASE, 3), "out: must be a path, not int"),
        (lambda: dualwinch.load_result(3), "path: must be a path, not int"),
        (lambda: dualwinch.compile(None), "function: must be a CasADi Function, not NoneType"),
        (lambda: dualwinch.plant(3), "values: must be a Plant, not int"),
        (lambda: dualwinch.modes(3), "system: must be a LinearSystem (linearise makes one), not int"),
        (lambda: dualwinch.linear_open_loop(CASE, nominal=3), "nominal: must be a Plant, not int"),
        (lambda: dualwinch.nearby_gains(3), "certificate: must be a Certificate (certify makes one), not int"),
        (lambda: dualwinch.tune("foo"), "problem: must be a TuningProblem (tuning_problem makes one), not str"),
        (lambda: dualwinch.tuning_problem(CASE, settings=[3]), "settings: must be a text or a list of texts, not 3"),
        (
            lambda: dualwinch.run_ensemble("sea", 1, 0),
            "ensemble: must be an Ensemble (load_ensemble reads one), not str",
        ),
        (lambda: dualwinch.run_ensemble(SEA, 1.5, 0), "scenarios = 1.5: must be a whole number >= 1"),
        (lambda: dualwinch.run_ensemble(SEA, 1, "a"), 'seed = "a": must be a whole number >= 0'),
        (lambda: dualwinch.ensemble_statistics(3, 1, 0), "ensemble: must be an Ensemble"),
        (lambda: dualwinch.compare(3, SEA, 1, 0), "controllers: must be names and controllers, not int"),
        (lambda: dualwinch.compare({"a": CASE.controller}, "sea", 1, 0), "ensemble: must be an Ensemble"),
        (lambda: dualwinch.sweep(CASE, 3), "values: must be a dictionary of keys and values, not int"),
    ],
)
def test_what_is_of_another_kind_is_said_in_a_line(called: Callable[[], Any], message: str) -> None:
    with pytest.raises(dualwinch.DualwinchError) as caught:
        called()
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    "of",
    [
        "amplitude_sweep", "block", "certify", "export_c", "idealisations", "optimal_preload", "linear_closed_loop",
        "linearise", "operating_point", "override", "resonance_gains", "simulate", "stress", "sweep", "to_toml",
        "tuning_problem",
    ],
)  # fmt: skip
def test_what_is_no_experiment_is_said_in_a_line(of: str) -> None:
    more = {"block": ["plant", 3], "export_c": [3, "there"], "override": [3, {}], "sweep": [3, {}]}
    with pytest.raises(dualwinch.ConfigurationError, match=r"^experiment: must be an Experiment.*, not int$"):
        getattr(dualwinch, of)(*more.get(of, [3]))


HEAVY = {"casadi", "numpy", "scipy", "matplotlib", "pyarrow", "optuna", "pandas", "gymnasium", "http.server", "jinja2"}
HEAVY |= {"rich.markdown", "pygments"}


def loaded_by(program: str) -> set[str]:
    """The heavy modules that a program imports."""
    at_exit = (
        f"import atexit, sys\natexit.register(lambda: print(*({HEAVY!r} & sys.modules.keys()), file=sys.stderr))\n"
    )
    ran = subprocess.run([sys.executable, "-c", at_exit + program], capture_output=True, text=True, check=True)
    return set(ran.stderr.split())


def loaded_by_command(*words: str) -> set[str]:
    """The heavy modules that a command line imports."""
    return loaded_by(f"from dualwinch.cli import main\nmain({list(words)!r})")


def test_help_imports_nothing_heavy() -> None:
    """The list of commands answers at once: libraries wait until a command needs them."""
    assert loaded_by_command("--help") == set()
    assert loaded_by_command("lab", "--help") == loaded_by_command("tune", "--help") == set()


def test_an_experiment_of_the_paper_needs_no_library_but_what_expressions_are_made_of() -> None:
    assert loaded_by("import dualwinch") == set()
    assert loaded_by("import dualwinch; dualwinch.case(4)") <= {"casadi", "numpy"}


def test_help_on_parts_imports_what_lists_them() -> None:
    assert loaded_by_command("simulate", "--help").isdisjoint(
        {"matplotlib", "pyarrow", "optuna", "http.server", "jinja2"}
    )


def test_no_module_of_the_package_hides_a_public_name() -> None:
    """An imported submodule becomes an attribute of its package, in place of what ``__getattr__`` would find."""
    assert not {module.name for module in pkgutil.iter_modules(dualwinch.__path__)} & set(NAMES)


def test_help_is_a_page_and_names_what_there_is() -> None:
    page = pydoc.render_doc(dualwinch, renderer=pydoc.TextDoc())
    assert len(page.splitlines()) < 60
    table = re.findall(r"^    (\S.*?)   ", dualwinch.__doc__ or "", re.MULTILINE)
    names = {name for entry in table for name in re.sub(r"\(.*?\)", "", entry).split(", ")}
    assert len(names) > 15
    assert names - set(NAMES) == set()
