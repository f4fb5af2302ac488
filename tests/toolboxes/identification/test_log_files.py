"""Logs as data loggers write them: marks, units, time stamps, encodings, gaps, structures, rates, unused columns."""

import gzip
import re
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from unicodedata import normalize

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array

from dualwinch.model.errors import ConfigurationError
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log, column_map, gap_note, log, read_log

ROWS = 40
T = np.arange(ROWS) * 1e-3
X = 0.25 * np.arange(ROWS)
BEGIN = datetime(2024, 5, 1, 12, tzinfo=UTC)


def written(path: Path, header: str, *lines: str, separator: str = ",", comma: bool = False, **how: str) -> Path:
    """A file of t, tau_1, tau_2, x and F1, with the lines below the header."""
    rows = [[f"{t:.3f}", "20.5", "-20.5", f"{x:.2f}", f"{1.5 + x}"] for t, x in zip(T, X, strict=True)]
    texts = [separator.join(cell.replace(".", ",") if comma else cell for cell in row) for row in rows]
    path.write_text("\n".join([header, *lines, *texts]) + "\n", **how)
    return path


def is_as_written(found: Log, force: float = 1.0) -> None:
    np.testing.assert_allclose(found.t - found.t[0], T, atol=1e-6)
    np.testing.assert_allclose(found.columns["x"], X)
    np.testing.assert_allclose(found.columns["F1"], force * (1.5 + X))
    np.testing.assert_allclose(found.columns["tau_2"], -20.5)


@pytest.mark.parametrize("separator", [";", "\t", "|", ","])
def test_separators_are_recognised(tmp_path: Path, separator: str) -> None:
    file = written(tmp_path / "rig.csv", separator.join(["t", "tau_1", "tau_2", "x", "F1"]), separator=separator)
    is_as_written(read_log(file))


@pytest.mark.parametrize("marks", ["", ";,", ";"])
def test_decimal_commas_are_recognised_or_given(tmp_path: Path, marks: str) -> None:
    file = written(tmp_path / "rig.csv", "t;tau_1;tau_2;x;F1", separator=";", comma=True)
    is_as_written(read_log(file, csv=marks))


def test_other_marks_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,F1")
    for marks in ("::", ",,", "semicolon"):
        with pytest.raises(ConfigurationError, match=f"--csv {marks}: must be a separator"):
            read_log(file, csv=marks)


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("t [s],tau_1 [N·m],tau_2 [Nm],x [m],F1 [kN]", None),
        ("t (s),tau_1 (Nm),tau_2,x (m),F1 (kN)", None),
        ("t,tau_1,tau_2,x,F1", "s,N m,N*m,m,kN"),
        ("t,tau_1,tau_2,x,F1", "[s],[],[Nm],[-],[kN]"),
        ("t/s,tau_1/Nm,tau_2/N.m,x/m,F1/kN", None),
        ("t in s,tau_1 in Nm,tau_2,x in m,F1 in kN", None),
        ("t_s,tau_1_Nm,tau_2_Nm,x_m,F1_kN", None),
        ("Time <s>,tau_1 Nm,tau_2 {Nm},x m,F1 kN", None),
        ("# time [s],tau_1,tau_2,x,F1 kN", None),
    ],
)
def test_units_of_headers_and_of_a_row_of_units(tmp_path: Path, header: str, line: str | None) -> None:
    file = written(tmp_path / "rig.csv", header, *([line] if line else []), encoding="utf-8")
    is_as_written(read_log(file), 1e3)


@pytest.mark.parametrize(
    ("unit", "reading", "by"),
    [
        ("kNm", "tau_1", 1e3), ("kN·m", "tau_1", 1e3), ("daN", "F1", 10.0), ("-kN", "F1", -1e3), ("km/h", "v", 1 / 3.6),
        ("1/min", "omega_1", np.pi / 30), ("min⁻¹", "omega_1", np.pi / 30), ("°", "theta_1", np.pi / 180),
        ("°/s", "omega_1", np.pi / 180), ("ms", "t", 1e-3), ("µs", "t", 1e-6),
    ],
)  # fmt: skip
def test_units_that_a_rig_writes(tmp_path: Path, unit: str, reading: str, by: float) -> None:
    names = ["t", "tau_1", "tau_2", "x", "F1"]
    names = [f"{reading} [{unit}]" if name == reading else name for name in names]
    names[4] = f"{reading} [{unit}]" if reading not in {"t", "tau_1"} else names[4]
    plain = read_log(written(tmp_path / "plain.csv", ",".join(name.partition(" ")[0] for name in names)))
    found = read_log(written(tmp_path / "rig.csv", ",".join(names), encoding="utf-8"))
    both = [(each.t if reading == "t" else each.columns[reading]) for each in (found, plain)]
    np.testing.assert_allclose(both[0], by * both[1], rtol=1e-12)


