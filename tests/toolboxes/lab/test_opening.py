"""Files that the page opens: TOML is read in whole, and whatever the page does not support is named."""

import json
import shutil
import subprocess
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

import dualwinch as dw
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.experiment_file import loads, to_toml
from dualwinch.config.toml_text import flattened
from dualwinch.model.quantities.tree import leaves
from dualwinch.toolboxes.lab.catalogue import catalogue
from tests.toolboxes.lab.in_node import NODE, of_id

pytestmark = pytest.mark.skipif(NODE is None, reason="needs node")

PAGE = Path(__file__).parents[3] / "toolboxes" / "lab" / "page"
LIBRARY = PAGE.parent / "vendor" / "toml.min.js"
SCRIPT = Path(__file__).parent / "opening_in_node.mjs"
TUNED = "fando-nftsm+self-calibrating-kalman+proportional-tension+site"
OFFERED = ("fando-nftsm", "pid-cascade", "fando-nftsm+two-sided", "fando-nftsm+site", TUNED)

Opens = Callable[..., list[dict[str, Any]]]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page's modules, where node imports them as such."""
    folder = tmp_path_factory.mktemp("page")
    for file in PAGE.glob("*.js"):
        shutil.copy(file, folder)
    (folder / "package.json").write_text('{"type": "module"}')
    return folder


