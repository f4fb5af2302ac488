"""Where parts come from, and what their digest depends on."""

import hashlib
import subprocess
import sys
from pathlib import Path

import pytest

from dualwinch.config.plugins import load_plugin
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.quantities.part import built_in, digest, named, origin, source_of
from tests.own_parts import StateFeedback
from tests.spring_law import SPRING, changed


def test_built_in_parts_come_with_the_package() -> None:
    assert built_in(Nftsm)
    assert not built_in(StateFeedback)


def test_parts_are_named_by_their_module_or_file(tmp_path: Path) -> None:
    file = tmp_path / "law.py"
    file.write_text(SPRING)
    load_plugin(str(file))
    law = POSITION_LAWS["spring"]
    assert (named(law), source_of(law)) == ("Spring of law.py", str(file))
    assert origin(law) == (str(file), "Spring")
    assert named(StateFeedback) == "tests.own_parts.StateFeedback"
    assert source_of(StateFeedback) == "tests.own_parts"


def test_the_digest_of_a_file_is_that_of_its_text(tmp_path: Path) -> None:
    file = tmp_path / "law.py"
    file.write_text(SPRING)
    load_plugin(str(file))
    assert digest(POSITION_LAWS["spring"]) == hashlib.sha256(SPRING.encode()).hexdigest()


def helped(folder: Path, helper: str) -> str:
    """The digest of a law that takes a number from a module beside it, in a process of its own."""
    (folder / "helper_of_springs.py").write_text(helper)
    (folder / "law.py").write_text("from helper_of_springs import Damping\n" + changed(("= 2e4", "= Damping.VALUE")))
    program = (
        "from dualwinch.config.plugins import load_plugin; from dualwinch.model.quantities.part import digest\n"
        "from dualwinch.controllers.registry import POSITION_LAWS\n"
        f"load_plugin({str(folder / 'law.py')!r}); print(digest(POSITION_LAWS['spring']))"
    )
    return subprocess.run([sys.executable, "-B", "-c", program], capture_output=True, text=True, check=True).stdout


def test_the_digest_counts_the_modules_beside_a_file(tmp_path: Path) -> None:
    text = "class Damping:\n    VALUE = 2e4\n"
    first = helped(tmp_path, text)
    assert helped(tmp_path, text) == first
    assert helped(tmp_path, text.replace("2e4", "3e4")) != first


@pytest.mark.parametrize("name", ["my_script.py", "-"])
def test_scripts_and_what_is_typed(tmp_path: Path, name: str) -> None:
    """A script has a file; what comes from standard input has no source."""
    asked = "\nfrom dualwinch.model.quantities.part import digest, named, source_of\n"
    program = SPRING + asked + "print(named(Spring), digest(Spring) != '', source_of(Spring), sep='|')\n"
    file = tmp_path / name
    if name != "-":
        file.write_text(program)
    words = [sys.executable, str(file) if name != "-" else "-"]
    done = subprocess.run(words, input=program, capture_output=True, text=True, check=True).stdout.strip()
    assert done == (f"Spring of my_script.py|True|{file}" if name != "-" else "__main__.Spring|False|__main__")