def test_a_unit_of_another_quantity_names_its_column(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"column 'F1 \[bar\]': unit \"bar\": must be one of N, mN, kN"):
        read_log(written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,F1 [bar]"))


@pytest.mark.parametrize(
    "stamp",
    [
        lambda at: at.isoformat(),
        lambda at: at.isoformat(sep=" ").replace("+00:00", "Z"),
        lambda at: at.replace(tzinfo=None).isoformat().replace(".", ","),
        lambda at: at.astimezone(UTC).strftime("%H:%M:%S.%f"),
        lambda at: (at + timedelta(hours=11, minutes=59, seconds=59.98)).strftime("%H:%M:%S.%f"),
        lambda at: at.strftime("%d.%m.%Y %H:%M:%S,%f"),
        lambda at: at.strftime("%m/%d/%Y %H:%M:%S.%f"),
        lambda at: at.strftime("%Y/%m/%d %H:%M:%S.%f"),
        lambda at: f"{at.timestamp():.6f}",
        lambda at: f"{1e3 * at.timestamp():.3f}",
        lambda at: f"{1e6 * at.timestamp():.0f}",
    ],
)
def test_time_stamps_and_times_since_1970(tmp_path: Path, stamp: Callable[[datetime], str]) -> None:
    times = [stamp(BEGIN + timedelta(seconds=t)) for t in T]
    lines = [f"{at};20;-20;{x}" for at, x in zip(times, X, strict=True)]
    (tmp_path / "rig.csv").write_text("\n".join(["t;tau_1;tau_2;x", *lines]))
    found = read_log(tmp_path / "rig.csv")
    np.testing.assert_allclose(found.t - found.t[0], T, atol=1e-6)
    np.testing.assert_allclose(found.from_zero().t, T, atol=1e-6)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings_names_with_spaces_and_colons_and_lines_before_the_header(tmp_path: Path, encoding: str) -> None:
    file = written(
        tmp_path / "rig.csv", "Prüfstand 3\n\nt;Motor: 1;Motor 2;x;Seil: Kraft [kN]", separator=";", encoding=encoding
    )
    names = ["tau_1=Motor: 1", "tau_2=Motor 2:Nm", "F1 = Seil: Kraft"]
    is_as_written(read_log(file, column_map(names)), 1e3)
    is_as_written(read_log(file, column_map([*names[:2], "F1=Seil: Kraft [kN]:N"])), 1.0)


def test_japanese_names_in_shift_jis_and_dashes_of_windows(tmp_path: Path) -> None:
    file = written(
        tmp_path / "rig.csv", "試験装置\n\n時刻;モータ1;モータ2;x;張力 [kN]", separator=";", encoding="cp932"
    )
    is_as_written(read_log(file, column_map(["t=時刻:s", "tau_1=モータ1:Nm", "tau_2=モータ2:Nm", "F1=張力"])), 1e3)
    file = written(tmp_path / "rig.csv", "Prüfstand – 3\n\nt;tau_1;tau_2;x;Kraft", separator=";", encoding="cp1252")
    is_as_written(read_log(file, column_map(["F1=Kraft:N"])))


def test_a_packed_file_and_one_of_excel(tmp_path: Path) -> None:
    text = written(tmp_path / "rig.csv", "sep=;\nt;tau_1;tau_2;x;F1", separator=";").read_bytes()
    is_as_written(read_log(tmp_path / "rig.csv"))
    (tmp_path / "rig.csv.gz").write_bytes(gzip.compress(text))
    is_as_written(read_log(tmp_path / "rig.csv.gz"))


@pytest.mark.parametrize("word", ["#N/A", "n/a", "None", "--", "NaN", "null", " "])
def test_usual_words_are_gaps(tmp_path: Path, word: str) -> None:
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,F1", f"-0.001,20.5,-20.5,{word},1")
    found = read_log(file)
    assert np.isnan(found.columns["x"][0])
    assert np.isfinite(found.columns["x"][1:]).all()
    assert found.notes == ()


def test_another_word_is_a_gap_with_a_note_and_a_column_of_words_is_refused(tmp_path: Path) -> None:
    file = written(
        tmp_path / "rig.csv", "t,tau_1,tau_2,x [m],F1", "-0.002,20.5,-20.5,1,ERR", "-0.001,20.5,-20.5,ERR,ERR"
    )
    found = read_log(file)
    assert found.readings == ("x", "F1")
    note = "rig.csv: line 3: x [m] = 'ERR': is neither a number nor a usual word for a gap, taken for a gap"
    assert found.notes == (note, note.replace("3: x [m]", "2: F1") + ", and so is 1 other")
    words = "\n".join(["t,tau_1,tau_2,x", *(f"{t},20,20,bad" for t in T)])
    (tmp_path / "words.csv").write_text(words)
    with pytest.raises(ConfigurationError, match=r"words.csv: line 2: x = 'bad': must be a number or a gap"):
        read_log(tmp_path / "words.csv")


def table(header: str, *rows: str, first: int = 0, count: int = 300) -> str:
    """Text of a file of t, tau_1, tau_2, x and F1, with more cells below more names, and other decimal marks."""
    marks, lines = header.partition("|")[2], [header.partition("|")[0], *rows]
    for row in range(first, first + count):
        cells = [f"{row / 100:.2f}", f"{20 + row / 8}", f"{-20 - row / 8}", f"{row / 4}", f"{1000.5 + row}"]
        lines.append(";".join(c.replace(".", m) for c, m in zip(cells, marks or ".....", strict=True)))
    return "\n".join(lines) + "\n"


WHOLE = table("t;tau_1;tau_2;x;F1")
COMMAS = table("t;tau_1;tau_2;x;F1|,,,,,")


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(table("t;tau_1;tau_2;x;F1|,...."), id="a decimal comma in one column"),
        pytest.param(COMMAS.replace("\n", ";1.2\n").replace("1.2", "firmware", 1), id="a version with a point"),
        pytest.param(COMMAS.replace(";", "  "), id="spaces and decimal commas"),
        pytest.param(WHOLE.replace("\n", ";\n", 1), id="a separator behind the header alone"),
        pytest.param(WHOLE.replace("\n", "\ns;Nm;N m;m\n", 1), id="a row of units that lacks the last cell"),
        pytest.param(WHOLE.replace("\n", "\ns;Nm;N m;m;N;\n", 1), id="a separator behind the units alone"),
        pytest.param(WHOLE.replace("\n", "\ntime;torque;torque;way;\ns;Nm;Nm;m;1\n", 1), id="a row of words before"),
        pytest.param(
            WHOLE.replace("\n", ';"two\nlines"\n').replace('"two\nlines"', "note", 1), id="cells of two lines"
        ),
    ],
)
def test_tables_in_other_forms_have_the_same_numbers(tmp_path: Path, text: str) -> None:
    (tmp_path / "rig.csv").write_text(text)
    found, row = read_log(tmp_path / "rig.csv"), np.arange(300)
    np.testing.assert_allclose(found.t, row / 100)
    np.testing.assert_allclose(found.columns["tau_1"], 20 + row / 8)
    np.testing.assert_allclose(found.columns["F1"], 1000.5 + row)


