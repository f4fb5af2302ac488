"""Output of commands: tables of named figures with units, for terminal and files alike."""

import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from dualwinch.model.quantities.figures import FigureColumn, Figures, FigureTable, Sentence

if TYPE_CHECKING:
    from dualwinch.analysis.idealisations import Idealisation
    from dualwinch.simulation.experiment import Experiment
    from dualwinch.simulation.results.result import Result


def terminal(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console without markup, so that brackets in names of files, studies and parts are printed."""
    return Console(stderr=stderr, soft_wrap=soft_wrap, markup=False)


def styled(style: str, words: str, *plain: str) -> Text:
    """Words in a style such as ``bold`` or ``red``, followed by plain ones."""
    return Text.assemble((words, style), *plain)


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


def table_of_rows(figures: FigureTable) -> Table:
    """A table of figures with a line per row; words are aligned left, numbers right."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    printed = [(index, column) for index, column in enumerate(figures.columns) if column.form]
    for _, column in printed:
        heading = column.title
        if column.shown_unit:
            heading = f"{fill(heading, HEADING_WIDTH, break_long_words=False)}\n{column.shown_unit}"
        table.add_column(
            heading, justify="right" if column.unit else "left", no_wrap=bool(column.unit), overflow="fold"
        )
    for row in figures.rows:
        table.add_row(*(_cell(column, row[index]) for index, column in printed))
    return table


def _cell(column: FigureColumn, value: Any) -> "str | Text | CellWords":
    """A value as a cell, in which words may break."""
    text = column.shown(value)
    if value in column.styles:
        return styled(column.styles[value], text)
    return text if column.unit else CellWords(text)


def table_of_columns(figures: FigureTable) -> Table:
    """A table of figures with a line per column: name, the value in each row, unit and meaning.

    A first column of words becomes the heading.
    """
    from dualwinch.model.quantities.tables import readable_unit

    headed = not figures.columns[0].unit
    lines = list(zip(figures.columns, zip(*figures.rows, strict=True), strict=True))
    table = Table(box=box.SIMPLE_HEAD if headed else None, show_header=headed, pad_edge=False)
    table.add_column("", style="bold", no_wrap=True)
    for row, heading in zip(figures.rows, lines[0][1], strict=True):
        words = fill(figures.columns[0].shown(heading), NAME_WIDTH, break_on_hyphens=False) if headed else ""
        values = [column.shown(value) for column, value in zip(figures.columns, row, strict=True)][headed:]
        table.add_column(words, justify="right", min_width=max(map(len, (*values, *words.split()))), overflow="fold")
    table.add_column("")
    if not headed:
        table.add_column("", style="dim")
    for column, values in lines[headed:]:
        unit = column.shown_unit or readable_unit(column.unit)
        table.add_row(column.title, *map(column.shown, values), unit, *([] if headed else [column.meaning]))
    return table


def print_figures(figures: Figures) -> None:
    """Print tables and sentences in their order."""
    console = terminal()
    for item in figures:
        if isinstance(item, Sentence):
            words = styled(item.style, item.beginning, item.words)
            console.print(words, highlight=False, soft_wrap=not console.is_terminal)  # whole lines for other programs
        elif item.layout != "file":
            if item.title:
                console.print(styled("bold", item.title, item.subtitle))
            console.print(table_of_rows(item) if item.layout == "rows" else table_of_columns(item))


FIGURE_SUFFIXES = (".png", ".svg", ".pdf")
"""Suffixes of figures."""


def check_file(file: Path | None, *suffixes: str) -> None:
    """Check before a computation that a file can be written.

    Raises:
        ConfigurationError: a suffix other than these, or a folder that cannot be written to.
    """
    from dualwinch.config.folders import check_place
    from dualwinch.model.arguments import suffix_of

    if file is not None:
        suffix_of(file, suffixes)
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


NOTES: ContextVar[list[str] | None] = ContextVar("NOTES", default=None)
"""Notes of the running command, which every JSON has as well; None outside a command."""


def print_remarks(remarks: Iterable[str], *, stderr: bool = False) -> None:
    """Print remarks, a line each; empty ones are none."""
    for words in filter(None, remarks):
        terminal(stderr=stderr, soft_wrap=True).print(styled("yellow", "note", f": {words}"))


def note(*words: str) -> None:
    """Print notes on standard error, and keep them for the command's JSON (`json_text`)."""
    print_remarks(words, stderr=True)
    if (notes := NOTES.get()) is not None:
        notes += filter(None, words)


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
    """A mapping as JSON, with the command's notes among its own."""
    from dualwinch.model.quantities.figures import plain

    if notes := NOTES.get():
        facts = {**facts, "notes": [*facts.get("notes", ()), *notes]}
    return json.dumps(plain(facts), indent=1, allow_nan=False) + "\n"


def print_json(facts: Mapping[str, Any]) -> None:
    """Print a mapping as JSON."""
    sys.stdout.write(json_text(facts))


def print_idealisations(idealisations: "Sequence[Idealisation]") -> None:
    """Print a plant's idealisations in one line, if any."""
    from dualwinch.analysis.idealisations import summary

    if words := summary(idealisations):
        terminal(soft_wrap=True).print(words, highlight=False)


def print_run(
    facts: Mapping[str, Any], figures: Figures, remarks: Iterable[str], experiment: "Experiment", *, json: bool
) -> None:
    """Print figures of a run or an ensemble, remarks, and the plant's idealisations; or all of it as JSON."""
    from dualwinch.analysis.idealisations import idealisations

    remarks, simplifications = list(remarks), idealisations(experiment)
    if json:
        tables = [item for item in figures if isinstance(item, FigureTable)]
        units = {name: unit for table in tables for name, unit in table.to_record()["units"].items()}
        idealised = list(map(asdict, simplifications))
        print_json({**facts, "remarks": remarks, "idealisations": idealised, "units": units | facts.get("units", {})})
        return
    print_figures(figures)
    print_remarks(remarks)
    print_idealisations(simplifications)


def print_result(result: "Result", typed: str = "", *, json: bool, loop: bool = True, **further: Any) -> None:
    """Print outcome, figures of merit and remarks of a run; commands in remarks have the options `typed`.

    With `json` the output is JSON with `further` facts; without `loop` there are no remarks on the control loop.
    """
    from dualwinch.analysis.remarks import in_full, remarks
    from dualwinch.simulation.loop.structure import is_automatic, solver_of

    columns = [FigureColumn.of(name, quantity, ".6g") for name, quantity in result.metrics.quantities.items()]
    table = FigureTable("metrics", columns, [list(dict(result.metrics).values())], layout="columns")
    kind, solver = result.experiment.controller.law.kind, solver_of(result.experiment)
    facts = {"outcome": result.outcome, "end_time": result.end_time, "law": kind, "solver": str(solver)}
    facts |= {"metrics": dict(result.metrics), "units": {"end_time": "s"}} | further
    words = f" ({solver})" if is_automatic(result.experiment) else ""
    figures = [Sentence(f": {result.outcome} at {result.end_time:g} s{words}", kind), table]
    notes = (in_full(words, typed) for words in remarks(result, loop=loop))
    print_run(facts, figures, notes, result.experiment, json=json)


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
