"""Logs in files: names, units, gaps, and what is wrong with them."""

import re
from pathlib import Path

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.file_formats import save
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.identification.log import column_map, log, read_log

ROWS = 300


def csv(path: Path, header: str, *, gap: str = "") -> Path:
    """A file of times, torques and as many further columns as the header names."""
    width = header.count(",") - 2
    lines = [f"{0.001 * row},{20 + row},{20 - row}" + f",{row}" * width for row in range(ROWS)]
    lines[5] = lines[5].rsplit(",", 1)[0] + f",{gap}"
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mat", "npz"])
def test_runs_come_back_from_every_format_as_their_sensors_said(tmp_path: Path, suffix: str) -> None:
    noisy = {"simulation.duration": 0.5, "simulation.readings": True, "sensors.tension_noise": 5.0}
    run = simulate(override(case(4), noisy))
    save(run, tmp_path / f"run.{suffix}")
    found = read_log(tmp_path / f"run.{suffix}")
    np.testing.assert_array_equal(found.columns["F1"], run["F1_read"])
    np.testing.assert_array_equal(found.columns["tau_2"], run["tau_2"])
    assert found.readings == ("x", "v", "F1", "F2", "theta_1", "theta_2", "omega_1", "omega_2")
    assert np.abs(found.columns["F1"] - run["F1"]).max() > 1, "noise"


@pytest.mark.parametrize("gap", ["", "nan", "NA", "-"])
def test_columns_of_other_names_and_units(tmp_path: Path, gap: str) -> None:
    file = csv(tmp_path / "rig.csv", "zeit,m1,m2,pos,left", gap=gap)
    found = read_log(file, column_map(["t=zeit:s", "tau_1=m1", "tau_2=m2:kN m", "x = pos:mm", "F1=left:kN"]))
    np.testing.assert_allclose(found.columns["tau_2"], 1e3 * (20 - np.arange(ROWS)))
    np.testing.assert_allclose(found.columns["x"], 1e-3 * np.arange(ROWS))
    assert np.isnan(found.columns["F1"][5])
    assert found.columns["F1"][6] == 6e3
    assert found.name == "rig.csv"


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["F1"], "must be READING=COLUMN"),
        (["force=left"], "unknown reading 'force'"),
        (["tau1=left"], "unknown reading 'tau1'; did you mean 'tau_1'"),
    ],
)
def test_wrong_maps_are_refused(texts: list[str], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        column_map(texts)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tau_1=m1:kNM", "column 'm1': unit \"kNM\": must be one of .*; did you mean 'kN m'"),
        ("F1=left:bar", "column 'left': unit \"bar\": must be one of N, mN, kN, MN"),
    ],
)
def test_wrong_units_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        read_log(csv(tmp_path / "rig.csv", "t,m1,tau_2,left,x"), column_map(["tau_1=m1"]) | column_map([text]))


def test_wrong_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot read"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(ConfigurationError, match=r"unknown suffix '.xlsx'"):
        read_log(tmp_path / "log.xlsx")
    (tmp_path / "odd.parquet").write_text("no such thing")
    with pytest.raises(ConfigurationError, match=r"odd.parquet: not a Parquet file"):
        read_log(tmp_path / "odd.parquet")
    file = csv(tmp_path / "rig.csv", "zeit,tau_1,tau_2,x")
    with pytest.raises(ConfigurationError, match=r"t: no such column; did you mean 'zeit' \(--column t=zeit\)"):
        read_log(file)
    with pytest.raises(ConfigurationError, match="unknown column 'left'; it has zeit, tau_1, tau_2, x"):
        read_log(file, column_map(["t=zeit", "F1=left"]))


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (
            "t,tau1,tau2,x",
            r"tau_1: no such column; did you mean 'tau1' \(--column tau_1=tau1\)\? It has t, tau1, tau2",
        ),
        ("t,tau_1,Tau 2,x", r"tau_2: no such column; did you mean 'Tau 2' \(--column tau_2=Tau 2\)\?"),
        ("zeit,tau_1,tau_2,x", r"t: no such column; did you mean 'zeit' \(--column t=zeit\)\?"),
        ("t,m,n,x", r"tau_1: no such column; name it with --column tau_1=NAME; it has t, m, n, x"),
        ("t,tau_1,tau_2,theta1", r"must have a position or an encoder: x, theta_1 or theta_2; did you mean 'theta1'"),
        ("t,tau_1,tau_2,v,F1", r"must have a position or an encoder: .*; it has t, tau_1, tau_2, v, F1"),
    ],
)
def test_a_missing_column_names_the_nearest_and_what_the_file_has(tmp_path: Path, header: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        read_log(csv(tmp_path / "rig.csv", header))


def test_a_column_that_was_named_and_is_missing_names_the_nearest(tmp_path: Path) -> None:
    file = csv(tmp_path / "rig.csv", "t,tau_1,tau_2,x,left_cell")
    words = "unknown column 'left'; did you mean 'left_cell'? It has t, tau_1, tau_2, x, left_cell"
    with pytest.raises(ConfigurationError, match=re.escape(words)):
        read_log(file, column_map(["F1=left"]))


def test_arrays_of_a_wrong_name_name_the_nearest() -> None:
    t = np.arange(ROWS, dtype=float)
    with pytest.raises(ConfigurationError, match="unknown column 'tau1'; did you mean 'tau_1'"):
        log({"t": t, "tau1": t, "tau_2": t, "x": t})
    with pytest.raises(ConfigurationError, match="tau_1: no such column; it has tau_2, x"):
        log({"t": t, "tau_2": t, "x": t})
    with pytest.raises(ConfigurationError, match="unknown column 'time'; did you mean 't'"):
        log({"time": t, "tau_1": t, "tau_2": t, "x": t})
    with pytest.raises(ConfigurationError, match="must have a column t, times in s; it has tau_1, tau_2, x"):
        log({"tau_1": t, "tau_2": t, "x": t})


def test_a_column_may_be_left_out(tmp_path: Path) -> None:
    file = csv(tmp_path / "rig.csv", "t,tau_1,tau_2,x,F1")
    assert read_log(file).readings == ("x", "F1")
    assert read_log(file, column_map(["F1=-"])).readings == ("x",)


def test_a_unit_of_the_file_that_cannot_be_is_told_with_its_column(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    names = ("t", "tau_1", "tau_2", "x")
    fields = [pa.field(name, pa.float64(), metadata={"unit": "kg"} if name == "x" else None) for name in names]
    rows = [pa.array(np.arange(ROWS, dtype=float)) for _ in names]
    parquet.write_table(pa.table(rows, schema=pa.schema(fields)), tmp_path / "rig.parquet")
    with pytest.raises(ConfigurationError, match=r"rig.parquet: column 'x': unit \"kg\": must be one of m, "):
        read_log(tmp_path / "rig.parquet")