@pytest.mark.parametrize(("marks", "read"), [("", True), (";,", True), (";.", False)])
def test_a_stated_decimal_mark_decides_where_marks_may_be_between_thousands(
    tmp_path: Path, marks: str, read: bool
) -> None:
    rows = [f"{row};{20 + row};-20;{row};1,{row + 100}" for row in range(300)]
    (tmp_path / "rig.csv").write_text("\n".join(["t;tau_1;tau_2;x;F1", *rows]))
    if read:
        assert read_log(tmp_path / "rig.csv", csv=marks).columns["F1"][5] == 1.105
    else:
        with pytest.raises(ConfigurationError, match=r"F1 = '1,100': must be a number or a gap; its marks"):
            read_log(tmp_path / "rig.csv", csv=marks)


def test_a_row_of_units_counts_beside_a_column_without_one(tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text(WHOLE.replace("\n", "\ns;daN m;daN m;mm;1\n", 1))
    found = read_log(tmp_path / "rig.csv")
    assert (found.columns["tau_1"][0], found.columns["x"][4], len(found.notes)) == (200, 1e-3, 0)


def test_whole_numbers_then_decimal_commas(tmp_path: Path) -> None:
    rest = "\n".join(f"{row / 100:.2f};0;0;0;0".replace(".", ",") for row in range(-400, 0))
    (tmp_path / "rig.csv").write_text(COMMAS.replace("\n", f"\n{rest}\n", 1))
    found = read_log(tmp_path / "rig.csv")
    assert (len(found.t), found.columns["x"][-1]) == (700, 299 / 4)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (WHOLE.replace(";2.5;", ';2.5;"', 1), r'rig.csv: line 12: has a quote \("\) that is not closed on this line'),
        (WHOLE.replace("2.5;", "9" * 140_000 + ";", 1), r"rig.csv: .*field larger than field limit"),
        ("", r"rig.csv: is empty"),
    ],
)
def test_what_is_no_table_is_refused_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "rig.csv").write_text(text)
    with pytest.raises(ConfigurationError, match=words):
        read_log(tmp_path / "rig.csv")


@pytest.mark.parametrize(
    "begin", [datetime(2024, 12, 11, 23, 59, 59, tzinfo=UTC), datetime(2024, 1, 12, 23, 59, 59, tzinfo=UTC)]
)
def test_days_before_months_are_recognised_by_the_whole_column(tmp_path: Path, begin: datetime) -> None:
    times = [(begin + timedelta(seconds=row / 100)).strftime("%d/%m/%Y %H:%M:%S.%f") for row in range(300)]
    lines = [f"{at};{row};{-row};{row / 4}" for row, at in enumerate(times)]
    (tmp_path / "rig.csv").write_text("\n".join(["t;tau_1;tau_2;x", *lines]))
    np.testing.assert_allclose(read_log(tmp_path / "rig.csv").from_zero().t, np.arange(300) / 100, atol=1e-6)


