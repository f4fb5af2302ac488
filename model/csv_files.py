"""CSV files as data loggers and spreadsheets write them: columns of numbers with their units.

Read are any of the usual separators, decimal points and commas, text in UTF-8, UTF-16 or Latin-1, lines before the
header, headers such as ``F1 [kN]``, a row of units, numbers and time stamps (ISO 8601), and gaps in their usual words.
"""

import csv
import gzip
import io
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.units import is_unit

Floats = NDArray[np.float64]

SEPARATORS = {"\t": "tab", ";": ";", "|": "|", ",": ","}
"""Separators of cells, the rarest in other places first, and their names."""

GAPS = frozenset((
    "", "nan", "+nan", "-nan", "na", "n/a", "#n/a", "#na", "<na>", "nat", "nil", "null", "none", "missing",
    "-", "--", "---", "?", ".",
))  # fmt: skip
"""Cells without a reading, in small letters."""

ALSO_WORDS = frozenset(["min"])
"""Units that end names that have none."""

DIMENSIONLESS = frozenset(["", "-", "1"])
"""In the place of a unit: there is none."""

DAY = 86400.0
"""In s."""

SAMPLE = 200
"""Lines by which separator, header and decimal mark are recognised."""


@dataclass(frozen=True, eq=False)
class TableColumn:
    """A column of a file.

    Attributes:
        header: as the file has it.
        name: without its unit.
        unit: where the file states one.
        values: (rows,) finite numbers; NaN where there is none. Time stamps in s since 1970, UTC.
        stamps: whether they are time stamps.
        cells: texts, one a row.
        words: rows with a cell that is neither a finite number nor a gap.
        lines: of the rows in the file.
        content: what it has in the place of real numbers, in words; it has no values then.
    """

    header: str
    name: str
    unit: str | None
    values: Floats
    stamps: bool = False
    cells: Sequence[str] = ()
    words: Sequence[int] = ()
    lines: Sequence[int] = ()
    content: str = ""


