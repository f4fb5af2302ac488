"""What the page shows is what the product computes, and what a hand on a slider does to it."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import dualwinch as dw
from tests.toolboxes.lab.page.conftest import Lab

Opens = Callable[..., Lab]

pytestmark = pytest.mark.external


def digits(text: str) -> float:
    return float(text.replace("\u202f", "").replace("−", "-"))


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [420, 800, 1200, 1600])
def test_nothing_sticks_out(opened: Opens, width: int, scheme: str) -> None:
    lab = opened(width=width, color_scheme=scheme)
    assert lab.page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert lab.page.locator(".panel canvas").count() == 4
    background = lab.page.evaluate("getComputedStyle(document.documentElement).backgroundColor")
    assert (sum(map(int, background.removeprefix("rgb(").rstrip(")").split(","))) < 200) == (scheme == "dark")


def test_the_theme_is_switched_by_hand_and_stays(opened: Opens) -> None:
    lab = opened(color_scheme="light")
    lab.page.click("#theme")
    lab.page.click("#theme")
    dark = lab.page.evaluate("getComputedStyle(document.documentElement).backgroundColor")
    lab.page.reload()
    lab.settle()
    assert lab.page.evaluate("getComputedStyle(document.documentElement).backgroundColor") == dark == "rgb(21, 23, 26)"


def test_its_rows_are_those_of_simulate(opened: Opens, tmp_path: Path) -> None:
    lab = opened("#case=4&controller.observer.l0=8&sensors.position_noise=0.0005&simulation.seed=3")
    lab.page.click("#menu summary")
    with lab.page.expect_download() as download:
        lab.page.click("[data-do=csv]")
    download.value.save_as(tmp_path / "run.csv")
    with (tmp_path / "run.csv").open() as file:
        rows = list(csv.DictReader(file))
    settings = {"controller.observer.l0": 8, "sensors.position_noise": 5e-4, "simulation.seed": 3}
    expected = dw.simulate(dw.override(dw.case(4), settings))
    assert len(rows) == len(expected["t"])
    assert np.abs([float(row["x"]) for row in rows] - expected["x"]).max() < 1e-9
    assert digits(lab.merit("mean |e|")) == pytest.approx(1e3 * expected.metrics.mae, rel=1e-3)


def test_a_moved_slider_runs_anew(opened: Opens) -> None:
    lab = opened("#case=4")
    before = lab.merit("steady mean |e|")
    slider = lab.row("controller.observer.l0").locator("input[type=range]")
    slider.focus()
    for _ in range(8):
        lab.after(lambda: lab.page.keyboard.press("PageUp"))
    value = digits(lab.row("controller.observer.l0").locator("input[type=text]").input_value())
    assert value > 20
    assert digits(lab.merit("steady mean |e|")) < 0.3 * digits(before)
    assert f"controller.observer.l0={value:g}" in lab.page.url
    lab.after(lambda: lab.row("controller.observer.l0").locator(".reset").click())
    assert lab.merit("steady mean |e|") == before


def test_a_number_beyond_its_bounds_is_refused(opened: Opens) -> None:
    lab = opened("#case=4")
    url = lab.page.url
    lab.write("simulation.delay_samples", "101")
    row = lab.row("simulation.delay_samples")
    assert row.locator("input[type=text]").get_attribute("aria-invalid") == "true"
    assert "Out of range; 0 to 100." in row.locator(".about").inner_text()
    lab.write("simulation.delay_samples", "1.5")
    assert "Must be a whole number." in row.locator(".about").inner_text()
    assert lab.page.url == url
    lab.after(lambda: lab.write("simulation.delay_samples", "2"))
    assert row.locator("input[type=text]").get_attribute("aria-invalid") == "false"


def test_fields_show_what_has_room_and_links_hold_all_digits(opened: Opens) -> None:
    lab = opened("#case=4")
    for key, text, shown in [
        ("controller.auxiliary.gamma", "0.00000124605", "1.25e-6"),
        ("plant.rope_1.modulus", "81234567890", "8.12e10"),
        ("plant.vehicle.mass", "10123.456", "10123"),
    ]:
        lab.after(lambda key=key, text=text: lab.write(key, text))
        field = lab.row(key).locator("input[type=text]")
        assert field.input_value() == shown
        assert field.evaluate("(field) => field.scrollWidth <= field.clientWidth")
    assert "controller.auxiliary.gamma=0.00000124605&" in lab.page.url
    assert "plant.rope_1.modulus=81234567890&" in lab.page.url


def test_a_pinned_run_stays_beside(opened: Opens) -> None:
    lab = opened("#case=4")
    pinned = lab.merit("mean |e|")
    lab.page.click("#pin")
    lab.after(lambda: lab.page.select_option("select[data-key='controller.kind']", "nftsm"))
    assert lab.merit("mean |e|", 1) == pinned
    share = digits(lab.merit("mean |e|")) / digits(pinned) - 1
    assert lab.merit("mean |e|", 2) == f"+{100 * share:.0f} %"
    assert lab.page.locator(".panel").first.locator("dd.behind").inner_text().startswith("A ")
    lab.page.click("#pin")
    assert lab.page.locator("dd.behind").count() == 0


def test_an_estimate_that_the_filter_compensates_is_shown_whole(opened: Opens) -> None:
    lab = opened("#case=4&controller.estimator=kalman&controller.kalman.compensation=0.8")
    settings = {"controller.estimator": "kalman", "controller.kalman.compensation": 0.8}
    expected = dw.simulate(dw.override(dw.case(4), settings))
    panel = lab.page.locator(".panel", has=lab.page.locator("h3", has_text="Disturbance"))
    names = [name.inner_text() for name in panel.locator("dt").all()]
    assert names == ["true", "estimated", "by the law alone"]
    shown = [digits(value.inner_text().split()[0]) for value in panel.locator("dd").all()]
    row = int(np.argmin(np.abs(expected["t"] - 0.46 * expected["t"][-1])))
    own, whole = expected["d_hat"][row], expected["d_hat"][row] + 0.8 * expected["d_est"][row]
    assert shown == pytest.approx([expected["d_true"][row], whole, own], rel=1e-2)
    lab.page.click("#menu summary")
    with lab.page.expect_download() as download:
        lab.page.click("[data-do=csv]")
    names = download.value.path().read_text().splitlines()[0].split(",")
    assert {"d_hat", "d_est"} <= {*names}
    assert not {"d_total", "d_law"} & {*names}
    lab.after(lambda: lab.page.select_option("select[data-key='controller.estimator']", "lowpass"))
    assert [name.inner_text() for name in panel.locator("dt").all()] == ["true", "estimated"]


def test_a_link_brings_it_back(opened: Opens) -> None:
    first = opened("#case=3")
    first.after(lambda: first.write("plant.vehicle.mass", "11000"))
    first.after(lambda: first.page.select_option("select[data-key='controller.kind']", "pid-cascade"))
    second = opened(first.page.url.partition("#")[2].join(["#", ""]))
    assert second.page.url == first.page.url
    assert second.page.inner_text("#merits") == first.page.inner_text("#merits")


def test_it_leaves_as_a_file_that_means_the_same(opened: Opens, tmp_path: Path) -> None:
    lab = opened(
        "#case=3&actuator.motor.time_constant=0.004&controller.kind=pid-cascade&plant.vehicle.mass=11000&simulation.delay_samples=2"
    )
    lab.page.click("#menu summary")
    with lab.page.expect_download() as download:
        lab.page.click("[data-do=toml]")
    file = tmp_path / "experiment.toml"
    download.value.save_as(file)
    settings = {
        "plant.vehicle.mass": 11000.0,
        "simulation.delay_samples": 2,
        "actuator.kind": "motor",
        "actuator.motor.time_constant": 0.004,
    }
    assert dw.load(file) == dw.override(dw.case(3, "pid-cascade"), settings)
    again = opened()
    again.after(lambda: again.page.set_input_files("#file", file))
    assert again.page.url == lab.page.url


def test_a_heavy_machine_leaves_as_a_file_that_means_the_same(opened: Opens, tmp_path: Path) -> None:
    lab = opened("#case=site&plant.rope_1.mass_per_length=2")
    lab.page.click("#menu summary")
    with lab.page.expect_download() as download:
        lab.page.click("[data-do=toml]")
    download.value.save_as(tmp_path / "heavy.toml")
    run = dw.simulate(dw.load(tmp_path / "heavy.toml"))
    assert run.experiment.plant.rope_1.mass_per_length == 2
    assert (
        run.experiment.plant.winch_2.gear_stiffness == dw.load_ensemble("site").experiment.plant.winch_2.gear_stiffness
    )
    assert digits(lab.merit("mean |e|")) == pytest.approx(1e3 * run.metrics.mae, rel=1e-3)


def test_what_the_plant_leaves_out_is_said_and_ropes_sag_as_the_run_has_it(opened: Opens) -> None:
    lab = opened("#case=4")
    assert lab.page.inner_text("#idealised").startswith(
        "Idealised: winches of 1.8 kg m² (20 R² = 12.8), ropes without mass and weight (w s/T = 5.09 at 200 N)."
    )
    row = lab.page.evaluate(BELOW_ROPES)
    lab.after(lambda: lab.page.click("label[title*=site]"))
    assert "one transverse mode a span (Ernst's factor 0.0065 at 200 N)" in lab.page.inner_text("#idealised")
    assert lab.page.evaluate(BELOW_ROPES) > row + 50


BELOW_ROPES = """(() => {
  const canvas = document.querySelector("#machine"), dots = devicePixelRatio || 1;
  const {data} = canvas.getContext("2d").getImageData(40 * dots, 95 * dots, canvas.width / 3, 8 * dots);
  return data.filter((value, index) => index % 4 === 3 && value > 0).length;
})()"""
"""Pixels that are drawn below rope 2 and above the rail."""


def test_its_command_line_means_the_same(opened: Opens) -> None:
    lab = opened(
        "#case=4&controller.observer.l0=7.5&disturbance.integrated_phase=1",
        permissions=["clipboard-read", "clipboard-write"],
    )
    lab.page.click("#menu summary")
    lab.page.click("[data-do=command]")
    lab.page.wait_for_function("document.querySelector('#status').textContent.includes('command line')")
    assert lab.page.evaluate("navigator.clipboard.readText()") == (
        "uv run dualwinch simulate --case 4 --set controller.observer.l0=7.5 --set disturbance.integrated_phase=true"
    )


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_runs_of_ones_own_are_opened(opened: Opens, tmp_path: Path, kind: str) -> None:
    result = dw.simulate(dw.override(dw.case(2), {"controller.kind": "nftsm"}), stride=10)
    file = tmp_path / f"mine.{kind}"
    dw.save(result, file)
    lab = opened("#case=4")
    lab.page.set_input_files("#file", file)
    lab.page.wait_for_function("document.querySelector('#pin').title.startsWith('A: mine')")
    entry = lab.page.locator(".panel").nth(1).locator("dl > div", has_text="F₁").locator("dd.behind")
    row = int(np.argmin(np.abs(result["t"] - 23)))
    assert digits(entry.inner_text().removeprefix("A ")) == pytest.approx(result["F1"][row], abs=0.51)
    if kind == "parquet":
        assert digits(lab.merit("mean |e|", 1)) == pytest.approx(1e3 * result.metrics.mae, rel=1e-3)


def test_what_is_no_run_is_refused(opened: Opens, tmp_path: Path) -> None:
    lab = opened("#case=4")
    for name, text, complaint in [
        ("a.csv", "u,v\n1,2\n3,4\n", "must have a column t"),
        ("b.txt", "x", "must be a .toml, .csv or .parquet file"),
    ]:
        (tmp_path / name).write_text(text)
        lab.page.set_input_files("#file", tmp_path / name)
        lab.page.wait_for_function(f"document.querySelector('#status').textContent.includes({complaint!r})")


def test_a_run_that_leaves_the_rail_says_so(opened: Opens) -> None:
    lab = opened("#case=1&reference.speed=4")
    assert lab.page.inner_text("#outcome").startswith("The vehicle left the rail at")
    assert lab.merit("mean |e|") == "–"