def test_rows_of_other_lengths_are_refused_but_for_an_unfinished_last_one(tmp_path: Path) -> None:
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,F1")
    whole = file.read_text()
    for last in ("0.05,20.5", '0.05,20.5,"', '0.05,20.5,",3,4\n', '"0.05,20.5,1,3,4\r\n'):
        file.write_text(whole + last)
        found = read_log(file)
        is_as_written(found)
        assert found.notes == ("rig.csv: line 42: is incomplete, left out",)
    file.write_text(whole + "0.05,20.5\n")
    with pytest.raises(ConfigurationError, match=r"rig.csv: line 42: has 2 cells: must have 5"):
        read_log(file)


def test_words_and_zeros_below_the_rows_and_columns_between_spaces(tmp_path: Path) -> None:
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,F1")
    whole = file.read_text()
    file.write_text(whole.replace("-20.5", "\u221220.5") + "End of log: 0 errors\n" + 512 * "\0")
    is_as_written(read_log(file))
    file.write_text("\n".join(line.replace(",", "   ").rjust(60) for line in whole.splitlines()))
    is_as_written(read_log(file))


def test_what_was_not_used_is_listed_with_the_option_that_uses_it(tmp_path: Path) -> None:
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,Kraft links [kN]")
    assert read_log(file).notes == ("rig.csv: not used: Kraft links [kN] (--column 'F1=Kraft links [kN]')",)
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,temperature")
    assert read_log(file).notes == ("rig.csv: not used: temperature; --column READING=NAME uses one",)


def test_two_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x [m],x [mm]")
    with pytest.raises(ConfigurationError, match=r"more than one column 'x'; name one.*: x \[m\], x \[mm\]"):
        read_log(file)
    assert read_log(file, column_map(["x=x [m]"])).columns["x"][1] == X[1]


SLOW = {"t": T[::4], "F1": 1.5 + X[::4]}


def test_matlab_structures_with_rates_of_their_own(tmp_path: Path) -> None:
    rig = {"t": T, "tau_1": np.full(ROWS, 20.5), "tau_2": np.full(ROWS, -20.5), "x": X}
    savemat(tmp_path / "rig.mat", {"rig": rig | {"F1": {"time": SLOW["t"], "data": SLOW["F1"]}}})
    found = read_log(tmp_path / "rig.mat")
    np.testing.assert_allclose(found.columns["x"], X)
    np.testing.assert_allclose(found.columns["F1"][::4], SLOW["F1"])
    assert np.isnan(found.columns["F1"][1:4]).all()
    assert found.notes == ()


def test_columns_of_other_lengths_have_times_of_their_own(tmp_path: Path) -> None:
    slow = SLOW["t"] + 5e-4
    np.savez(tmp_path / "rig.npz", t=T, tau_1=T + 1, tau_2=T - 1, x=X, left=SLOW["F1"], slow=slow)
    with pytest.raises(ConfigurationError, match=r"F1 has 10 values and its times 40: .*--column 'F1=left@TIMES'"):
        read_log(tmp_path / "rig.npz", column_map(["F1=left"]))
    found = read_log(tmp_path / "rig.npz", column_map(["F1=left:kN@slow"]))
    assert len(found.t) == ROWS + 10
    rows = np.isfinite(found.columns["F1"])
    np.testing.assert_allclose(found.t[rows], slow)
    np.testing.assert_allclose(found.columns["F1"][rows], 1e3 * SLOW["F1"])


def test_matlab_structures_of_simulink_without_a_time_of_all(tmp_path: Path) -> None:
    values = {"tau_1": 20.5 + 0 * T, "tau_2": -20.5 + 0 * T, "x": X, "F1": 1.5 + X}
    savemat(tmp_path / "rig.mat", {name: {"time": T, "signals": {"values": each}} for name, each in values.items()})
    is_as_written(read_log(tmp_path / "rig.mat"))
    (tmp_path / "rig.mat").write_text("no such file")
    with pytest.raises(ConfigurationError, match=r"not a \.mat file"):
        read_log(tmp_path / "rig.mat")


def test_what_is_no_column_of_numbers_is_listed(tmp_path: Path) -> None:
    cells, wave = np.empty(2, object), np.exp(1j * T)
    cells[:] = [T, X]
    rig = {"t": T, "tau_1": T + 1, "tau_2": T - 1, "x": X, "cells": cells, "wave": wave, "on": T > 1, "name": "rig"}
    savemat(tmp_path / "rig.mat", rig | {"inner": {"blocks": np.zeros((2, 3, 4))}})
    found = read_log(tmp_path / "rig.mat")
    (note,) = found.notes
    for words in ("cells (cells)", "wave (complex)", "inner.blocks (of 3 dimensions)"):
        assert words in note
    with pytest.raises(ConfigurationError, match=r"rig.mat: column 'wave': is complex: must be real numbers"):
        read_log(tmp_path / "rig.mat", column_map(["F1=wave"]))
    np.savez(tmp_path / "rig.npz", t=T, tau_1=T + 1, tau_2=T - 1, x=wave)
    with pytest.raises(ConfigurationError, match=r"rig.npz: column 'x': is complex"):
        read_log(tmp_path / "rig.npz")


