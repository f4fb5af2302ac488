"""After a file is opened that the page does not support in whole, a notice says so until it is dismissed."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

import dualwinch as dw
from dualwinch.toolboxes.lab.assemble import assemble, own_run
from dualwinch.toolboxes.lab.content import Content
from tests.toolboxes.lab.page.conftest import Lab

Opens = Callable[..., Lab]

pytestmark = pytest.mark.external

MINE = """
[controller.coordination]
kind = "proportional-tension"
[controller.proportional_tension]
slow_time = 0.5
[reference]
kind = "way-points"
points = [
  10, 40,  # m
]
pauses = [1, 1]
[plant.rope_1]
submerged_weight = 20
[sensors]
drum_speed_resolution = 7e-4
outage = "held"
"""

NAMED = [
    "controller.coordination.kind: proportional-tension → differential-tension",
    "reference.kind: way-points → profile",
    "plant.rope_1.submerged_weight: 20 → 0",
    "reference.points: [10, 40] → []",
    "reference.pauses: [1, 1] → []",
    "controller.proportional_tension.slow_time: 0.5 is left out",
]


def opened_file(lab: Lab, file: Path, text: str) -> None:
    file.write_text(text)
    lab.after(lambda: lab.page.set_input_files("#file", file))


def test_whatever_the_page_does_not_support_is_named_until_it_is_dismissed(opened: Opens, tmp_path: Path) -> None:
    lab = opened(reduced_motion="reduce")
    notice = lab.page.locator("#notice")
    assert notice.get_attribute("role") == "status"
    assert not notice.is_visible()
    opened_file(lab, tmp_path / "my machine.toml", MINE)
    lab.page.wait_for_timeout(4500)
    assert notice.locator("strong").inner_text() == "This is not the machine of my machine.toml."
    assert f"does not support {len(NAMED)} of its values" in notice.inner_text()
    assert [entry for entry in notice.locator("li").all_inner_texts() if entry] == NAMED[:4]
    notice.get_by_text("2 more").click()
    assert sorted(notice.locator("li").all_inner_texts()) == sorted(NAMED)
    assert notice.locator("code").all_inner_texts()[-2:] == [
        "uv run dualwinch simulate --config 'my machine.toml' --plot run.png",
        "uv run dualwinch simulate --config 'my machine.toml' --out run.parquet",
    ]
    notice.get_by_role("button", name="Dismiss").press("Enter")
    assert not notice.is_visible()
    assert lab.page.evaluate("document.activeElement.closest('#menu') !== null")


def test_a_file_that_is_supported_in_whole_leaves_no_notice(opened: Opens, tmp_path: Path) -> None:
    lab = opened()
    opened_file(lab, tmp_path / "mine.toml", MINE)
    assert lab.page.locator("#notice").is_visible()
    opened_file(lab, tmp_path / "mine.toml", "[plant.vehicle]\nmass = 11000.0\n[reference]\npoints = []\n")
    assert not lab.page.locator("#notice").is_visible()
    assert lab.page.inner_text("#status") == "mine.toml is open."


def test_a_file_that_is_no_experiment_is_refused(opened: Opens, tmp_path: Path) -> None:
    lab = opened()
    for text, complaint in [
        ("[plant]\nmass\n", "mine.toml, line 2: illegal character in key"),
        ('[ensemble]\nname = "a"\n', "mine.toml is an ensemble, no experiment"),
    ]:
        (tmp_path / "mine.toml").write_text(text)
        lab.page.set_input_files("#file", tmp_path / "mine.toml")
        lab.page.wait_for_function(f"document.querySelector('#status').textContent.includes({json.dumps(complaint)})")


@pytest.mark.parametrize("width", [420, 1200])
def test_the_notice_does_not_stick_out(opened: Opens, tmp_path: Path, width: int) -> None:
    lab = opened(width=width)
    opened_file(lab, tmp_path / f"{'long' * 30}.toml", MINE)
    lab.page.click("#notice summary")
    assert lab.page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_a_run_of_ones_own_on_another_machine_says_so(opened: Opens, made: Content, tmp_path: Path) -> None:
    own = dw.simulate(dw.override(dw.case(2), {"reference.kind": "way-points", "reference.points": (10.0, 20.0)}))
    file = tmp_path / "run.html"
    file.write_text(assemble(made.catalogue, made.modules, own_run("run.parquet", own)), encoding="utf-8")
    lab = opened()
    lab.page.goto(file.as_uri())
    lab.settle()
    assert lab.page.inner_text("#notice strong") == "The run beside A is not of A’s machine."
    assert "reference.points: [10, 20] → []" in lab.page.locator("#notice li").all_inner_texts()


def test_a_link_with_unknown_keys_says_so(opened: Opens) -> None:
    lab = opened("#case=4&sensors.outage=missing")
    assert lab.page.locator("#notice li").all_inner_texts() == ["sensors.outage: missing → held"]
    lab.after(lambda: lab.page.click("#reset"))
    assert not lab.page.locator("#notice").is_visible()
