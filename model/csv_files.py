"""CSV files as data loggers and spreadsheets write them: columns of numbers with their units.

The reader accepts the usual separators, decimal points or commas (one per column), UTF-8, UTF-16 and Latin-1, lines
before the header, headers such as ``F1 [kN]``, a row of units, numbers and time stamps (`STAMPS`), and the usual marks
of missing values.
"""

import csv
import gzip
import io
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.units import factor, is_same_unit, is_unit

Floats = NDArray[np.float64]

SEPARATORS = {"\t": "tab", ";": ";", "|": "|", ",": ","}
"""Separators of cells, the least ambiguous first, and their names."""

GAPS = frozenset((
    "", "nan", "+nan", "-nan", "na", "n/a", "#n/a", "#na", "<na>", "nat", "nil", "null", "none", "missing",
    "-", "--", "---", "?", ".",
))  # fmt: skip
"""Cells without a reading, in lower case."""

ALSO_WORDS = frozenset(["min"])
"""Units that may also be the last word of a name."""

DIMENSIONLESS = frozenset(["", "-", "1"])
"""Texts in place of a unit that mean a pure number."""

DAY, HOUR = 86400.0, 3600.0
"""A day and an hour in s."""

CLOCK = r"(?:(\d+) days?,? \+?)?(\d+):(\d\d):(\d\d(?:[.,]\d+)?)"
MINUTES = r"()()(\d+):(\d\d[.,]\d+)"
"""A time of day or a duration, also with days; and minutes with seconds, which have a fraction."""

SAMPLE = 200
"""Number of lines from which separator and header are recognised."""

STAMPS = (
    "2024-12-31T23:59:59.9 (ISO 8601), 31.12.2024 23:59:59.9, 12/31/2024 23:59:59.9, 23:59:59.9, 59:59.9 or "
    "1 days 23:59:59.9"
)
"""Accepted forms of time stamps."""

DECIMALS = {mark: rf"[+-]?\d*\{mark}\d+(?:[eE][+-]?\d+)?" for mark in ".,"}
"""Decimal mark → pattern of numbers with it."""

LINE = r"(?m)^[ \t]*{}[ \t]*$"
"""Pattern of a cell that is a number, in a text with one cell per line."""

GROUPED = {mark: rf"[+-]?[1-9]\d{{0,2}}(?:\{mark}\d\d\d)+" for mark in ".,"}
"""Mark → pattern of numbers in which it may also be a thousands separator."""