def test_matlab_7_3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "rig.mat"
    file.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124, b" ") + b"\x00\x02IM" + bytes(384))
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "h5py", None)
        with pytest.raises(ConfigurationError, match=r"version 7.3: pip install 'dualwinch\[matlab\]', or uv run"):
            read_log(file)
    h5py: Any = pytest.importorskip("h5py")
    with h5py.File(file, "w", userblock_size=512) as content:
        for name, values in {"t": T, "tau_1": T + 1, "tau_2": T - 1, "x": X}.items():
            content[f"rig/{name}"] = values[np.newaxis]
    with file.open("r+b") as block:
        block.write(b"MATLAB 7.3 MAT-file".ljust(124, b" ") + b"\x00\x02IM")
    np.testing.assert_allclose(read_log(file).columns["x"], X)


def test_gaps_split_a_log() -> None:
    t = np.arange(1000) * 1e-3
    columns = {"t": t, "tau_1": 20 + t, "tau_2": 20 - t, "x": t}
    whole = log(columns)
    assert whole.between_gaps(0.1, 200) == [whole]
    columns["tau_1"] = np.where((t > 0.3) & (t < 0.55), np.nan, columns["tau_1"])
    jump = {name: np.delete(values, slice(760, 780)) for name, values in columns.items()}
    jump["t"][760:] += 0.2
    parts = log(jump, "rig").between_gaps(0.1, 200)
    assert [part.name for part in parts] == ["rig, 0 to 0.3 s", "rig, 0.55 to 0.759 s", "rig, 0.98 to 1.199 s"]
    assert len(log(jump).between_gaps(0.1, 215)) == 2
    columns["tau_2"] = np.where(t < 0.2, np.nan, columns["tau_2"])
    assert [part.t[0] for part in log(columns).between_gaps(0.1, 90)] == pytest.approx([0.2, 0.55])
    assert gap_note(parts).startswith("rig: no torques from 0.3 to 0.55 s, 0.759 to 0.98 s; fitted as 3 logs")


def rates(path: Path, **columns: np.ndarray) -> Path:
    """A CSV file of columns of other lengths, padded by empty cells."""
    rows = max(map(len, columns.values()))
    cells = [[str(float(value)) for value in each] + [""] * (rows - len(each)) for each in columns.values()]
    path.write_text("\n".join([",".join(columns), *map(",".join, zip(*cells, strict=True))]) + "\n")
    return path


FAST: dict[str, Any] = {"t": T, "tau_1": 20 + T, "tau_2": T - 20, "x": X}
LEFT: dict[str, Any] = {"left": SLOW["F1"], "left_time": SLOW["t"]}


@pytest.mark.parametrize("name", ["t_F1", "F1_t", "F1_time", "time_F1", "t_F1 [ms]", "time_F1 (us)"])
def test_own_times_are_found_by_their_names(tmp_path: Path, name: str) -> None:
    by = {"ms": 1e3, "us": 1e6}.get(name[-3:-1], 1.0)
    found = read_log(rates(tmp_path / "rig.csv", **FAST, F1=SLOW["F1"], **{name: by * SLOW["t"]}))
    np.testing.assert_array_equal(found.t, T)
    np.testing.assert_array_equal(found.columns["F1"][::4], SLOW["F1"])
    assert found.notes == ()


@pytest.mark.parametrize(
    ("column", "by"),
    [("left@left_time:ms", (1, 1e3)), ("left:kN@left_time", (1e-3, 1)), ("left:kN@left_time:us", (1e-3, 1e6))],
)
def test_own_times_may_have_a_unit(tmp_path: Path, column: str, by: tuple[float, float]) -> None:
    left = {name: factor * each for factor, (name, each) in zip(by, LEFT.items(), strict=True)}
    found = read_log(rates(tmp_path / "rig.csv", **FAST, **left), column_map(f"F1={column}"))
    np.testing.assert_allclose(found.columns["F1"][::4], SLOW["F1"])


