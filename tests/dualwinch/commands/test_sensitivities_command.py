"""The command ``sensitivities``, against the sensitivities that Python gives and complete runs."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.cli import main
from dualwinch.cli.sensitivities import values_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.effects import per
from dualwinch.simulation.batch.sensitivities import differentiable_numbers

MASS, BIAS = "plant.vehicle.mass", "sensors.position_bias"
SHORT = ("--case", "4", "--set", "simulation.duration=0.5")


def said(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    main(["sensitivities", *map(str, words)])
    return capsys.readouterr().out


def short() -> dw.Experiment:
    return dw.override(dw.case(4), {"simulation.duration": 0.5})


def found(*columns: str) -> dw.Sensitivities:
    return dw.sensitivities([MASS, BIAS], [[1e4, 0.0]], [short()], columns=columns)


def test_tables_show_derivatives_and_what_a_percent_more_changes(capsys: pytest.CaptureFixture[str]) -> None:
    out = said(capsys, MASS, BIAS, *SHORT, "--metric", "peak_tension", "--column", "F1")
    rows = [line.split() for line in out.splitlines()]
    merit, column = (row for row in rows if row[:1] == [MASS])
    ours = found("F1")
    gradient, peak = ours.gradients["peak_tension"][0, 0, 0], ours.metrics["peak_tension"][0, 0]
    assert merit == [MASS, "+100", "kg", f"{gradient:.3g}", "N/kg", f"{1e4 * gradient / peak:+.3g}", "%"]
    slopes = ours.column_slopes["F1"][0, 0, :, 0]
    at = int(np.argmax(np.abs(slopes)))
    change = f"{100 * slopes[at]:+.3g}"
    assert column == [MASS, "+100", "kg", f"{slopes[at]:.3g}", "N/kg", change, "N", f"{at * 1e-3:.3g}", "s"]
    assert [row[1:3] for row in rows if row[:1] == [BIAS]] == 2 * [["+0.001", "m"]]  # a percent of its range
    assert "peak_tension = " in out
    assert "F1: tension of rope 1" in out


def test_json_is_all_that_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    content = json.loads(said(capsys, MASS, BIAS, *SHORT, "--column", "F1", "--json"))
    ours = found("F1")
    assert content["outcome"] == "completed"
    assert content["keys"] == {
        MASS: {"value": 1e4, "unit": "kg", "step": 100.0},
        BIAS: {"value": 0.0, "unit": "m", "step": pytest.approx(1e-3)},
    }
    gradient = content["metrics"]["energy"]["gradient"]
    assert list(gradient.values()) == pytest.approx(ours.gradients["energy"][0, 0].tolist())
    largest = np.abs(ours.column_slopes["F1"][0, 0]).max(axis=0)
    assert np.abs(list(content["columns"]["F1"]["largest_slope"].values())) == pytest.approx(largest)


def test_data_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, plot = tmp_path / "slopes.csv", tmp_path / "slopes.svg"
    said(capsys, f"{MASS},{BIAS}", *SHORT, "--column", "e", "--column", "t", "--out", data, "--plot", plot)
    rows = list(csv.DictReader(line for line in data.read_text().splitlines() if not line.startswith("#")))
    ours = found("e", "t")  # compiled once
    assert [float(row["t"]) for row in rows] == pytest.approx(np.arange(500) * 1e-3)
    assert [float(row[f"e by {BIAS}"]) for row in rows] == pytest.approx(ours.slopes[0, 0, :, 1].tolist(), rel=1e-6)
    assert "<svg" in plot.read_text()


def test_keys_by_patterns_and_by_their_old_names() -> None:
    experiment = short()
    assert list(values_of(["plant.rope_*.modulus"], experiment)) == ["plant.rope_1.modulus", "plant.rope_2.modulus"]
    everything = values_of(["*"], experiment)
    assert everything == differentiable_numbers(experiment)
    assert {MASS, BIAS, "nominal.vehicle.mass", "controller.observer.l0"} <= everything.keys()
    nothing_to_scale = {"sensors.position_noise", "disturbance.current_sigma", "disturbance.force.scale"}
    assert everything.keys().isdisjoint({*nothing_to_scale, "simulation.sample_time", "controller.nftsm.p"})
    with pytest.raises(
        ConfigurationError, match=r"plant\.x\*: matches no parameter that runs can be differentiated by"
    ):
        values_of(["plant.x*"], experiment)


@pytest.mark.slow
def test_everything_at_once_runs() -> None:
    """Whatever a pattern names, the run takes."""
    values = differentiable_numbers(short())
    ours = dw.sensitivities(list(values), [list(values.values())], [short()], stride=0)
    assert np.isfinite(ours.gradients["energy"]).all()


@pytest.mark.parametrize(
    ("unit", "other", "expected"),
    [("N", "kg", "N/kg"), ("N", "1", "N"), ("1", "m", "1/m"), ("m", "kg/m^3", "m/(kg/m^3)"), ("m", "N m", "m/(N m)")],
)
def test_units_of_derivatives(unit: str, other: str, expected: str) -> None:
    assert per(unit, other) == expected
