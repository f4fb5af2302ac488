"""What a result says in figures: tables of named numbers with units, and sentences; for terminal and files alike."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

if TYPE_CHECKING:
    from dualwinch.model.quantities.quantity import Quantity


def plain(value: Any) -> Any:
    """A value in JSON types: NaN as null, infinite numbers as words, arrays as lists."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # an array or a scalar of NumPy, which this module does not need otherwise
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else ("INF" if value > 0 else "-INF")
    return value


def measured(value: float, form: str = ".4g") -> str:
    """Format a figure: NaN (nothing to measure) as a dash, infinity as ∞."""
    return "–" if math.isnan(value) else f"{value:{form}}".replace("inf", "∞")


@dataclass(frozen=True)
class FigureColumn:
    """One column of a table of figures.

    Attributes:
        name: of the figure, in files.
        unit: of the value in files; "1": a pure number, "": words.
        heading: on the terminal; default: the name.
        factor: printed value over the file's, e.g. 1e3 for seconds printed in ms.
        form: format of the printed number; empty: the column is in files alone.
        words: value → text printed instead.
        styles: value → style in which it is printed, such as ``red``.
        shown_unit: of the printed number, below the heading; empty: no unit is printed there.
        meaning: of the figure.
    """

    name: str
    unit: str = "1"
    heading: str | None = None
    factor: float = 1.0
    form: str = ".4g"
    words: Mapping[Any, str] = field(default_factory=dict)
    styles: Mapping[Any, str] = field(default_factory=dict)
    shown_unit: str = ""
    meaning: str = ""

    @classmethod
    def of(cls, name: str, quantity: "Quantity", form: str = ".4g", heading: str | None = None) -> "FigureColumn":
        """The column of a field, from its metadata, in its own unit."""
        return cls(name, quantity.unit, heading, form=form, meaning=quantity.meaning)

    @property
    def title(self) -> str:
        """The heading on the terminal."""
        return self.name if self.heading is None else self.heading

    def shown(self, value: Any) -> str:
        """A value as text for the terminal."""
        if value in self.words:
            return self.words[value]
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return measured(self.factor * value, self.form) if number else str(value)


@dataclass(frozen=True)
class FigureTable:
    """Figures that are printed and written to a file.

    Attributes:
        name: of the table, in files; empty: it is printed alone.
        columns: of the table.
        rows: a value for every column.
        title: above the table on the terminal, in bold.
        subtitle: behind the title.
        layout: on the terminal: a line per row (``rows``), a line per column (``columns``); ``file``: not printed.
    """

    name: str
    columns: Sequence[FigureColumn]
    rows: Sequence[Sequence[Any]]
    title: str = ""
    subtitle: str = ""
    layout: Literal["rows", "columns", "file"] = "rows"

    def to_record(self) -> dict[str, Any]:
        """The table as plain data: units by name, and a mapping from name to value for every row."""
        names = [column.name for column in self.columns]
        return {
            "units": {column.name: column.unit for column in self.columns},
            "rows": [plain(dict(zip(names, row, strict=True))) for row in self.rows],
        }


@dataclass(frozen=True)
class Sentence:
    """A sentence about figures, of which the beginning may be emphasised.

    Attributes:
        words: of the sentence, behind the beginning.
        beginning: printed in the style.
        style: of the beginning, such as ``bold`` or ``red``.
    """

    words: str
    beginning: str = ""
    style: str = "bold"

    def __str__(self) -> str:
        return f"{self.beginning}{self.words}"


Figures: TypeAlias = Sequence[FigureTable | Sentence]
"""What a result says, in the order in which it is printed."""


def to_record(figures: Iterable[FigureTable | Sentence]) -> dict[str, Any]:
    """Name → table as plain data; the entry ``notes`` has the sentences.

    Example:
        >>> mass = FigureColumn("mass", "kg")
        >>> to_record([FigureTable("vehicle", [mass], [[9e3]]), Sentence("it is light")])
        {'vehicle': {'units': {'mass': 'kg'}, 'rows': [{'mass': 9000.0}]}, 'notes': ['it is light']}
    """
    items = list(figures)
    notes = [str(item) for item in items if isinstance(item, Sentence)]
    tables = {item.name: item.to_record() for item in items if isinstance(item, FigureTable) and item.name}
    return tables | {"notes": notes}
