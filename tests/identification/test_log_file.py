"""Logs in files: names, units, gaps, and what is wrong with them."""

from pathlib import Path

import numpy as np
import pytest

from dualwinch.identification.log_file import column_map, read_log
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.storage import save
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

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
    log = read_log(tmp_path / f"run.{suffix}")
    np.testing.assert_array_equal(log.columns["F1"], run["F1_read"])
    np.testing.assert_array_equal(log.columns["tau_2"], run["tau_2"])
    assert log.readings == ("x", "v", "F1", "F2", "theta_1", "theta_2", "omega_1", "omega_2")
    assert np.abs(log.columns["F1"] - run["F1"]).max() > 1, "noise"


@pytest.mark.parametrize("gap", ["", "nan", "NA", "-"])
def test_columns_of_other_names_and_units(tmp_path: Path, gap: str) -> None:
    file = csv(tmp_path / "rig.csv", "zeit,m1,m2,pos,left", gap=gap)
    log = read_log(file, column_map(["t=zeit:s", "tau_1=m1", "tau_2=m2:kN m", "x = pos:mm", "F1=left:kN"]))
    np.testing.assert_allclose(log.columns["tau_2"], 1e3 * (20 - np.arange(ROWS)))
    np.testing.assert_allclose(log.columns["x"], 1e-3 * np.arange(ROWS))
    assert np.isnan(log.columns["F1"][5])
    assert log.columns["F1"][6] == 6e3
    assert log.name == "rig.csv"


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["F1"], "must be READING=COLUMN"),
        (["force=left"], "unknown reading 'force'"),
        (["F1=left:bar"], 'unit "bar": must be one of N, mN, kN, MN'),
    ],
)
def test_wrong_maps_are_refused(texts: list[str], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        column_map(texts)


def test_wrong_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot read"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(ConfigurationError, match=r"unknown suffix '.xlsx'"):
        read_log(tmp_path / "log.xlsx")
    (tmp_path / "odd.parquet").write_text("no such thing")
    with pytest.raises(ConfigurationError, match=r"odd.parquet: not a .parquet file"):
        read_log(tmp_path / "odd.parquet")
    file = csv(tmp_path / "rig.csv", "zeit,tau_1,tau_2,x")
    with pytest.raises(ConfigurationError, match="t: no such column; name the one of times with --column t=NAME"):
        read_log(file)
    with pytest.raises(ConfigurationError, match="unknown column 'left'; it has zeit, tau_1, tau_2, x"):
        read_log(file, column_map(["t=zeit", "F1=left"]))


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
