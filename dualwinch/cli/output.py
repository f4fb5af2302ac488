"""Output of commands: tables of named figures with units, for terminal and files alike."""

import json
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from dualwinch.analysis.idealisations import Idealisation
    from dualwinch.model.quantities.quantity import Quantity
    from dualwinch.simulation.metrics.metric import MetricQuantity
    from dualwinch.simulation.results.result import Result


def terminal(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console without markup, so that brackets in names of files, studies and parts are printed."""
    return Console(stderr=stderr, soft_wrap=soft_wrap, markup=False)


def styled(style: str, words: str, *plain: str) -> Text:
    """Words in a style such as ``bold`` or ``red``, followed by plain ones."""
    return Text.assemble((words, style), *plain)


def measured(value: float, form: str = ".4g") -> str:
    """Format a figure of merit: NaN (nothing to measure) as a dash, infinity as ∞."""
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
        shown_unit: of the printed number, below the heading; empty: no unit is printed there.
        meaning: of the figure.
    """

    name: str
    unit: str = "1"
    heading: str | None = None
    factor: float = 1.0
    form: str = ".4g"
    words: Mapping[Any, str | Text] = field(default_factory=dict)
    shown_unit: str = ""
    meaning: str = ""

    @classmethod
    def of(cls, name: str, quantity: "Quantity", form: str = ".4g", heading: str | None = None) -> "FigureColumn":
        """The column of a field, from its metadata, in its own unit."""
        return cls(name, quantity.unit, heading, form=form, meaning=quantity.meaning)

    @classmethod
    def of_metric(cls, name: str, quantity: "MetricQuantity", heading: str = "", form: str = "") -> "FigureColumn":
        """The column of a figure of merit, printed in its customary unit; heading and form default to its own."""
        unit, factor, own_form = quantity.shown
        words, unit_text = heading or quantity.label, unit or quantity.shown_unit
        return cls(name, quantity.unit, words, factor, form or own_form, shown_unit=unit_text, meaning=quantity.meaning)

    @property
    def title(self) -> str:
        """The heading on the terminal."""
        return self.name if self.heading is None else self.heading

    def shown(self, value: Any) -> str | Text:
        """A value as text for the terminal."""
        if value in self.words:
            return self.words[value]
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return measured(self.factor * value, self.form) if number else str(value)

    def cell(self, value: Any) -> "str | Text | CellWords":
        """A value as a cell of a table, in which words may break."""
        number = self.shown(value)
        return CellWords(number) if isinstance(number, str) and not self.unit else number


HEADING_WIDTH = 10
"""Characters per line of a heading with a unit below it."""

NAME_WIDTH = 22
"""Characters per line of a heading with a user's name, such as a path: two of them leave room for figures."""


BETWEEN_WORDS = re.compile(r" (?!\(\d+\)|%|[\d.e+-]+ %)")
"""Line breaks between words; a number in brackets and a percentage stay with the word before them."""

WITHIN_NAMES = re.compile(r"(?<=\.)(?=[^\W\d])|(?<= )"), re.compile(r"(?<=_)(?=[^\W\d_])")
"""Line breaks within a name too long for a line, in order of preference: behind a dot, behind an underscore."""


class CellWords:
    """Words in a cell of a table, whose lines break between words, or in long names behind a dot or an underscore."""

    def __init__(self, words: str) -> None:
        self.words = words

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        narrow, wide = (max(map(cell_len, self.lines(width)), default=0) for width in (1, 1 << 20))
        return Measurement(narrow, wide)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield Text("\n".join(self.lines(options.max_width)))

    def lines(self, width: int) -> list[str]:
        """Break the words into lines of a width; a name without a place to break makes a longer line."""
        lines = []
        for line in self.words.splitlines():
            words = (f"{word} " for word in BETWEEN_WORDS.split(line))
            lines += _filled([piece for word in words for piece in _pieces(word, width, *WITHIN_NAMES)], width)
        return lines


def _pieces(word: str, width: int, *places: re.Pattern[str]) -> list[str]:
    """Split a word that is too long for a line at the first places, and its pieces that still are at the next ones."""
    if not places or cell_len(word.rstrip()) <= width:
        return [word]
    return [piece for part in places[0].split(word) for piece in _pieces(part, width, *places[1:])]


def _filled(pieces: Sequence[str], width: int) -> list[str]:
    """Join pieces into lines, as many as fit in each."""
    lines = [""]
    for piece in pieces:
        if lines[-1] and cell_len((lines[-1] + piece).rstrip()) > width:
            lines.append("")
        lines[-1] += piece
    return [line.rstrip() for line in lines]


@dataclass(frozen=True)
class FigureTable:
    """Figures that a command prints and writes to its file.

    Attributes:
        name: of the table, in files.
        columns: of the table.
        rows: a value for every column.
        title: on the terminal.
    """

    name: str
    columns: Sequence[FigureColumn]
    rows: Sequence[Sequence[Any]]
    title: str | None = None

    def render(self) -> Table:
        """The table for the terminal; words are aligned left, numbers right."""
        table = Table(title=self.title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        printed = [(index, column) for index, column in enumerate(self.columns) if column.form]
        for _, column in printed:
            heading = column.title
            if column.shown_unit:
                heading = f"{fill(heading, HEADING_WIDTH, break_long_words=False)}\n{column.shown_unit}"
            table.add_column(
                heading, justify="right" if column.unit else "left", no_wrap=bool(column.unit), overflow="fold"
            )
        for row in self.rows:
            table.add_row(*(column.cell(row[index]) for index, column in printed))
        return table

    def render_down(self) -> Table:
        """The transposed table, a line per figure: name, the value in each row, unit and meaning.

        A first column of words becomes the heading.
        """
        from dualwinch.model.quantities.tables import readable_unit

        headed = not self.columns[0].unit
        figures = list(zip(self.columns, zip(*self.rows, strict=True), strict=True))
        table = Table(box=box.SIMPLE_HEAD if headed else None, show_header=headed, pad_edge=False)
        table.add_column("", style="bold", no_wrap=True)
        for row, heading in zip(self.rows, figures[0][1], strict=True):
            words = fill(str(self.columns[0].shown(heading)), NAME_WIDTH, break_on_hyphens=False) if headed else ""
            values = [column.shown(value) for column, value in zip(self.columns, row, strict=True)][headed:]
            table.add_column(words, justify="right", min_width=max(map(len, values)), overflow="fold")
        table.add_column("")
        if not headed:
            table.add_column("", style="dim")
        for column, values in figures[headed:]:
            unit = column.shown_unit or readable_unit(column.unit)
            table.add_row(column.title, *map(column.shown, values), unit, *([] if headed else [column.meaning]))
        return table

    def record(self) -> dict[str, Any]:
        """The table as plain data: units by name, and a mapping from name to value for every row."""
        from dualwinch.simulation.results.file_formats import plain

        names = [column.name for column in self.columns]
        return {
            "units": {column.name: column.unit for column in self.columns},
            "rows": [plain(dict(zip(names, row, strict=True))) for row in self.rows],
        }


def records(tables: Sequence[FigureTable]) -> dict[str, Any]:
    """Name → table as plain data."""
    return {table.name: table.record() for table in tables}


FIGURE_SUFFIXES = (".png", ".svg", ".pdf")
"""Suffixes of figures."""


def check_file(file: Path | None, *suffixes: str) -> None:
    """Check before a computation that a file can be written.

    Raises:
        ConfigurationError: a suffix other than these, or a folder that cannot be written to.
    """
    from dualwinch.config.folders import check_place
    from dualwinch.model.errors import ConfigurationError

    if file is None:
        return
    if file.suffix.lower() not in suffixes:
        one_of = "one of " if len(suffixes) > 1 else ""
        raise ConfigurationError(f"{file.name}: unknown suffix {file.suffix!r}; must be {one_of}{', '.join(suffixes)}")
    check_place(file)


LIBRARIES = ("casadi", "numpy", "scipy", "matplotlib", "optuna", "pyarrow")
"""Libraries on which results depend."""


def versions() -> dict[str, str]:
    """Versions of dualwinch, Python and the libraries on which results depend."""
    import platform
    from importlib.metadata import version

    from dualwinch import __version__

    return {"dualwinch": __version__, "python": platform.python_version()} | {name: version(name) for name in LIBRARIES}


def version_notes() -> dict[str, str]:
    """Versions as notes of a file, ``version_numpy`` and so on."""
    return {f"version_{name}": version for name, version in versions().items()}


def print_note(words: str, *, stderr: bool = False) -> None:
    """Print a note."""
    terminal(stderr=stderr, soft_wrap=True).print(styled("yellow", "note", f": {words}"))


def wrote(file: object) -> None:
    """Print on standard error that a file was written."""
    terminal(stderr=True, soft_wrap=True).print(f"wrote {file}", highlight=False)


def wrote_to(folder: Path, files: Sequence[Path]) -> None:
    """Print which files were written to a folder."""
    wrote(f"{folder}: {', '.join(path.name for path in files)}")


@contextmanager
def if_interrupted(words: str) -> Iterator[None]:
    """Let the message of an interrupt say how to go on, in place of which files have been written."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(words) from None


def json_text(facts: Mapping[str, Any]) -> str:
    """A mapping as JSON."""
    from dualwinch.simulation.results.file_formats import plain

    return json.dumps(plain(facts), indent=1, allow_nan=False) + "\n"


def print_json(facts: Mapping[str, Any]) -> None:
    """Print a mapping as JSON."""
    sys.stdout.write(json_text(facts))


def print_idealisations(found: "Sequence[Idealisation]") -> None:
    """Print a plant's idealisations in one line, if any."""
    from dualwinch.analysis.idealisations import summary

    if words := summary(found):
        terminal(soft_wrap=True).print(words, highlight=False)


def print_result(result: "Result", typed: str = "", *, json: bool, loop: bool = True, **further: Any) -> None:
    """Print outcome, figures of merit and remarks of a run; commands in remarks have the options `typed`.

    With `json` the output is JSON with `further` facts; without `loop` there are no remarks on the control loop.
    """
    from dualwinch.analysis.idealisations import idealisations
    from dualwinch.analysis.remarks import in_full, remarks
    from dualwinch.simulation.loop.structure import is_automatic, solver_of

    metrics, simplifications = result.metrics, idealisations(result.experiment)
    noted = [in_full(words, typed) for words in remarks(result, loop=loop)]
    columns = [FigureColumn.of(name, quantity, ".6g") for name, quantity in metrics.quantities.items()]
    table = FigureTable("metrics", columns, [list(dict(metrics).values())])
    kind, solver = result.experiment.controller.law.kind, solver_of(result.experiment)
    if json:
        facts = {"outcome": result.outcome, "end_time": result.end_time, "law": kind, "solver": str(solver)}
        facts |= {"metrics": dict(metrics), "units": table.record()["units"] | {"end_time": "s"}, "remarks": noted}
        print_json({**facts, "idealisations": [asdict(one) for one in simplifications], **further})
        return
    words = f" ({solver})" if is_automatic(result.experiment) else ""
    console = terminal()
    console.print(styled("bold", kind, f": {result.outcome} at {result.end_time:g} s{words}"))
    console.print(table.render_down())
    for words in noted:
        print_note(words)
    print_idealisations(simplifications)


def write_text(file: Path | None, text: Callable[[], str]) -> None:
    """Write a requested file, whole or not at all, and print its name."""
    from dualwinch.codegen.files import write_whole

    if file:
        write_whole(file, text())
        wrote(file)


def write_json(file: Path | None, facts: Mapping[str, Any]) -> None:
    """Write a requested JSON file, and print its name."""
    write_text(file, lambda: json_text(facts))


def write_figure(file: Path | None, figure: str | Callable[[], Any], *of: Any) -> None:
    """Draw and write a requested figure, and print its name.

    The figure is a function that draws it, or the name of a function of `simulation.plots` with arguments `of`.
    """
    if file:
        from dualwinch import plots

        with terminal(stderr=True).status(f"drawing {file}"):
            plots.save(getattr(plots, figure)(*of) if isinstance(figure, str) else figure(), file)
        wrote(file)


MOST = 10_000
"""Most numbers of a range."""


def numbers_between(text: str, wrong: str) -> list[float] | list[int]:
    """The numbers of ``first:last:step`` or ``first:last:count:log``; integers if first, last and step are.

    Raises:
        ConfigurationError: no range, or one of too many numbers; the message begins with the text `wrong`.
    """
    from dualwinch.model.errors import ConfigurationError

    words = text.split(":")
    by_factors = len(words) == 4 and words[3].strip() == "log"
    try:
        start, last, step = (float(word) for word in (words[:3] if by_factors else words))
    except ValueError:
        raise ConfigurationError(wrong) from None
    if by_factors:
        if not (0 < start < math.inf and 0 < last < math.inf and 2 <= step <= MOST and step == int(step)):
            raise ConfigurationError(f"{wrong}; first and last must be > 0, and the count 2 to {MOST}")
        inner = [float(f"{start * (last / start) ** (k / (step - 1)):.12g}") for k in range(1, int(step) - 1)]
        return [start, *inner, last]
    if not all(map(math.isfinite, (start, last, step))) or step == 0 or (last - start) / step < 0:
        raise ConfigurationError(f"{wrong}; the step must be finite, not 0, and lead from first to last")
    if not math.isfinite((last - start) / step):
        raise ConfigurationError(f"{wrong}; too many points, must be <= {MOST}")
    count = math.floor((last - start) / step * (1 + 1e-12) + 1e-9) + 1
    if count > MOST:
        raise ConfigurationError(f"{wrong}; these are {count:.12g} points, must be <= {MOST}")
    if all(word.strip().lstrip("+-").isdecimal() for word in words):
        return [int(start) + k * int(step) for k in range(count)]
    return [round(start + k * step, 12) for k in range(count)]
