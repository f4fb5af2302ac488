"""ES modules as one script: order, scopes of their own, errors."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from dualwinch.toolboxes.lab.assemble import bundle

PAGE = Path(__file__).parents[4] / "toolboxes" / "lab" / "page"


def written(folder: Path, **modules: str) -> Path:
    for name, text in modules.items():
        (folder / f"{name}.js").write_text(text)
    return folder / "main.js"


MODULES = {
    "main": """import {area as areaOf, SIDE} from "./square.js";
import {half} from "./half.js";
console.log(JSON.stringify([areaOf(), half(SIDE)]));
""",
    "square": """import {half} from "./half.js";
const helper = 3;
export const SIDE = 2 * half(2 * helper);
export function area() { return SIDE * SIDE; }
""",
    "half": """const helper = 2;
export function half(value) { return value / helper; }
""",
}


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
def test_equal_names_of_two_modules_stay_apart(tmp_path: Path) -> None:
    script = bundle(written(tmp_path, **MODULES))
    done = subprocess.run(["node", "-e", script], capture_output=True, text=True, check=True)  # noqa: S607
    assert json.loads(done.stdout) == [36, 3]


def test_a_module_comes_once_and_before_those_that_need_it(tmp_path: Path) -> None:
    script = bundle(written(tmp_path, **MODULES))
    assert script.count("return value / helper") == 1
    assert script.index("return value / helper") < script.index("SIDE * SIDE") < script.index("console.log")


def test_another_file_is_read_instead(tmp_path: Path) -> None:
    entry = written(tmp_path, **MODULES, other="export function half(value) { return 0 * value; }\n")
    script = bundle(entry, {tmp_path / "half.js": tmp_path / "other.js"})
    assert "0 * value" in script
    assert "value / helper" not in script


def test_circles_are_refused(tmp_path: Path) -> None:
    entry = written(
        tmp_path, main='import {a} from "./other.js";\n', other='import {b} from "./main.js";\nexport const a = 1;\n'
    )
    with pytest.raises(ValueError, match=r"main\.js: imports itself, by way of main\.js, other\.js"):
        bundle(entry)


@pytest.mark.parametrize(
    "line",
    [
        'import engine from "./half.js";',
        'import * as all from "./half.js";',
        "export default 3;",
        "export {half};",
        "export let a = 1;",
    ],
)
def test_what_is_not_understood_is_refused(tmp_path: Path, line: str) -> None:
    with pytest.raises(ValueError, match=r"main\.js: cannot bundle '"):
        bundle(written(tmp_path, main=line + "\n", half=MODULES["half"]))


@pytest.mark.parametrize("entry", ["main.js", "worker.js"])
def test_the_page_is_bundled(entry: str) -> None:
    script = bundle(PAGE / entry)
    assert "\nimport " not in script
    assert "\nexport " not in script
