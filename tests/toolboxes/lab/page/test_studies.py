"""Questions that notice their answers, twenty machines, and a minute's tuning."""

import re
from collections.abc import Callable

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.config.ensemble_file import load_ensemble
from tests.toolboxes.lab.page.conftest import Lab

Opens = Callable[..., Lab]

pytestmark = pytest.mark.external

ANSWERS = [
    ("Make rope 2 go slack", "controller.coordination.preload", "800"),
    ("Find L₀ for −76 %", "controller.observer.l0", "5.4"),
    ("Add delay until it oscillates", "simulation.delay_samples", "50"),
    ("Start Case 1 without the kick", "reference.jerk_limit", "0.1"),
    ("Find the cheapest preload", "controller.coordination.preload", "1800"),
]


@pytest.mark.parametrize(("title", "key", "value"), ANSWERS)
def test_questions_notice_their_answers(opened: Opens, title: str, key: str, value: str) -> None:
    lab = opened()
    question = lab.page.locator(".question", has_text=title)
    question.locator("summary").first.click()
    lab.after(lambda: question.get_by_role("button", name="Begin").click())
    question.locator(".now", has_text="Now:").wait_for()
    assert not question.evaluate("(entry) => entry.classList.contains('answered')")
    lab.after(lambda: lab.write(key, value))
    question.locator(".solved:not(:empty)").wait_for()
    assert question.evaluate("(entry) => entry.classList.contains('answered')")


def test_twenty_machines_run_under_one_controller(opened: Opens) -> None:
    lab = opened("#case=4")
    lab.page.click("summary:has-text('Twenty machines')")
    lab.page.click("#ensemble .go")
    lab.page.wait_for_function(
        "document.querySelector('#ensemble .summary').textContent.startsWith('20 of 20')", timeout=120_000
    )
    found = re.search(
        r"mean \|e\| ([\d.]+) mm \(median\), ([\d.]+) mm \(worst\)", lab.page.inner_text("#ensemble .summary")
    )
    assert found
    expected = 1e3 * np.array(dw.run_ensemble(load_ensemble("rig", dw.case(4)), 20, seed=0).metrics["mae"])
    assert float(found[1]) == pytest.approx(np.median(expected), rel=5e-3)
    assert float(found[2]) == pytest.approx(np.max(expected), rel=5e-3)
    assert lab.page.locator("#ensemble canvas").count() == 1


def test_tuning_stops_when_told_and_its_gains_are_taken(opened: Opens) -> None:
    lab = opened("#case=4")
    before = float(lab.merit("mean |e|"))
    lab.page.click("summary:has-text('Tune for a minute')")
    lab.page.click("#tuning .go")
    lab.page.locator("#tuning .gains li").first.wait_for(timeout=60_000)
    lab.page.click("#tuning .go")
    lab.page.locator("#tuning .take").wait_for()
    lab.after(lambda: lab.page.click("#tuning .take"))
    assert float(lab.merit("mean |e|")) < before
    assert float(lab.merit("mean |e|", 1)) == before