def answers(page: Path, texts: Sequence[str], content: Path | None = None) -> list[Any]:
    arguments = [str(NODE), str(SCRIPT), str(page), str(LIBRARY), *([str(content)] if content else [])]
    done = subprocess.run(arguments, input=json.dumps(texts), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return list(map(json.loads, done.stdout.splitlines()))


@pytest.fixture(scope="module")
def opens(page: Path) -> Opens:
    """Opens texts on a catalogue of some structures."""
    made = catalogue([of_id(name) for name in OFFERED], load_ensemble("rig"), "0")
    (page / "content.json").write_text(json.dumps(made | {"keys": made["keys"] | {"simulation.seed": SEED}}))
    return lambda *texts: answers(page, texts, page / "content.json")


SEED = {"unit": "1", "kind": "integer", "low": 0, "high": 2**32, "default": 0, "optional": False}


def listed(opened: dict[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Key → value in the file and in the page, of what the page does not support."""
    return {entry["key"]: (entry["wanted"], entry.get("used")) for entry in opened["unsupported"]}


TEXTS = [
    'a = 1\nb.c = 2.5e-3 # comment\n[d.\'e f\'."g\\u00e9"]\nh = true\ni = \'raw\\n\'\nj = "q\\"\\t#"\n',
    "a = [1, 2,\n  3, # three\n]\nb = [[1.0], ['x', \"]\"]]\nc = []\n",
    "a = {b = 1, c = {d = [1]}, e.f = 'g'}\n[[metrics]]\nkind = 'k'\nx = 1\n[[metrics]]\nkind = 'l'\n",
    "a = \"\"\"\none\n  two \\\n  three\"\"\"\nb = '''x''y'''\nc = 1_000\nd = 0xff\ne = +7\nf = -0.5\n",
    "\ufeffa = 1\r\n[b]\r\nc = 2\r\n",
]


def test_toml_is_read_as_python_reads_it(page: Path) -> None:
    expected = [dict(flattened(tomllib.loads(text.removeprefix("\ufeff")))) for text in TEXTS]
    assert answers(page, TEXTS) == expected
    assert answers(page, ["a = inf\nb = 12345678901234567890\nc = 1979-05-27\n"]) == [
        {"a": None, "b": "12345678901234567890", "c": "1979-05-27"}
    ]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a = 1\na = 2\n", "line 2: trying to redefine an already defined table or value"),
        ("a = [1, 2\n", "line 2: expected comma or end of structure"),
        ("a = 1 2\n", "line 1: each key-value declaration must be followed by an end-of-line"),
        ("[a\n", "line 1: illegal character in key"),
        ("a = word\n", "line 1: invalid value"),
        ('a = "x\n', "line 1: control characters are not allowed in strings"),
        ("just words\n", "line 1: illegal character in key"),
    ],
)
def test_what_is_no_toml_is_refused_with_its_line(page: Path, text: str, complaint: str) -> None:
    (answer,) = answers(page, [text])
    assert complaint in answer["error"]


def site(**changes: Any) -> dw.Experiment:
    """Case 4 on the nominal machine of the ensemble `site`, as it is shown in the page."""
    return dw.override(of_id("fando-nftsm+site").experiment, changes)


LAGGING = {"sensors.load_cell_time_constant": 1e-3, "sensors.drum_speed_resolution": 7e-4}


def test_files_of_supported_experiments_leave_nothing_out(opens: Opens) -> None:
    tuned = {"controller.estimator": "self-calibrating-kalman", "controller.coordination.kind": "proportional-tension"}
    experiments = [
        *map(dw.case, (1, 2, 3, 4)),
        dw.case(3, "pid-cascade"),
        dw.override(dw.case(4), {"plant.rope_slack": False, "simulation.seed": 7, "simulation.substeps": 3}),
        dw.override(dw.case(4), {"actuator.kind": "motor", "plant.vehicle.mass": 11000.0}),
        dw.override(dw.case(4), LAGGING),
        site(),
        site(**LAGGING),
        site(**tuned, **{"controller.proportional_tension.slow_time": 0.4}),
    ]
    for experiment, opened in zip(experiments, opens(*map(to_toml, experiments)), strict=True):
        assert opened["unsupported"] == []
        same = {key: value for key, value in leaves(experiment).items() if key != "simulation.substeps"}
        assert same.items() <= leaves(loads(opened["toml"])).items()


def test_keys_that_a_file_does_not_give_have_their_defaults(opens: Opens) -> None:
    texts = [
        "",
        "[disturbance]\nvortex = true\n",
        "[actuator]\nkind = 'motor'\n",
        "[actuator.motor]\ntime_constant = 0.02\n",
        "[controller]\nkind = 'pid-cascade'\n[controller.nftsm]\nbeta = 0.1\n[plant.winch_1]\ngear_damping = 500\n",
    ]
    for text, opened in zip(texts, opens(*texts), strict=True):
        assert opened["unsupported"] == []
        known, found = leaves(loads(text)), leaves(loads(opened["toml"]))
        assert {key: value for key, value in found.items() if known.get(key) != value and "gear" not in key} == {}


def test_parts_arrays_and_numbers_of_another_machine_are_named(opens: Opens) -> None:
    points, machine, coordination, own, ensemble = opens(
        "[reference]\nkind = 'way-points'\npoints = [10, 40]\n[plant.rope_2]\nsubmerged_weight = 20\n",
        to_toml(site(**{"controller.kind": "pid-cascade"})),
        "[controller]\nkind = 'pid-cascade'\ncoordination.kind = 'proportional-tension'\n",
        "[controller]\nkind = 'my-law'\n[controller.my_law]\nk = 3\n[plant.rope_1]\nsubmerged_weight = 20\n",
        "[simulation]\nseed = 12345678901234567890\nsample_tme = 1\n",
    )
    assert listed(points) == {
        "reference.kind": ("way-points", "profile"),
        "reference.points": ([10, 40], []),
        "plant.rope_2.submerged_weight": (20, 0),
    }
    assert points["unsupported"][0]["key"] == "reference.kind"
    assert machine["structure"] == "fando-nftsm+site"
    named = listed(machine)
    assert named.pop("controller.kind") == ("pid-cascade", "fando-nftsm")
    assert {(key.startswith("controller.pid_cascade."), used) for key, (_, used) in named.items()} == {(True, None)}
    assert coordination["structure"] == "pid-cascade"
    assert listed(coordination) == {
        "controller.coordination.kind": ("proportional-tension", "differential-tension"),
    }
    assert listed(own) == {
        "controller.kind": ("my-law", "fando-nftsm"),
        "controller.my_law.k": (3, None),
        "plant.rope_1.submerged_weight": (20, 0),
    }
    assert listed(ensemble) == {"simulation.seed": ("12345678901234567890", 0), "simulation.sample_tme": (1, None)}


def test_a_link_names_what_the_page_does_not_support(opens: Opens) -> None:
    whole, partly = opens(
        "#case=4&disturbance.integrated_phase=1&reference.kind=0&plant.rope_slack=false&actuator.motor.time_constant=0.004",
        "#case=4&plant.vehicle.mass=11000&sensors.outage=missing&gone.key=1",
    )
    assert whole["unsupported"] == []
    assert whole["structure"] == "fando-nftsm+two-sided"
    assert listed(partly) == {"sensors.outage": ("missing", "held"), "gone.key": (1, None)}
