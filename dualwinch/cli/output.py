"""What commands print and write: tables of named figures with units, which the terminal and files show alike."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text


def terminal(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console for which brackets in the names of files, studies and parts mean nothing."""
    return Console(stderr=stderr, soft_wrap=soft_wrap, markup=False)


def styled(style: str, words: str, *plain: str) -> Text:
    """Words in a style such as ``bold`` or ``red``, and plain ones behind them."""
    return Text.assemble((words, style), *plain)


def measured(value: float, form: str = ".4g") -> str:
    """A figure of merit in a format: a dash where there was nothing to measure, ∞ where nothing limits it."""
    return "–" if math.isnan(value) else f"{value:{form}}".replace("inf", "∞")


def json_value(value: Any) -> Any:
    """A value as JSON holds it: NaN is null, infinity the text ``inf``, arrays are lists."""
    if isinstance(value, Mapping):
        return {str(key): json_value(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_value(inner) for inner in value]
    if hasattr(value, "tolist"):
        return json_value(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else f"{value}"
    return value


@dataclass(frozen=True)
class FigureColumn:
    """One column of a table of figures.

    Attributes:
        name: of the figure, in files.
        unit: of the value in files; "1": a pure number, "": words.
        heading: on the terminal; default: the name.
        factor: from the file's value to the printed one, e.g. 1e3 where seconds are printed in ms.
        form: format of the printed number.
        words: what is printed instead of some values.
    """

    name: str
    unit: str = "1"
    heading: str | None = None
    factor: float = 1.0
    form: str = ".4g"
    words: Mapping[Any, str] = field(default_factory=dict)

    def shown(self, value: Any) -> str:
        """A value as the terminal shows it."""
        if value in self.words:
            return self.words[value]
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return measured(self.factor * value, self.form) if number else str(value)


@dataclass(frozen=True)
class FigureTable:
    """Figures that a command prints, and writes to its file: both are made of this table.

    Attributes:
        name: of the table, in files.
        columns: of the table.
        rows: a value for every column.
    """

    name: str
    columns: Sequence[FigureColumn]
    rows: Sequence[Sequence[Any]]

    def render(self) -> Table:
        """The table on a terminal; words stand left, numbers right."""
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        for column in self.columns:
            heading = column.name if column.heading is None else column.heading
            table.add_column(heading, justify="right" if column.unit else "left", no_wrap=bool(column.unit))
        for row in self.rows:
            table.add_row(*(column.shown(value) for column, value in zip(self.columns, row, strict=True)))
        return table

    def record(self) -> dict[str, Any]:
        """The table as plain data: units by name, and a mapping from name to value for every row."""
        names = [column.name for column in self.columns]
        return {
            "units": {column.name: column.unit for column in self.columns},
            "rows": [dict(zip(names, map(json_value, row), strict=True)) for row in self.rows],
        }


def records(tables: Sequence[FigureTable]) -> dict[str, Any]:
    """Tables as plain data, by their names."""
    return {table.name: table.record() for table in tables}


FIGURE_SUFFIXES = (".png", ".svg", ".pdf")
"""Suffixes of figures."""


def check_file(file: Path | None, *suffixes: str) -> None:
    """Find out now whether a file can be written.

    Raises:
        ConfigurationError: a suffix other than these, or a folder that cannot be written to.
    """
    from dualwinch.config.folders import check_folder
    from dualwinch.model.errors import ConfigurationError

    if file is None:
        return
    if file.suffix.lower() not in suffixes:
        one_of = "one of " if len(suffixes) > 1 else ""
        raise ConfigurationError(f"{file.name}: unknown suffix {file.suffix!r}; must be {one_of}{', '.join(suffixes)}")
    check_folder(file.parent)


def wrote(file: object) -> None:
    """Say on standard error that a file was written."""
    terminal(stderr=True, soft_wrap=True).print(f"wrote {file}", highlight=False)


def write_text(file: Path, text: str) -> None:
    """Write a file, whole or not at all, and say so."""
    from dualwinch.codegen.files import atomic

    with atomic(file) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
    wrote(file)


def write_json(file: Path, facts: Mapping[str, Any]) -> None:
    """Write a mapping as JSON, and say so."""
    write_text(file, json.dumps(facts, indent=1, allow_nan=False) + "\n")


def write_figure(file: Path, figure: Any) -> None:
    """Write a figure, and say so."""
    from dualwinch.simulation.plots import save

    save(figure, file)
    wrote(file)


MOST = 10_000
"""Numbers of a range."""


def numbers_between(text: str, wrong: str) -> list[float] | list[int]:
    """The numbers of ``first:last:step`` or ``first:last:count:log``; whole ones where all of the first three are.

    Args:
        text: the range.
        wrong: what a message begins with where it is none.

    Raises:
        ConfigurationError: no range, or one of too many numbers.
    """
    from dualwinch.model.errors import ConfigurationError

    words = text.split(":")
    if len(words) == 4 and words[3].strip() == "log":
        return _by_factors(words, wrong)
    try:
        first, last, step = (float(word) for word in words)
    except ValueError:
        raise ConfigurationError(wrong) from None
    if not all(map(math.isfinite, (first, last, step))) or step == 0 or (last - first) / step < 0:
        raise ConfigurationError(f"{wrong}; the step must be finite, not 0, and lead from first to last")
    if not math.isfinite((last - first) / step):
        raise ConfigurationError(f"{wrong}; these are too many points, must be <= {MOST}")
    count = math.floor((last - first) / step * (1 + 1e-12) + 1e-9) + 1
    if count > MOST:
        raise ConfigurationError(f"{wrong}; these are {count:.12g} points, must be <= {MOST}")
    if all(word.strip().lstrip("+-").isdecimal() for word in words):
        return [int(first) + k * int(step) for k in range(count)]
    return [round(first + k * step, 12) for k in range(count)]


def _by_factors(words: list[str], wrong: str) -> list[float]:
    from dualwinch.model.errors import ConfigurationError

    try:
        first, last, count = float(words[0]), float(words[1]), int(words[2])
    except ValueError:
        raise ConfigurationError(wrong) from None
    if not (0 < first < math.inf and 0 < last < math.inf and 2 <= count <= MOST):
        raise ConfigurationError(f"{wrong}; first and last must be > 0, and the count 2 to {MOST}")
    inner = [float(f"{first * (last / first) ** (k / (count - 1)):.12g}") for k in range(1, count - 1)]
    return [first, *inner, last]
