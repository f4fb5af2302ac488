"""The animation shows the run: right states at right times, whole files, and nothing that a README could not play."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from dualwinch.cli import main
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.lab.animation import LEFT, RIGHT, SLACK, animation, colour

SVG = "{http://www.w3.org/2000/svg}"
LARGEST_FILE = 600_000


@pytest.fixture(scope="module")
def run(paper_run: Callable[[int, str], Result]) -> Result:
    return paper_run(4, "fando-nftsm")


@pytest.fixture(scope="module")
def root(run: Result) -> ET.Element:
    return ET.fromstring(animation(run))  # noqa: S314  # our own


def frames(root: ET.Element, kind: str) -> list[list[float]]:
    moving = [element for element in root.iter(f"{SVG}animateTransform") if element.get("type") == kind]
    return [[float(frame.split()[0]) for frame in element.get("values", "").split(";")] for element in moving]


def test_the_vehicle_is_where_the_run_says(root: ET.Element, run: Result) -> None:
    reference, vehicle = frames(root, "translate")
    rows = np.linspace(0, len(run["t"]) - 1, len(vehicle)).astype(int)
    metres = (np.array(vehicle) - LEFT) / (RIGHT - LEFT) * 50
    np.testing.assert_allclose(metres, run["x"][rows], atol=0.01)
    np.testing.assert_allclose(np.array(reference), np.array(vehicle), atol=0.2)  # 6 mm are 0.1 pixels


def test_drums_turn_the_way_they_retrieve(root: ET.Element, run: Result) -> None:
    left, right = frames(root, "rotate")
    assert right[-1] == pytest.approx(np.degrees(run["theta_1"][-1]), abs=0.1)
    assert left[-1] == pytest.approx(-np.degrees(run["theta_2"][-1]), abs=0.1)
    assert right[-1] > 0  # on the screen clockwise: rope comes in over the drum's top, from the left
    assert left[-1] > 0


def test_ropes_have_the_colours_of_their_tensions(root: ET.Element, run: Result) -> None:
    strokes = [
        element.get("values", "").split(";")
        for element in root.iter(f"{SVG}animate")
        if element.get("attributeName") == "stroke"
    ]
    rows = np.linspace(0, len(run["t"]) - 1, len(strokes[0])).astype(int)
    highest = run.experiment.controller.limits.tension_max
    for name, colours in zip(("F2", "F1"), strokes, strict=True):
        assert colours == [colour(value, highest) for value in run[name][rows]]
    assert len(set(strokes[1])) > 20
    assert colour(0.0, 5e3) == SLACK != colour(1.0, 5e3)


def ropes(text: str) -> list[list[str]]:
    """Lines of rope 2 and rope 1, frame by frame."""
    moving = [one for one in ET.fromstring(text).iter(f"{SVG}animate") if one.get("attributeName") == "d"]  # noqa: S314
    return [element.get("values", "").split(";") for element in moving][:2]


def test_ropes_without_sag_are_straight(run: Result) -> None:
    for frame in (line for rope in ropes(animation(run)) for line in rope):
        assert re.fullmatch(r"M[\d.]+ [\d.]+H[\d.]+", frame)
    assert "sag" not in animation(run)


def test_ropes_sag_between_rollers_as_the_run_says(run: Result) -> None:
    experiment = with_leaves(run.experiment, {"plant.track.roller_spacing": 2.0})
    sags = {"sag_1": np.full(len(run["t"]), 4e-3), "sag_2": np.linspace(2e-3, 8e-3, len(run["t"]))}
    text = animation(replace(run, experiment=experiment, columns=run.columns | sags))
    assert "sag of the ropes × 100" in text
    scale, (rope_2, rope_1) = (RIGHT - LEFT) / 50, ropes(text)
    spans = [
        [[float(word) for word in span.split()] for span in line.split("q")[1:]] for line in (rope_1[0], rope_2[-1])
    ]
    assert len(spans[0]) == pytest.approx(50 / 2, abs=1), "from the drum to the vehicle"
    for first, sag in zip((spans[0][0], spans[1][0]), (4e-3, 8e-3), strict=True):
        half, twice, whole, level = first
        assert (abs(half), abs(whole), level) == pytest.approx((scale, 2 * scale, 0.0), abs=0.06)
        assert twice == pytest.approx(2 * 100 * sag * scale, abs=0.06)
    far = animation(
        replace(run, experiment=run.experiment, columns=run.columns | {"sag_1": np.full(len(run["t"]), 6.0)})
    )
    assert "sag of the ropes to scale" in far


def test_it_is_one_small_file_without_scripts_or_links(run: Result) -> None:
    text = animation(run)
    assert len(text) < LARGEST_FILE
    assert text == animation(run)
    assert "<script" not in text
    assert "href" not in text
    assert not re.search(r"\bnan\b|\binf\b", text)
    assert "mm)" in text


def test_a_run_without_rows_cannot_be_played() -> None:
    bare = simulate(case(4), stride=0)
    with pytest.raises(ConfigurationError, match="stride >= 1"):
        animation(bare)


def test_simulate_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "machine.svg"
    main(["simulate", "--case", "2", "--set", "simulation.duration=0.5", "--animate", str(file)])
    assert "wrote" in capsys.readouterr().err
    assert file.read_text().startswith("<svg")
