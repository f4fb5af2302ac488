import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import dualwinch as dw
from dualwinch.cli import main
from dualwinch.cli.output import numbers_between
from dualwinch.cli.sweep import axes_from
from dualwinch.model.errors import ConfigurationError
from tests.own_metrics import LastBeyond

L0 = "controller.observer.l0"
SHORT = ("--case", "4", "--set", "simulation.duration=0.5")


def said(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    main(["sweep", *map(str, words)])
    return capsys.readouterr().out


def test_a_key_over_a_range_is_a_table_of_figures_of_merit(capsys: pytest.CaptureFixture[str]) -> None:
    out = said(capsys, f"{L0}=1:9:4", *SHORT, "--metric", "mse", "--metric", "chatter")
    for value in (1, 5, 9):
        metrics = dw.simulate(dw.override(dw.case(4), {L0: value, "simulation.duration": 0.5})).metrics
        (row,) = (line.split() for line in out.splitlines() if line.split()[:1] == [str(value)])
        assert row[1:] == [f"{metrics.mse:.4g}", f"{metrics.chatter:.4g}"]
    assert f"{L0} (1/s)" in out
    assert "mse (m²)" in out


def test_two_keys_are_a_table_down_and_across_also_of_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plot, data = tmp_path / "sweep.png", tmp_path / "sweep.csv"
    words = ("controller.kind=nftsm,adrc", "simulation.delay_samples=0:1:1", *SHORT)
    out = said(capsys, *words, "--plot", plot, "--out", data)
    assert "mse (m²) over controller.kind (down) and simulation.delay_samples" in out
    firsts = [line.split()[0] for line in out.splitlines() if line.strip()]
    assert [word for word in firsts if word in {"nftsm", "adrc"}] == ["nftsm", "adrc"]
    assert plot.read_bytes().startswith(b"\x89PNG")
    rows = list(csv.DictReader(data.read_text().splitlines()))
    assert [(row["controller.kind"], row["simulation.delay_samples"]) for row in rows] == [
        (kind, str(delay)) for kind in ("nftsm", "adrc") for delay in range(2)
    ]
    last = dw.override(
        dw.case(4), {"controller.kind": "adrc", "simulation.delay_samples": 1, "simulation.duration": 0.5}
    )
    assert float(rows[-1]["mse"]) == pytest.approx(dw.simulate(last).metrics.mse, rel=1e-6)
    assert rows[-1]["outcome"] == "completed"


def test_json_has_every_figure_of_merit_and_nothing_else_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    content = json.loads(said(capsys, "plant.rope_slack=true,false", *SHORT, "--json"))
    assert content["keys"] == ["plant.rope_slack"]
    assert [run["plant.rope_slack"] for run in content["runs"]] == [True, False]
    assert set(dw.simulate(dw.case(2)).metrics) <= set(content["runs"][0])
    assert content["units"]["peak_tension"] == "N"
    assert content["runs"][0]["steady_mse"] is None, "the run ends before the steady state"


def test_a_run_that_is_not_completed_shows_how_it_ended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = tmp_path / "sweep.parquet"
    words = ("controller.winch_1.kp=5e-4,1e9", "--case", "4", "--set", "controller.winch_2.kp=1e9")
    out = said(capsys, *words, "--out", data)
    assert "left track" in out or "diverged" in out
    table = pq.read_table(data)
    assert table.schema.field("mse").metadata[b"unit"] == b"m^2"
    assert table["controller.winch_1.kp"].to_pylist() == [5e-4, 1e9]
    assert None in table["mse"].to_pylist()


def test_own_metrics_can_be_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dw.register(LastBeyond)
    (tmp_path / "own.toml").write_text("[metrics.last-beyond]\nband = 1e-9\n[simulation]\nduration = 0.5\n")
    out = said(capsys, "metrics.last_beyond.band=1e-9,1", "--config", tmp_path / "own.toml", "--metric", "last_beyond")
    assert "last_beyond (s)" in out
    assert [line.split() for line in out.splitlines() if line.startswith(" 1 ")] == [["1", "0"]]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("k=1,2.5", [1, 2.5]),
        ("k=nftsm,adrc", ["nftsm", "adrc"]),
        ("k=true,false", [True, False]),
        ("k=[[20, 5], [10]]", [[20, 5], [10]]),
        ("k=0:4:2", [0, 2, 4]),
        ("k=1:0:-0.25", [1, 0.75, 0.5, 0.25, 0]),
        ("k=1e3:2e3:5e2", [1000, 1500, 2000]),
        ("k=1:100:3:log", [1, 10, 100]),
        ("k = 3", [3]),
    ],
)
def test_values_as_they_are_written(text: str, values: list[Any]) -> None:
    found = axes_from([text])["k"]
    assert found == values
    assert list(map(type, found)) == list(map(type, values)) or ":" in text


def test_whole_numbers_stay_whole() -> None:
    assert list(map(type, numbers_between("0:4:2", ""))) == [int] * 3
    assert list(map(type, numbers_between("0:4:2.0", ""))) == [float] * 3
    assert np.diff(np.log(numbers_between("0.1:7:9:log", ""))) == pytest.approx(np.log(70) / 8)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ([], "give one or two keys with values"),
        (["a=1", "b=1", "c=1"], "give one or two keys with values, e.g. controller.observer.l0=1:20:1, not 3"),
        (["a"], "'a': must be key=value,value or key=first:last:step"),
        (["a="], "'a=': must be key=value,value"),
        (["a=1", "a=2"], "a: is given twice"),
        (["a=1:2"], "a=1:2: must be first:last:step or first:last:count:log"),
        (["a=1:x:2"], "a=1:x:2: must be first:last:step"),
        (["a=1:2:0"], "the step must be finite, not 0, and lead from first to last"),
        (["a=1:2:-1"], "the step must be finite, not 0, and lead from first to last"),
        (["a=0:1e9:1"], "1000000001 points, must be <= 10000"),
        (["a=0:1:3:log"], "first and last must be > 0, and the count 2 to 10000"),
        (["a=1:2:1:log"], "first and last must be > 0, and the count 2 to 10000"),
        (["a=[1"], "a=[1: must be a list as in TOML"),
    ],
)
def test_wrong_values_are_one_line(texts: list[str], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        axes_from(texts)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