TWICE = np.concatenate([T[:20], T[:20]])


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"t": TWICE}, r"line 22: t = '0.0': must be later than line 21: t = '0.019'; goes back by 0.019 s"),
        (
            {"left_time": SLOW["t"][::-1]},
            r"line 3: left_time = '0.032': must be later than line 2: left_time = '0.036",
        ),
        ({"left_time": 0 * SLOW["t"]}, r"line 3: left_time = '0.0': .*; 9 of 10 times repeat the one before"),
        (
            {"left_time": SLOW["t"] + 1.7e9},
            r"F1: has times 1700000000 to .* s in left_time, tau_1 0 to 0.039 s: must be of",
        ),
        ({"left_time": 1e3 * SLOW["t"]}, r"F1: has times 0 to 36 s in left_time.*--column 'F1=left@left_time:UNIT'"),
        (
            {"left_time": SLOW["t"] / 60},
            r"F1: has times 0 to 0.0006 s in left_time, tau_1 0 to 0.039 s: must be of one",
        ),
        ({"left_time": SLOW["t"][:3]}, r"F1 has 10 values, 3 with a time in left_time"),
    ],
)
def test_own_times_ascend_and_are_within_those_of_the_log(tmp_path: Path, changed: dict[str, Any], words: str) -> None:
    file = rates(tmp_path / "rig.csv", **FAST | LEFT | changed)
    with pytest.raises(ConfigurationError, match=words):
        read_log(file, column_map(["F1=left@left_time"]))


def test_a_column_of_a_lower_rate_needs_times(tmp_path: Path) -> None:
    file = rates(tmp_path / "rig.csv", **FAST, F1=SLOW["F1"])
    with pytest.raises(ConfigurationError, match=r"F1 has values in the first 10 of 40 rows alone: .*'F1=F1@TIMES'"):
        read_log(file)
    assert np.isfinite(read_log(file, column_map("F1=F1@t")).columns["F1"]).sum() == 10


@pytest.mark.parametrize(
    ("values", "content"),
    [(np.zeros(0), "empty"), (np.array(3.0), "a single number"), (np.array("word"), "text"), (T > 1, "true or false"),
     (np.array([{}]), "cells")],
)  # fmt: skip
def test_a_sensor_without_numbers_is_refused_or_left_out(tmp_path: Path, values: Any, content: str) -> None:
    np.savez(tmp_path / "rig.npz", **FAST, F1=values)
    with pytest.raises(ConfigurationError, match=rf"column 'F1': is {content}: must be .*left out \(--column F1=-\)"):
        read_log(tmp_path / "rig.npz")
    assert read_log(tmp_path / "rig.npz", column_map("F1=-")).readings == ("x",)


@pytest.mark.parametrize("form", [lambda each: each[:, None], lambda each: each[None, :], lambda each: each])
def test_numpy_arrays_of_one_row_or_column_with_units(tmp_path: Path, form: Callable[[Any], Any]) -> None:
    stamps = np.datetime64("2024-05-01T12:00", "us") + (1e6 * T).astype("timedelta64[us]")
    arrays = {name: form(each) for name, each in (FAST | {"t": stamps}).items()}
    np.savez(tmp_path / "rig.npz", **arrays, **{"F1 [kN]": form(X)}, units='{"x": "mm", "tau_1": null}')
    found = read_log(tmp_path / "rig.npz")
    np.testing.assert_allclose(found.from_zero().t, T, atol=1e-6)
    np.testing.assert_allclose(found.columns["x"], 1e-3 * X)
    np.testing.assert_allclose(found.columns["F1"], 1e3 * X)
    np.savez(tmp_path / "rig.npz", log=np.rec.fromarrays(list(FAST.values()), dtype=[(name, float) for name in FAST]))
    np.testing.assert_array_equal(read_log(tmp_path / "rig.npz").columns["x"], X)


@pytest.mark.parametrize("units", ["kN", '["kN"]', ["s", "N"]])
def test_numpy_units_are_a_json_object(tmp_path: Path, units: Any) -> None:
    np.savez(tmp_path / "rig.npz", **FAST, units=units)
    with pytest.raises(ConfigurationError, match=r"rig.npz: units: must be a JSON object of columns and units"):
        read_log(tmp_path / "rig.npz")
    (tmp_path / "rig.npz").write_text("no archive")
    with pytest.raises(ConfigurationError, match=r"rig.npz: not a .npz file$"):
        read_log(tmp_path / "rig.npz")