@dataclass(frozen=True, eq=False)
class TableColumn:
    """A column of a file.

    Attributes:
        header: header as in the file.
        name: header without its unit.
        unit: unit, where the file states one.
        cut: line of an incomplete last row, which is left out; 0: none.
        other_unit: unit in the row of units, where it contradicts the header.
        values: (rows,) finite numbers, NaN for missing ones; time stamps in s since 1970, UTC.
        stamps: whether the values are time stamps.
        cells: texts, one per row; none in a binary file.
        words: rows that are neither a finite number nor a gap.
        lines: lines of the rows in the file; none in a binary file.
        content: type of a column that is not numeric and has no values.
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
    other_unit: str | None = None
    cut: int = 0

    @classmethod
    def of_numbers(
        cls, header: str, name: str, unit: str | None, values: Floats, *, stamps: bool = False
    ) -> "TableColumn":
        """A column of a binary file; infinite values count as missing."""
        words = np.flatnonzero(np.isinf(values)).tolist()
        return cls(header, name, unit, np.where(np.isfinite(values), values, np.nan), stamps, words=words)

    def place(self, row: int) -> str:
        """Place of a row in the file."""
        return f"line {self.lines[row]}" if len(self.lines) else f"row {row + 1}"

    def at(self, row: int) -> str:
        """A cell and its place."""
        value = f"{self.values[row]:.15g}" if math.isfinite(self.values[row]) else "infinite"
        cell = repr(self.cells[row].strip()[:40]) if len(self.cells) else value
        return f"{self.place(row)}: {self.header} = {cell}"

    def factor(self, si: str, unit: str | None = None) -> float:
        """Factor from a unit to an SI unit; default: from the one that the file states, else from the SI unit.

        Raises:
            ConfigurationError: a unit of another quantity, or different units in the header and the row of units.
        """
        if unit is None and self.other_unit:
            raise ConfigurationError(self.contradiction)
        stated = unit or self.unit or si
        try:
            return 1.0 if stated == si else factor(stated, si)
        except ConfigurationError as error:
            raise ConfigurationError(f"column '{self.header}': {error}") from None

    @property
    def contradiction(self) -> str:
        """Error message for different units in the header and the row of units."""
        return f"column '{self.header}': is in {self.unit} by its header, in {self.other_unit} by the row of units"


def named_columns(table: Sequence[TableColumn], name: str) -> list[TableColumn]:
    """Columns by header, else by the last part of the header after a dot, else by name (all in Unicode form NFC)."""
    forms = [[each.header for each in table], [each.header.rpartition(".")[2] for each in table]]
    forms.append([each.name for each in table])
    composed = partial(normalize, "NFC")
    tables = [
        [each for each, form in zip(table, names, strict=True) if composed(form) == composed(name)] for names in forms
    ]
    return next((each for each in tables if each), [])


def read_csv(path: Path, marks: str = "") -> list[TableColumn]:
    """Read a CSV file, also one packed by gzip.

    Args:
        path: path of the file.
        marks: separator, or separator and decimal mark, such as ``;,`` or ``tab.``; default: recognised in the file.

    Raises:
        ConfigurationError: not text, rows of different lengths, or invalid marks.
        OSError: the file cannot be read.
    """
    separator, decimal = csv_marks(marks)
    text = _decoded(path)
    begins = re.match(r"sep=(.)\r?\n", text)  # as Excel writes it
    try:
        separator = separator or (begins[1] if begins else _separator(text))
        if separator.isspace() and separator != "\t":
            text = re.sub(r"(?m)^[ \t]+|[ \t]+$", "", text)
            text, separator = re.sub(r"[ \t]+", "\t", text), "\t"
        rows = _rows(text, separator, path)[begins is not None :]
    except csv.Error as error:
        raise ConfigurationError(f"{path}: not valid CSV: {error}") from error
    if not rows:
        raise ConfigurationError(f"{path}: is empty")
    widths = Counter(len(row) for _, row in islice(rows, SAMPLE))
    usual = max(widths, key=lambda width: (widths[width], width))
    header_row = _header_row([row for _, row in islice(rows, SAMPLE)], usual)
    if header_row is None:  # columns are named by their numbers
        header = [str(number) for number in range(1, usual + 1)]
    else:
        header = [cell.strip() for cell in rows[header_row][1][: _width(rows[header_row][1], usual)]]
        header[:1] = [each.lstrip("#% ") or each for each in header[:1]]
        rows = rows[header_row + 1 :]
    cut = _cut_end(rows, len(header), separator, ended=text.endswith(("\n", "\r")))
    units = _units_below(rows, len(header))
    for line, row in rows:
        if len(row) < len(header) or any(map(str.strip, row[len(header) :])):
            raise ConfigurationError(f"{path}: line {line}: has {len(row)} cells: must have {len(header)}")
    cells = list(zip(*(row[: len(header)] for _, row in rows), strict=True)) or [()] * len(header)
    lines = [line for line, _ in rows]
    beside = csv_units(path)
    columns = []
    for text_of_header, stated, texts, mark in zip(header, units, cells, _decimal_marks(cells, decimal), strict=True):
        name, unit_of_header = split_header(text_of_header)
        values, words, stamps = _numbers(texts, mark)
        unit = unit_of_header or stated or beside.get(name)
        other = stated if stated and unit and is_unit(stated) and not is_same_unit(unit, stated) else None
        columns.append(
            TableColumn(text_of_header, name, unit, values, stamps, texts, words, lines, other_unit=other, cut=cut)
        )
    return columns


def _rows(text: str, separator: str, path: Path) -> list[tuple[int, list[str]]]:
    """Rows that are not empty, each with the number of its first line.

    Raises:
        ConfigurationError: a quote is not closed on its line.
    """
    rows, line = list[tuple[int, list[str]]](), 1
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        for row in reader:
            # a quoted cell may contain line breaks, but not with separators: these are cells of further rows
            if reader.line_num > line and any(separator in cell and re.search(r"[\r\n]", cell) for cell in row):
                raise ConfigurationError(f'{path}: line {line}: has a quote (") that is not closed on this line')
            if any(map(str.strip, row)):
                rows.append((line, row))
            line = reader.line_num + 1
    except csv.Error as error:
        raise ConfigurationError(f'{path}: line {line}: {error}; is a quote (") not closed?') from error
    return rows


def _header_row(rows: Sequence[Sequence[str]], usual: int) -> int | None:
    """The header: the first row of texts of those right above the run of numbers; None: there is none.

    Rows below it may hold words and units. Rows of names and numbers, as of a logger's settings, are above it. Where no
    row has numbers or gaps alone, it is the first row of texts.
    """
    wide = [number for number, row in enumerate(rows) if _width(row, usual) == usual]
    run = next((number for number in wide if _is_numeric(rows[number])), None)
    text = [number for number in wide if not _is_data(rows[number]) and (run is None or number < run)]
    if run is None or not text:
        return None if run is not None and run == wide[0] else next(iter(text), 0)
    cells = {number: [cell for cell in rows[number] if cell.strip() not in DIMENSIONLESS] for number in wide}
    settings = max((number for number in wide if number < run and _is_data(cells[number])), default=-1)
    names = [number for number in text if 2 * sum(map(bool, map(str.strip, rows[number]))) > usual]
    return next((number for number in names if number > settings), text[-1])


def _is_numeric(row: Sequence[str]) -> bool:
    """Whether a row has numbers, time stamps and gaps alone, most of them no gaps."""
    filled = [cell for cell in row if cell.strip().lower() not in GAPS]
    return 2 * len(filled) > len(row) and all(_is_data([cell]) for cell in filled)


def _width(row: Sequence[str], usual: int) -> int:
    """Number of cells of a row, without empty ones beyond the usual number."""
    return usual if len(row) > usual and not any(map(str.strip, row[usual:])) else len(row)


def _units_below(rows: list[tuple[int, list[str]]], width: int) -> list[str | None]:
    """Units from a row between the header and the first row of data; removes that row and all before it."""
    for number, (_, row) in enumerate(islice(rows, SAMPLE)):
        cells = [cell.strip().strip("[]()").strip() for cell in row]
        if len(row) < width - 1 or _is_data([cell for cell in cells if cell not in DIMENSIONLESS]):
            break
        if any(map(is_unit, cells)):
            del rows[: number + 1]
            return [None if cell in DIMENSIONLESS else cell for cell in [*cells, ""][:width]]
    return [None] * width


def _cut_end(rows: list[tuple[int, list[str]]], width: int, separator: str, *, ended: bool) -> int:
    """Remove text below the last row, and an incomplete last row; returns the line of the latter, else 0.

    After an unclosed quote the rest is one cell that ends with the line break.
    """
    while rows and len(rows[-1][1]) < width and not _is_data(separator.join(rows[-1][1]).split(separator)):
        rows.pop()
    if rows and len(rows[-1][1]) < width and (not ended or rows[-1][1][-1].endswith(("\n", "\r"))):
        return rows.pop()[0]
    return 0


def csv_marks(text: str) -> tuple[str, str]:
    """Separator and decimal mark from a text such as ``;,`` or ``tab.``; empty where it has none.

    Raises:
        ConfigurationError: the text is invalid.
    """
    named = {name: mark for mark, name in SEPARATORS.items()}
    named["space"] = " "
    parts = re.fullmatch(r"(tab|space|[\t ;|,])?([.,]?)", text)
    if not parts or (parts[1] and named.get(parts[1], parts[1]) == parts[2]):
        raise ConfigurationError(
            f"--csv {text}: must be a separator (; , | tab or space) and a decimal mark, e.g. ';,'"
        )
    return named.get(parts[1], parts[1]) or "", parts[2]


def split_header(text: str) -> tuple[str, str | None]:
    """Name and unit of a header such as ``F1 [kN]``, or ``F1 (kN)``, ``F1/kN``, ``F1_kN`` with a known unit."""
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
    """Units of a CSV file from the metadata file that `simulation.results.file_formats` writes beside it."""
    beside = path.with_name(path.name + "-metadata.json")
    if not beside.exists():
        return {}
    try:
        columns = json.loads(beside.read_text(encoding="utf-8"))["tableSchema"]["columns"]
        return {column["name"]: column["dualwinch:unit"] for column in columns if "dualwinch:unit" in column}
    except (ValueError, LookupError, TypeError):
        return {}  # another kind of metadata


LATIN_CONTROLS = re.compile(rb"[\x81-\x9f]")
"""Bytes that no text in Latin-1 has, and that nearly every Japanese word in Shift-JIS has."""


def _decoded(path: Path) -> str:
    """The text of a file in UTF-8, UTF-16, Shift-JIS or Latin-1."""
    data = path.read_bytes()
    if path.suffix.lower() == ".gz":
        data = gzip.decompress(data)
    wide = data[:2] in {b"\xff\xfe", b"\xfe\xff"}
    narrow = ["utf-8-sig", *(["cp932"] if LATIN_CONTROLS.search(data) else []), "latin-1"]
    codecs = ["utf-16"] if wide else narrow
    for offset, codec in enumerate(("utf-16-be", "utf-16-le")):
        if data[offset:20:2].count(0) > 8 and not wide:
            codecs = [codec]
    for codec in codecs:
        try:
            text = data.decode(codec).rstrip("\0").replace("\N{MINUS SIGN}", "-")
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
        line = text[: text.index("\0")].count("\n") + 1
        raise ConfigurationError(f"{path}: line {line}: has NUL bytes, as of a block that was never written; remove it")
    raise ConfigurationError(f"{path}: not UTF-8, UTF-16, Shift-JIS or Latin-1 text")


def _separator(text: str) -> str:
    """The first separator that splits most lines into the same number of cells, two or more; spaces come last.

    Where spaces separate numbers with commas, the commas are decimal marks.
    """
    lines = [line for line in islice(text.splitlines(), SAMPLE) if line.strip()]
    spaced = sum(bool(re.search(r"\d[ ]+[+-]?\d+,\d", line)) for line in lines)
    for separator in SEPARATORS:
        if separator == "," and 2 * spaced > len(lines):
            continue
        widths = Counter(len(next(csv.reader([line], delimiter=separator))) for line in lines)
        width, count = widths.most_common(1)[0] if widths else (0, 0)
        if width > 1 and 2 * count > len(lines):
            return separator
    width, count = Counter(len(line.split()) for line in lines).most_common(1)[0] if lines else (0, 0)
    return " " if width > 1 and 2 * count > len(lines) else ","


def _is_data(row: Sequence[str]) -> bool:
    """Whether a row has a number or a time stamp."""
    return any(
        _number(cell, ".") is not None or _number(cell, ",") is not None or _stamp(cell) is not None for cell in row
    )


def _decimal_marks(columns: Sequence[Sequence[str]], stated: str) -> list[str]:
    """The decimal mark of each column: the one in most of its numbers.

    Where all of these may also be thousands separators, it is the stated mark, else that of the other columns.
    """
    marks_found = list[str]()
    for cells in columns:
        text = "\n".join(cells)
        marks = [mark for mark in DECIMALS if mark in text] or ["."]
        mark = (
            max(marks, key=lambda each: len(re.findall(LINE.format(DECIMALS[each]), text))) if marks[1:] else marks[0]
        )
        sure = re.search(LINE.format(rf"(?!{GROUPED[mark]}[ \t]*$){DECIMALS[mark]}"), text)
        marks_found.append(mark if sure else f"{mark}?")
    sure_marks = {mark for mark in marks_found if mark in DECIMALS}
    usual = stated or (sure_marks.pop() if len(sure_marks) == 1 else None)
    return [mark if mark in DECIMALS else usual or mark[0] for mark in marks_found]


def has_other_mark(cell: str) -> bool:
    """Whether a text would be a number with another decimal mark, or without thousands separators."""
    return bool(re.fullmatch(r"[+-]?\d[\d.,]*([eE][+-]?\d+)?", cell.strip()))


def _number(cell: str, mark: str) -> float | None:
    """The finite number in a cell with a decimal mark."""
    if "_" in cell or (mark == "," and "." in cell):
        return None
    try:
        value = float(cell.replace(",", ".") if mark == "," else cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _stamp(cell: str, *, day_first: bool = False) -> float | None:
    """Seconds since 1970 of a time stamp, or since midnight of a time of day; month first unless `day_first`."""
    cell = cell.strip()
    if parts := re.fullmatch(r"(\d{1,2})([./])(\d{1,2})[./](\d{4})[ T]+(.*)", cell):
        number_1, number_2 = int(parts[1]), int(parts[3])
        month, day = (number_1, number_2) if parts[2] == "/" and not day_first else (number_2, number_1)
        cell = f"{parts[4]}-{month:02}-{day:02}T{parts[5]}"
    if parts := re.fullmatch(CLOCK, cell) or re.fullmatch(MINUTES, cell):
        days, hours, minutes, seconds = (float((part or "0").replace(",", ".")) for part in parts.groups())
        return days * DAY + hours * HOUR + minutes * 60 + seconds
    cell = re.sub(r"^(\d{4})/(\d\d)/", r"\1-\2-", cell)
    for text in (cell, f"1970-01-01T{cell}") if ":" in cell else ():
        try:
            instant = datetime.fromisoformat(text)
        except ValueError:
            continue
        return (instant if instant.tzinfo else instant.replace(tzinfo=UTC)).timestamp()
    return None


def _numbers(cells: Sequence[str], mark: str) -> tuple[Floats, list[int], bool]:
    """Numbers or time stamps of cells, rows that are neither, and whether they are time stamps."""
    text = "\n".join(cells)
    if not ("_" in text or (mark == "," and "." in text)):  # NumPy would accept both
        try:
            values = np.array([cell.replace(",", ".") for cell in cells] if mark == "," else cells, float)
            return np.where(np.isfinite(values), values, np.nan), np.flatnonzero(np.isinf(values)).tolist(), False
        except ValueError:
            pass
    filled = [row for row, cell in enumerate(cells) if cell.strip().lower() not in GAPS]
    stamps = bool(filled) and any(_stamp(cells[filled[0]], day_first=day) is not None for day in (False, True))
    values, words = _cells(cells, filled, _stamp if stamps else partial(_number, mark=mark))
    if stamps and re.match(r"\s*\d+/\d+/\d{4}", cells[filled[0]]):
        day_first, no_dates = _cells(cells, filled, partial(_stamp, day_first=True))
        # the order with fewer invalid dates, else with the smaller span
        if (len(no_dates), _span(day_first)) < (len(words), _span(values)):
            values, words = day_first, no_dates
    minutes = all(re.fullmatch(MINUTES, cells[row].strip()) for row in filled)
    period = HOUR if minutes else DAY
    if stamps and np.nanmax(values) < period:  # times of day, which restart at midnight, or of an hour
        finite = np.isfinite(values)
        values[finite] += period * np.cumsum(np.diff(values[finite], prepend=0.0) < -period / 2)
    return values, words, stamps


def _span(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if len(finite) else 0.0


def _cells(
    cells: Sequence[str], filled: Sequence[int], read: Callable[[str], float | None]
) -> tuple[Floats, list[int]]:
    """Values of the filled cells, and the rows that cannot be read."""
    values, words = np.full(len(cells), np.nan), list[int]()
    for row in filled:
        value = read(cells[row])
        if value is None:
            words.append(row)
        else:
            values[row] = value
    return values, words
