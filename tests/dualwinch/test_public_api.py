import pkgutil
import pydoc
import re
import subprocess
import sys
from pathlib import Path

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