def test_parquet_has_units_in_its_names_and_infinite_numbers_are_gaps(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    columns = {"t [ms]": 1e3 * T, "tau_1": T, "tau_2": T, "x": np.where(T == 0, np.inf, X), "F1/kN": X}
    parquet.write_table(pa.table(columns), tmp_path / "rig.parquet")
    found = read_log(tmp_path / "rig.parquet")
    np.testing.assert_allclose((found.t, found.columns["F1"]), (T, 1e3 * X))
    assert found.notes == ("rig.parquet: row 1: x = infinite: taken for a gap",)


@pytest.mark.parametrize("suffix", ["npz", "parquet"])
def test_times_may_be_durations(tmp_path: Path, suffix: str) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    file, columns = tmp_path / f"rig.{suffix}", FAST | {"t": np.round(1e6 * T).astype("timedelta64[us]")}
    if suffix == "npz":
        np.savez(file, allow_pickle=False, **columns)
    else:
        parquet.write_table(pa.table(columns), file)
    np.testing.assert_allclose(read_log(file).t, T, rtol=0, atol=1e-9)


def test_units_without_names_and_single_numbers_beside_columns_are_no_readings(tmp_path: Path) -> None:
    savemat(tmp_path / "rig.mat", {"x": 5.0, "rig": FAST | {"units": ["s", "Nm", "Nm", "mm"]}})
    found = read_log(tmp_path / "rig.mat")
    np.testing.assert_array_equal(found.columns["x"], X)
    assert "not used: rig.units (must be a text, or a structure of texts" in found.notes[0]


def test_units_of_matlab_structures(tmp_path: Path) -> None:
    left = {"time": T, "data": X, "units": "kN"}
    savemat(tmp_path / "rig.mat", {"rig": FAST | {"units": {"x": "mm"}, "F1": left, "F2": csc_array(X[None])}})
    found = read_log(tmp_path / "rig.mat")
    for name, by in {"x": 1e-3, "F1": 1e3, "F2": 1}.items():
        np.testing.assert_allclose(found.columns[name], by * X)


def test_links_and_units_of_matlab_7_3(tmp_path: Path) -> None:
    h5py: Any = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "rig.mat", "w", userblock_size=512) as content:
        for name, values in FAST.items():
            content[f"rig/{name}"] = values[np.newaxis]
        content["rig/units/x"] = np.frombuffer(b"mm", "u1")[:, np.newaxis]
        content["rig/units/x"].attrs["MATLAB_class"] = np.bytes_("char")
        content["itself"], content["nothing"] = h5py.SoftLink("/"), h5py.SoftLink("/nowhere")
    with (tmp_path / "rig.mat").open("r+b") as block:
        block.write(b"MATLAB 7.3 MAT-file".ljust(124, b" ") + b"\x00\x02IM")
    np.testing.assert_allclose(read_log(tmp_path / "rig.mat").columns["x"], 1e-3 * X)