def read_csv(path: Path, marks: str = "") -> list[TableColumn]:
    """Read a CSV file, also one that gzip has packed.

    Args:
        path: of the file.
        marks: separator, or separator and decimal mark, such as ``;,`` or ``tab.``; default: as the file shows.

    Raises:
        ConfigurationError: not text, rows of different lengths, or other marks.
        OSError: the file cannot be read.
    """
    separator, decimal = csv_marks(marks)
    text = _decoded(path)
    begins = re.match(r"sep=(.)\r?\n", text)  # as Excel writes it
    separator = separator or (begins[1] if begins else _separator(text))
    if separator.isspace() and separator != "\t":
        text = re.sub(r"(?m)^[ \t]+|[ \t]+$", "", text)
        text, separator = re.sub(r"[ \t]+", "\t", text), "\t"
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        rows = [(reader.line_num, row) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise ConfigurationError(f"{path}: not valid CSV: {error}") from error
    rows = rows[begins is not None :]
    widths = Counter(len(row) for _, row in islice(rows, SAMPLE))
    usual = max(widths, key=lambda width: (widths[width], width), default=0)
    early = enumerate(islice(rows, SAMPLE))
    first = next((number for number, (_, row) in early if len(row) == usual and not _is_data(row)), 0)
    header = [cell.strip() for cell in rows[first][1]] if rows else []
    header[:1] = [each.lstrip("#% ") or each for each in header[:1]]
    rows = rows[first + 1 :]
    _cut_end(rows, len(header), ended=text.endswith(("\n", "\r")))
    units: list[str | None] = [None] * len(header)
    if rows and len(rows[0][1]) == len(header) and not _is_data(rows[0][1]):
        row_of_units = [cell.strip().strip("[]()").strip() for cell in rows[0][1]]
        if any(map(is_unit, row_of_units)):
            units = [None if each in DIMENSIONLESS else each for each in row_of_units]
            rows = rows[1:]
    for line, row in rows:
        if len(row) < len(header) or any(map(str.strip, row[len(header) :])):
            raise ConfigurationError(f"{path}: line {line}: has {len(row)} cells: must have {len(header)}")
    cells = list(zip(*(row[: len(header)] for _, row in rows), strict=True)) or [()] * len(header)
    lines = [line for line, _ in rows]
    comma = decimal == "," if decimal else _has_decimal_comma(row for _, row in islice(rows, SAMPLE))
    beside = csv_units(path)
    found = []
    for text_of_header, stated, texts in zip(header, units, cells, strict=True):
        name, own = split_header(text_of_header)
        values, words, stamps = _numbers(texts, comma=comma)
        unit = own or stated or beside.get(name)
        found.append(TableColumn(text_of_header, name, unit, values, stamps, texts, words, lines))
    return found


def _cut_end(rows: list[tuple[int, list[str]]], width: int, *, ended: bool) -> None:
    """Leave out words below the last row, and a last line amid which the logger stopped."""
    while rows and len(rows[-1][1]) < width and not _is_data(rows[-1][1]):
        rows.pop()
    if rows and len(rows[-1][1]) < width and not ended:
        rows.pop()


def csv_marks(text: str) -> tuple[str, str]:
    """Separator and decimal mark of a text such as ``;,`` or ``tab.``; empty where it does not say.

    Raises:
        ConfigurationError: another text.
    """
    named = {name: mark for mark, name in SEPARATORS.items()}
    parts = re.fullmatch(r"(tab|[\t;|,])?([.,]?)", text)
    if not parts or (parts[1] and named.get(parts[1], parts[1]) == parts[2]):
        raise ConfigurationError(f"--csv {text}: must be a separator (; , | or tab) and a decimal mark, e.g. ';,'")
    return named.get(parts[1], parts[1]) or "", parts[2]


def split_header(text: str) -> tuple[str, str | None]:
    """Name and unit of a header such as ``F1 [kN]``, or ``F1 (kN)``, ``F1/kN``, ``F1_kN`` where that is a unit."""
    if parts := re.fullmatch(r"(.*\S)\s*\[(.*)\]", text):
        unit = parts[2].strip()
        return parts[1], None if unit in DIMENSIONLESS else unit
    for form in (
        r"(.*\S)\s*[(<{](.*)[)>}]",
        r"(.*\S)\s+in\s+(\S+)",
        r"(.*\S)\s*/\s*(\S+)",
        r"(.*\S)(?:\s+|_)([^\s_]+)",
    ):
        parts = re.fullmatch(form, text)
        if parts and is_unit(parts[2].strip()) and parts[2] not in ALSO_WORDS:
            return parts[1], parts[2].strip()
    return text, None


def csv_units(path: Path) -> dict[str, str]:
    """Units of a CSV file, where `simulation.results.storage` has put its metadata beside it."""
    beside = path.with_name(path.name + "-metadata.json")
    if not beside.exists():
        return {}
    try:
        columns = json.loads(beside.read_text(encoding="utf-8"))["tableSchema"]["columns"]
        return {column["name"]: column["dualwinch:unit"] for column in columns if "dualwinch:unit" in column}
    except (ValueError, LookupError, TypeError):
        return {}  # metadata of another kind, which says nothing of units


def _decoded(path: Path) -> str:
    data = path.read_bytes()
    if path.suffix.lower() == ".gz":
        data = gzip.decompress(data)
    wide = data[:2] in {b"\xff\xfe", b"\xfe\xff"}
    codecs = ["utf-16"] if wide else ["utf-8-sig", "latin-1"]
    for first, codec in enumerate(("utf-16-be", "utf-16-le")):
        if data[first:20:2].count(0) > 8 and not wide:
            codecs = [codec]
    for codec in codecs:
        try:
            text = data.decode(codec).rstrip("\0").replace("\N{MINUS SIGN}", "-")
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise ConfigurationError(f"{path}: not UTF-8, UTF-16 or Latin-1 text")


def _separator(text: str) -> str:
    """The first separator that cuts most lines into one number of cells, two or more; spaces are the last."""
    lines = [line for line in islice(text.splitlines(), SAMPLE) if line.strip()]
    for separator in SEPARATORS:
        widths = Counter(map(len, csv.reader(lines, delimiter=separator)))
        width, count = widths.most_common(1)[0] if widths else (0, 0)
        if width > 1 and 2 * count > len(lines):
            return separator
    width, count = Counter(len(line.split()) for line in lines).most_common(1)[0] if lines else (0, 0)
    return " " if width > 1 and 2 * count > len(lines) else ","


def _is_data(row: Sequence[str]) -> bool:
    """Whether a row has a number or a time stamp."""
    return any(_number(cell, comma=True) is not None or _stamp(cell) is not None for cell in row)


def _has_decimal_comma(rows: Iterable[Sequence[str]]) -> bool:
    cells = [cell.strip() for row in rows for cell in row]
    comma = any(re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", cell) for cell in cells)
    return comma and not any(re.fullmatch(r"[+-]?\d*\.\d+([eE][+-]?\d+)?", cell) for cell in cells)


def _number(cell: str, *, comma: bool) -> float | None:
    try:
        value = float(cell.replace(",", ".") if comma else cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _stamp(cell: str) -> float | None:
    """Seconds since 1970 of a time stamp, or since midnight of a time of day."""
    cell = cell.strip()
    if parts := re.fullmatch(r"(\d{1,2})([./])(\d{1,2})[./](\d{4})[ T]+(.*)", cell):  # 31.12.2024, or 12/31/2024
        first, second = int(parts[1]), int(parts[3])
        month, day = (first, second) if parts[2] == "/" and first <= 12 else (second, first)
        cell = f"{parts[4]}-{month:02}-{day:02}T{parts[5]}"
    cell = re.sub(r"^(\d{4})/(\d\d)/", r"\1-\2-", cell)
    for text in (cell, f"1970-01-01T{cell}") if ":" in cell else ():
        try:
            found = datetime.fromisoformat(text)
        except ValueError:
            continue
        return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
    return None


def _numbers(cells: Sequence[str], *, comma: bool) -> tuple[Floats, list[int], bool]:
    """Numbers or time stamps of cells, rows of words, and whether they are time stamps."""
    try:
        values = np.array([cell.replace(",", ".") for cell in cells] if comma else cells, float)
        return np.where(np.isfinite(values), values, np.nan), np.flatnonzero(np.isinf(values)).tolist(), False
    except ValueError:
        pass
    values, words = np.full(len(cells), np.nan), list[int]()
    filled = [row for row, cell in enumerate(cells) if cell.strip().lower() not in GAPS]
    stamps = bool(filled) and _stamp(cells[filled[0]]) is not None
    for row in filled:
        value = _stamp(cells[row]) if stamps else _number(cells[row], comma=comma)
        if value is None:
            words.append(row)
        else:
            values[row] = value
    if stamps and np.nanmax(values) < DAY:  # times of day, which begin anew at midnight
        known = np.isfinite(values)
        values[known] += DAY * np.cumsum(np.diff(values[known], prepend=0.0) < -DAY / 2)
    return values, words, stamps
