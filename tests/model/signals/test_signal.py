"""Signals from files and arrays: values between and beyond the rows, units, and what is wrong with a file."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.signals import Signal

CSV = "t,F,other\n0,1,9\n2,3,9\n4,-1,9\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "gust.csv"
    path.write_text(CSV)
    return path


def at(signal: Signal, *t: float) -> list[float]:
    return signal.sampled(np.array(t, dtype=np.float64), "N").tolist()


def test_between_rows_lines_or_the_value_before(file: Path) -> None:
    linear = Signal.from_file(file, "F", unit="kN")
    assert at(linear, 0, 1, 2, 3, 4) == [1000, 2000, 3000, 1000, -1000]
    previous = replace(linear, interpolation="previous")
    assert at(previous, 0, 1.999, 2, 3, 4) == [1000, 1000, 3000, 3000, -1000]


def test_a_step_counts_at_its_own_sample_whatever_the_rounding() -> None:
    t = np.linspace(0, 0.999, 1000)
    for k in (7, 300, 643):
        signal = Signal.from_arrays([0.0, float(f"0.{k:03d}")], [0.0, 1.0], unit="N", interpolation="previous")
        assert np.flatnonzero(signal.sampled(t, "N"))[0] == k


def test_beyond_the_ends_held_or_zero(file: Path) -> None:
    held = Signal.from_file(file, "F", unit="N")
    assert at(held, -1, 0, 4, 5) == [1, 1, -1, -1]
    assert at(replace(held, beyond="zero"), -1, 0, 4, 5) == [0, 1, -1, 0]


def test_where_nothing_is_to_hold_beyond_the_run_must_be_covered(file: Path) -> None:
    signal = Signal.from_file(file, "F", unit="N", beyond="error")
    signal.check("N", 4.0)
    with pytest.raises(ConfigurationError, match=r"gust\.csv: is too short: holds 0 to 4 s, must hold 0 to 4\.001 s"):
        signal.check("N", 4.001)
    late = Signal.from_arrays([1, 2], [0, 0], unit="N", beyond="error")
    with pytest.raises(ConfigurationError, match="holds 1 to 2 s"):
        late.check("N", 2.0)


def test_arrays_are_a_file_of_the_same_numbers(file: Path) -> None:
    of_arrays = Signal.from_arrays(np.array([0, 2, 4]), np.array([1, 3, -1]), unit="kN")
    assert at(of_arrays, -1, 0.5, 3.3, 9) == at(Signal.from_file(file, "F", unit="kN"), -1, 0.5, 3.3, 9)
    assert at(replace(of_arrays, scale=-0.5), 0, 2) == [-500, -1500]


def test_parquet_brings_its_unit_and_contradiction_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "gust.parquet"
    fields = [pa.field("t", pa.float64(), metadata={"unit": "ms"}), pa.field("F", pa.int32(), metadata={"unit": "kN"})]
    parquet.write_table(pa.table([[0.0, 2000.0], pa.array([1, 3], pa.int32())], schema=pa.schema(fields)), path)
    signal = Signal.from_file(path)  # the only column beside the times
    assert at(signal, 0, 1, 2) == [1000, 2000, 3000]
    with pytest.raises(ConfigurationError, match=r"column 'F': unit \"N\": must be \"kN\", as the file says"):
        replace(signal, unit="N").check("N", 1.0)


def test_a_unit_in_the_header_is_the_files(file: Path) -> None:
    file.write_text("t [ms];push [kN]\n0;0,5\n2000;1,5\n", encoding="utf-16")
    signal = Signal.from_file(file, "push")
    signal.check("N", 1.0)
    assert at(signal, 0, 2) == [500, 1500]
    assert at(Signal.from_file(file, "push [kN]"), 2) == [1500]
    with pytest.raises(ConfigurationError, match=r"column 'push': unit \"N\": must be \"kN\", as the file says"):
        replace(signal, unit="N").check("N", 1.0)


def test_columns_of_one_name_are_chosen_by_their_headers(file: Path) -> None:
    file.write_text("t;push [kN];push [N]\n0;1;5\n1;2;6\n")
    assert at(Signal.from_file(file, "push [kN]"), 1) == [2000]
    with pytest.raises(ConfigurationError, match=r"more than one column 'push'; name one: push \[kN\], push \[N\]"):
        Signal.from_file(file, "push")
    file.write_text("t;push [kN]\ns;N\n0;1\n1;2\n")
    with pytest.raises(
        ConfigurationError, match=r"column 'push \[kN\]': is in kN by its header, in N by the row of units"
    ):
        Signal.from_file(file, "push")


WRONG = {
    "not a number": ("t,F\n0,1\n1,x\n", "line 3: F = x: must be a finite number"),
    "nan": ("t,F\n0,1\n1,nan\n2,3\n", "line 3: F = nan: must be a finite number"),
    "empty cell": ("t,F\n0,1\n\n1,\n", "line 4: F = nothing: must be a finite number"),
    "unsorted": ("t,F\n0,1\n2,1\n1,1\n", "line 4: t = 1: must be > 2, the time before it"),
    "the same time twice": ("t,F\n0,1\n0,2\n", "line 3: t = 0: must be > 0"),
    "one row": ("t,F\n0,1\n", "is too short: must have two rows"),
    "empty": ("", "is empty"),
    "a quote that is not closed": (
        't,F,note\n0,1,\n1,1,"a\n2,2,\n3,3,\n',
        'line 3: has a quote (") that is not closed',
    ),
    "digits between which NumPy skips": ("t,F\n0,1\n1,1_000\n", "line 3: F = 1_000: must be a finite number"),
    "ragged": ("t,F\n0,1\n1\n", "line 3: has 1 cells: must have 2"),
    "no such column": ("t,f\n0,1\n1,1\n", "unknown column 'F'; did you mean 'f'?"),
    "twice the column": ("t,F,F\n0,1,1\n1,1,1\n", "has more than one column 'F'"),
    "no times": ("tim,F\n0,1\n1,1\n", "unknown column 't'; did you mean 'tim'?"),
    "unsorted times of the other name": ("time [s],F\n0,1\n2,1\n1,1\n", "line 4: time = 1: must be > 2"),
}


@pytest.mark.parametrize("header", ["time [s]", "gust.time", "time"])
def test_the_column_of_the_times_may_be_named_time(header: str, tmp_path: Path) -> None:
    path = tmp_path / "gust.csv"
    path.write_text(f"{header},F\n0,1\n2,3\n")
    recording = Signal.from_file(path, "F", unit="N").recording
    assert recording is not None
    assert recording.t.tolist() == [0.0, 2.0]


@pytest.mark.parametrize(("text", "message"), WRONG.values(), ids=WRONG)
def test_a_bad_file_is_one_line_that_says_where(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        Signal.from_file(path, "F", unit="N")
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)


def test_bad_parquet_names_the_row(tmp_path: Path) -> None:
    path = tmp_path / "bad.parquet"
    parquet.write_table(pa.table({"t": [0.0, 1.0], "F": [1.0, None], "word": ["a", "b"]}), path)
    for column, message in (("F", "row 2: F = nan: must be a finite"), ("word", "column 'word' is of type string")):
        with pytest.raises(ConfigurationError, match=message):
            Signal.from_file(path, column, unit="N")
    path.write_bytes(b"no parquet at all")
    with pytest.raises(ConfigurationError, match=r"bad\.parquet: not a Parquet file"):
        Signal.from_file(path, "F", unit="N")


def test_a_file_is_read_once_and_known_by_its_numbers(file: Path) -> None:
    signal = Signal.from_file(file, "F", unit="N")
    file.write_text(CSV.replace("3", "7"))
    assert at(replace(signal, scale=2.0), 2) == [6]
    again = Signal.from_file(file, "F", unit="N")
    assert again != signal
    assert at(again, 2) == [7]
    with pytest.raises(ConfigurationError, match=rf"has changed: its numbers have the digest {again.digest}"):
        Signal(str(file), "F", "N", digest=signal.digest)
    file.write_text(CSV)
    assert Signal.from_file(file, "F", unit="N") == signal
    assert hash(Signal.from_file(file, "F", unit="N")) == hash(signal)


def test_another_file_is_read_and_has_its_own_digest(file: Path) -> None:
    signal, other = Signal.from_file(file, "F", unit="N"), file.with_name("other.csv")
    other.write_text(CSV.replace("3", "7"))
    changed = replace(signal, file=str(other))
    assert changed.digest != signal.digest
    assert at(changed, 2) == [7]
    assert at(replace(signal, column="other"), 2) == [9]


def test_it_travels_between_processes(file: Path) -> None:
    signal = Signal.from_file(file, "F", unit="N")
    file.unlink()
    assert at(pickle.loads(pickle.dumps(signal)), 1) == [2]  # noqa: S301


def test_dates_count_from_the_first_one() -> None:
    stamps = pd.date_range("2024-05-01 12:00", periods=3, freq="2s")
    plain = Signal.from_arrays([0.0, 2.0, 4.0], [1, 3, -1], unit="N")
    for times in (stamps, stamps.tz_localize("UTC"), stamps.to_numpy(), stamps.to_pydatetime(), stamps - stamps[0]):
        assert Signal.from_arrays(times, pd.Series([1, 3, -1], index=stamps), unit="N") == plain
    assert len(repr(Signal.from_arrays(np.arange(1000), np.arange(1000), unit="N"))) < 300


def of(t: Any, values: Any) -> Signal:
    """A force from arrays."""
    return Signal.from_arrays(t, values, unit="N")


HERE = datetime(2024, 1, 1, tzinfo=UTC)
CALLS: list[tuple[Callable[[Path], object], str]] = [
    (lambda file: Signal.from_file(file, "F").check("N", 1.0), "column 'F': has no unit; say which: unit = \"N\""),
    (Signal.from_file, "column: must be named; there is F, other"),
    (lambda file: Signal.from_file(file.with_suffix(".xls")), "unknown suffix '.xls'; must be .csv or .parquet"),
    (lambda file: Signal.from_file(file.with_name("none.csv")), "none.csv: No such file"),
    (lambda file: (file.write_bytes(b"\xff\xfe\x00"), Signal.from_file(file)), "not UTF-8"),
    (lambda file: Signal(str(file), "F", "N", times=(0.0, 1.0), values=(0.0, 0.0)), "must not be given beside a file"),
    (lambda _: of([0, 1], [1]), "values: has 1 numbers: must have 2"),
    (lambda _: of([0], [1]), "times: is too short"),
    (lambda _: of([], []), "times: is too short"),
    (lambda _: of([0, 2, 1], [0, 0, 0]), "times[2] = 1: must be > 2"),
    (lambda _: of([0, 1], [0, np.nan]), "values[1] = nan: must be a finite number"),
    (lambda _: of(None, None), "t: must be numbers, not NoneType"),
    (lambda _: of(["a", "b"], [1, 2]), "times: must be numbers"),
    (lambda _: of([HERE, HERE.replace(second=1, tzinfo=None)], [1, 2]), "times: must be all of one kind"),
    *(
        (lambda _, shift=shift: of([shift, shift + 4.0], [1, 3]).check("N", 50.0), "none of its times is in the run")
        for shift in (100.0, -100.0, 1.7e9)
    ),
]


@pytest.mark.parametrize(("call", "message"), CALLS)
def test_wrong_calls_are_one_line(call: Callable[[Path], object], message: str, file: Path) -> None:
    with pytest.raises(ConfigurationError) as caught:
        call(file)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
