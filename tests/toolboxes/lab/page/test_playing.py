"""Playback, zoom, keyboard, and what a page owes to those who do not use a mouse or do not like motion."""

from collections.abc import Callable

import pytest

from tests.toolboxes.lab.page.conftest import Lab

Opens = Callable[..., Lab]

pytestmark = pytest.mark.external

NAMELESS = """() => [...document.querySelectorAll('input, select, button, #machine, [role="img"], [tabindex="0"]')]
  .filter((element) => !(element.labels?.length || element.getAttribute('aria-label') || element.textContent.trim()))
  .map((element) => element.outerHTML)"""


def seconds(lab: Lab) -> float:
    return float(lab.page.inner_text("#clock").removesuffix(" s"))


def test_everything_has_a_name(opened: Opens) -> None:
    assert opened("#case=4").page.evaluate(NAMELESS) == []


def test_space_plays_and_pauses(opened: Opens) -> None:
    lab = opened("#case=4")
    start = seconds(lab)
    lab.page.keyboard.press("Space")
    assert lab.page.get_attribute("#play", "aria-label") == "Pause"
    lab.page.wait_for_function(f"parseFloat(document.querySelector('#clock').textContent) > {start + 0.2}")
    lab.page.keyboard.press("Space")
    stopped = seconds(lab)
    lab.page.wait_for_timeout(200)
    assert seconds(lab) == stopped


def test_the_scrubber_moves_by_keys(opened: Opens) -> None:
    lab = opened("#case=4")
    lab.page.focus("#scrub")
    lab.page.keyboard.press("Home")
    assert seconds(lab) == 0
    lab.page.keyboard.press("End")
    assert abs(seconds(lab) - 50) < 0.01


def test_ringing_is_shown_in_slow_motion(opened: Opens) -> None:
    lab = opened("#case=1")
    lab.page.get_by_role("button", name="ringing").click()
    assert lab.page.input_value("#speed") == "0.01"
    assert lab.page.get_attribute("#play", "aria-label") == "Pause"
    lab.page.wait_for_function("parseFloat(document.querySelector('#clock').textContent) > 0.001")
    assert seconds(lab) < 0.06


def test_nothing_moves_by_itself_for_those_who_asked(opened: Opens) -> None:
    lab = opened("#case=1", reduced_motion="reduce")
    lab.page.get_by_role("button", name="ringing").click()
    assert lab.page.get_attribute("#play", "aria-label") == "Play"


def test_plots_zoom_together_by_keys(opened: Opens) -> None:
    lab = opened("#case=4")
    plots = lab.page.locator(".plot")
    plots.nth(2).focus()
    before = plots.first.screenshot(), plots.nth(3).screenshot()
    lab.page.keyboard.press("+")
    lab.page.wait_for_timeout(100)
    lab.page.focus("#scrub")
    lab.page.keyboard.press("Home")
    assert abs(seconds(lab) - 11.5) < 0.1  # half of the 50 s, around 23 s
    assert plots.first.screenshot() != before[0]
    assert plots.nth(3).screenshot() != before[1]
    plots.first.focus()
    lab.page.keyboard.press("0")
    lab.page.keyboard.press("Home")
    assert seconds(lab) == 0


def test_a_drag_zooms_all_plots(opened: Opens) -> None:
    lab = opened("#case=4")
    box = lab.page.locator(".u-over").first.bounding_box()
    middle = box["y"] + box["height"] / 2
    lab.page.mouse.move(box["x"] + 0.2 * box["width"], middle)
    lab.page.mouse.down()
    lab.page.mouse.move(box["x"] + 0.6 * box["width"], middle, steps=5)
    lab.page.mouse.up()
    lab.page.focus("#scrub")
    lab.page.keyboard.press("Home")
    assert abs(seconds(lab) - 10) < 0.3
    lab.page.keyboard.press("End")
    assert abs(seconds(lab) - 30) < 0.3


def test_parameters_are_found_by_words(opened: Opens) -> None:
    lab = opened("#case=4")
    lab.page.fill("#find", "jerk")
    visible = lab.page.locator(".row:visible").evaluate_all("(rows) => rows.map((row) => row.dataset.key)")
    assert visible == ["reference.jerk_limit"]