def test_two_units_of_a_column_are_refused_and_another_is_noted(tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text(WHOLE.replace("F1\n", "F1 [kN]\ns;Nm;Nm;m;N\n", 1))
    with pytest.raises(
        ConfigurationError, match=r"column 'F1 \[kN\]': is in kN by its header, in N by the row of units"
    ):
        read_log(tmp_path / "rig.csv")
    found = read_log(tmp_path / "rig.csv", column_map("F1=F1:N"))
    assert found.notes == ("rig.csv: F1 [kN]: is read in N, as --column says, not in kN",)
    assert found.columns["F1"][0] == 1000.5


def test_a_reading_without_numbers_is_noted_and_one_of_other_numbers_refused(tmp_path: Path) -> None:
    file = rates(tmp_path / "rig.csv", **FAST, F1=T[:0])
    assert read_log(file).notes == ("rig.csv: F1: has no number in any row, not used",)
    (tmp_path / "rig.csv").write_text(COMMAS.replace(",5\n", ".5,5\n"))
    with pytest.raises(
        ConfigurationError, match=r"line 2: F1 = '1000.5,5': must be a number or a gap; --csv SEPARATOR"
    ):
        read_log(tmp_path / "rig.csv")
    (tmp_path / "rig.csv").write_text(WHOLE.replace("0.00;", "12:00:00;").replace("0.01;", "12:00:01;", 1))
    for text, words in (
        ("t=x:kN", 'unit "kN": must be one of s, ms'),
        ("F1=t", "has time stamps: must be real numbers"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            read_log(tmp_path / "rig.csv", column_map(text))
    with pytest.raises(ConfigurationError, match=r"--column F1=b: F1 is a already: must be given once"):
        column_map(["F1=a", "F1=b"])


def test_a_name_that_ends_as_a_unit_of_another_quantity_is_no_reading(tmp_path: Path) -> None:
    """``x_d`` is a desired position, no position in days."""
    columns: dict[str, Any] = {name: each for name, each in FAST.items() if name != "x"} | {"x_d": X, "theta_1_deg": X}
    np.savez(tmp_path / "rig.npz", **columns)
    for file in (tmp_path / "rig.npz", rates(tmp_path / "rig.csv", **columns)):
        found = read_log(file)
        assert found.readings == ("theta_1",)
        np.testing.assert_allclose(found.columns["theta_1"], np.radians(X))


@pytest.mark.parametrize("unit", ["foo", "N", "kN", ""])
def test_the_unit_behind_the_times_is_theirs(tmp_path: Path, unit: str) -> None:
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,F1")
    with pytest.raises(ConfigurationError, match=rf"unit \"{unit}\" of the times 't': must be one of s, ms, .* before"):
        read_log(file, column_map([f"F1=F1:N@t:{unit}"]))


def test_accents_may_be_characters_of_their_own(tmp_path: Path) -> None:
    file = written(tmp_path / "rig.csv", "t,tau_1,tau_2,x,F1")
    text = file.read_text()
    composed, apart = normalize("NFC", "Kraft ä"), normalize("NFD", "Kraft ä")
    for name, other in ((composed, apart), (apart, composed)):
        file.write_text(text.replace("F1", name, 1), encoding="utf-8")
        is_as_written(read_log(file, column_map([f"F1={other}"])))


def rows(times: Sequence[str], separator: str = ",") -> str:
    """Rows of a file: a time, two torques of 1 and 2 N m, and positions of 0, 1, 2, ... m."""
    return "".join(separator.join([t, "1", "2", str(row)]) + "\n" for row, t in enumerate(times))


NAMES = "t,tau_1,tau_2,x\n"
SETTINGS = (
    "LabVIEW Measurement\t\nWriter_Version\t2\n***End_of_Header***\t\n\t\nChannels\t3\t\t\t\nSamples\t4\t4\t4\t\n"
    "Date\t2026/08/11\t2026/08/11\t2026/08/11\t\nX_Dimension\tTime\tTime\tTime\t\nX0\t0.0\t0.0\t0.0\t\n"
    "***End_of_Header***\t\t\t\t\nX_Value\ttau_1\ttau_2\tx\tComment\n"
)
STEPS = ["0.000", "0.001", "0.002", "0.003"]


@pytest.mark.parametrize(
    ("name", "content", "columns", "start", "step"),
    [
        ("minutes.csv", NAMES + rows(["59:59.000", "59:59.500", "00:00.000"]), {}, 3599.0, 0.5),
        ("clock.csv", NAMES + rows(["12:00", "12:01", "12:02"]), {}, 43200.0, 60.0),
        ("durations.csv", NAMES + rows([f"0 days 00:00:00.00{k}" for k in range(4)]), {}, 0.0, 1e-3),
        ("labview.lvm", SETTINGS + rows(STEPS, "\t").replace("\n", "\t\n"), {}, 0.0, 1e-3),
        ("numbers.csv", rows(STEPS), {"t": "1", "tau_1": "2", "tau_2": "3:N m", "x": "4"}, 0.0, 1e-3),
        ("asammdf.csv", NAMES.replace("t,", "timestamps,", 1) + rows(STEPS), {}, 0.0, 1e-3),
        ("pandas.csv", NAMES.replace("t,", "__index_level_0__,", 1) + rows(STEPS), {}, 0.0, 1e-3),
        ("step.csv", NAMES.replace("t,", "n,", 1) + rows(["5", "7", "8"]), {"t": "2ms"}, 0.0, 2e-3),
        ("rate.csv", NAMES.replace("t,", "n,", 1) + rows(["5", "7", "8"]), {"t": "500 Hz"}, 0.0, 2e-3),
        (
            "sum.csv",
            "sec,nanosec,tau_1,tau_2,x\n" + rows(["7,0", "7,500000", "7,1000000"]),
            {"t": "sec+nanosec"},
            7,
            5e-4,
        ),
    ],
)
def test_files_of_loggers(
    name: str, content: str, columns: dict[str, str], start: float, step: float, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(content)
    log = read_log(tmp_path / name, columns)
    np.testing.assert_allclose(log.t, start + step * np.arange(len(log.t)), rtol=0, atol=1e-9)
    assert log.columns["tau_2"].tolist() == [2.0] * len(log.t)
    assert log.columns["x"].tolist() == list(range(len(log.t)))


def test_headers_that_nobody_can_read_are_named_by_number(tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_bytes("時刻,左,右,位置\n".encode("shift_jis") + rows(STEPS).encode())
    log = read_log(tmp_path / "rig.csv", {"t": "1", "tau_1": "2", "tau_2": "3", "x": "4:mm"})
    assert log.columns["x"][3] == pytest.approx(3e-3)


@pytest.mark.parametrize(
    ("name", "content", "marks", "message"),
    [
        (
            "none.csv",
            rows(STEPS),
            "",
            "t: no such column; the file has no header, name columns by number, --column t=1",
        ),
        (
            "octave.mat",
            "# Created by Octave 8.4.0\n# name: t\n",
            "",
            "is of Octave's text format: save it with save -v7",
        ),
        ("nul.csv", NAMES + rows(STEPS) + "\0" * 512 + "\n", "", "line 6: has NUL bytes"),
        ("marks.csv", "t;tau_1;tau_2;x\n" + 5 * "0;1.001,5;2;3\n", ";,", "its marks are not those of --csv ;,"),
    ],
)
def test_what_a_logger_s_file_lacks_is_told(name: str, content: str, marks: str, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        read_log(tmp_path / name, csv=marks)


def test_columns_of_the_library_are_a_mapping_and_messages_name_them_so(tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text("time,tau_1,tau_2,pos\n" + rows(STEPS))
    with pytest.raises(ConfigurationError, match=r"name it with columns=\{'x': 'NAME'\}; it has"):
        identify(tmp_path / "rig.csv", "plant.vehicle.mass", columns={"t": "time"})
