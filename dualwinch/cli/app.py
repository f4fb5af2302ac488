"""The application: all commands, and each failure as one line with an exit code."""

import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import is_dataclass
from inspect import cleandoc, signature
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

from cyclopts import App, CycloptsError, Parameter

from dualwinch import __version__, extensions
from dualwinch.cli.certify import certify
from dualwinch.cli.compare import compare
from dualwinch.cli.config import config
from dualwinch.cli.doctor import doctor
from dualwinch.cli.export import export
from dualwinch.cli.linearise import linearise
from dualwinch.cli.output import NOTES
from dualwinch.cli.preload import preload
from dualwinch.cli.sensitivities import sensitivities
from dualwinch.cli.simulate import simulate
from dualwinch.cli.sweep import sweep
from dualwinch.cli.tune import tune
from dualwinch.codegen.files import WRITTEN

DONE, FAILED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 128 + signal.SIGINT
"""Exit codes; that of an interrupt as shells have it."""

app = App(
    name="dualwinch",
    help="""Control of a vehicle towed by two winches: simulate, analyse, tune gains, export code.

Start with a single run:

    dualwinch simulate --case 4 --plot run.png
    dualwinch simulate --case 4 --set controller.observer.l0=20 --out run.csv
    dualwinch config --case 4 > my.toml && dualwinch simulate --config my.toml

`dualwinch --install-completion` makes the Tab key complete commands and options (bash, zsh, fish).
Add `--traceback` to any command to see where in the program a failure occurred.
""",
    help_format="plaintext",
    version=__version__,
    version_flags=["--version"],
    suppress_keyboard_interrupt=False,
)

KERNEL_COMMANDS: dict[str, Any] = {
    "simulate": simulate,
    "sweep": sweep,
    "sensitivities": sensitivities,
    "linearise": linearise,
    "compare": compare,
    "tune": tune,
    "preload": preload,
    "config": config,
    "certify": certify,
    "export": export,
    "doctor": doctor,
}
"""The kernel's commands, in the order of the help: name and function, or application."""


def _take_help(command: App) -> None:
    """Take the help of a command, of its options and its examples from docstrings, and let no option have a negative.

    Each paragraph and each argument gets one line, which the terminal wraps.
    """
    command.default_parameter = Parameter(negative=())
    if not (function := command.default_command):
        return
    groups = (type(each.default) for each in signature(function).parameters.values() if is_dataclass(each.default))
    for documented in (function, *groups):
        text, _, examples = cleandoc(documented.__doc__ or "").partition("\n\nExamples:\n")
        documented.__doc__ = re.sub(r"(?<!\n)\n(?!\n| {4}\S) *", " ", text)
        if examples:
            command.help_epilogue = f"Examples:\n\n{examples}\n"


COMMANDS = KERNEL_COMMANDS | {entry.name: entry.load() for entry in extensions.extensions(extensions.COMMANDS)}
"""Every command by its name, in the order of the help."""

for entry in extensions.extensions(extensions.EXPORTS):
    export.command(entry.load(), name=entry.name)

for name, command in COMMANDS.items():
    application = command if isinstance(command, App) else App(name=name, default_command=command)
    application.group = "Commands" if name in KERNEL_COMMANDS else "Toolboxes"
    app.command(application)
    for subcommand in (application, *(application[below] for below in application if not below.startswith("-"))):
        _take_help(subcommand)


app.register_install_completion_command()

TRACEBACK = "--traceback"
"""Option of every command: print the traceback of an unforeseen failure instead of writing it to a file."""


def _say(kind: str, message: object) -> None:
    from dualwinch.codegen.text import shortened, without_secrets

    sys.stderr.write(f"dualwinch: {kind}: {shortened(without_secrets(str(message)))}\n")
    sys.stderr.flush()


def _fail(message: object, code: int) -> NoReturn:
    _say("error", message)
    raise SystemExit(code)


@contextmanager
def _warnings_in_a_line() -> Iterator[None]:
    """Print each warning in one line, without its place in the program."""
    before, warnings.showwarning = warnings.showwarning, lambda message, *_: _say("warning", message)
    try:
        yield
    finally:
        warnings.showwarning = before


class _Output(io.FileIO):
    """A standard stream that goes to the null device once its reader has ended, as ``head`` does: the work goes on."""

    def write(self, data: Any) -> int | None:
        """Write some bytes; return their number."""
        try:
            return super().write(data)
        except BrokenPipeError:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.fileno())
            os.close(null)
            return len(data)


def _open_streams() -> None:
    """Give a closed standard stream (``>&-``) the null device, whose place the next opened file would take.

    Pipes get an `_Output`.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        stream = getattr(sys, name)
        raw = getattr(stream.buffer, "raw", stream.buffer) if isinstance(stream, io.TextIOWrapper) else None
        if stream is None:
            descriptor = os.open(os.devnull, os.O_RDWR)
            if descriptor != number:
                os.dup2(descriptor, number)
                os.close(descriptor)
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8"))
        elif number and type(raw) is io.FileIO and not stream.isatty():
            output = _Output(stream.fileno(), "w", closefd=False)
            replacement = io.TextIOWrapper(
                output if raw is stream.buffer else io.BufferedWriter(output),  # PYTHONUNBUFFERED: no buffer
                stream.encoding,
                stream.errors,
                line_buffering=stream.line_buffering,
                write_through=stream.write_through,
            )
            setattr(sys, name, replacement)


def _check_text(words: list[str]) -> None:
    """Refuse words that are not UTF-8; make the output escape characters that the terminal cannot show.

    Files and pipes take UTF-8 whatever the terminal takes, as TOML and JSON must be.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if isinstance(sys.stdout, io.TextIOWrapper) and not sys.stdout.isatty():
        sys.stdout.reconfigure(encoding="utf-8")
    for word in words:
        # surrogates stand for undecodable bytes in a file name, and a NUL would end it
        if any("\ud800" <= letter <= "\udfff" or letter == "\0" for letter in word):
            _fail(f"{word!a}: must be UTF-8 text", WRONG_INPUT)


PATHS = ("out", "plot", "animate", "map", "config", "ensemble", "disturbance", "checkpoint", "storage", "plugin")
"""Names of the options that take a path, or a name that may be one."""


def _check_paths(words: list[str]) -> None:
    """Refuse empty paths, which would mean the current folder."""
    for before, word in pairwise(["", *words]):
        option, equals, value = word.partition("=") if word else (before, "=", "")
        if equals and not value and option.removeprefix("--") in PATHS:
            _fail(f"{option}: must not be empty", WRONG_INPUT)
        if not word and not before.startswith("-"):
            _fail("an argument: must not be empty", WRONG_INPUT)


def _unforeseen(error: Exception, *, printed: bool) -> str:
    """Print a failure's traceback, or write it to a new file that only its owner can read; return the message.

    Neither contains the command line, which may hold passwords.
    """
    import platform
    import tempfile
    import traceback

    from dualwinch.codegen.text import without_secrets

    where = f"dualwinch {__version__}, Python {platform.python_version()}, {platform.platform()}\n"
    text = without_secrets(where + "".join(traceback.format_exception(error)))
    what = f"unforeseen {type(error).__name__}: {error}"
    if printed:
        sys.stderr.write(text)
        return what
    try:
        descriptor, path = tempfile.mkstemp(prefix="dualwinch-traceback-", suffix=".txt")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return f"{what}; a fault of dualwinch, please report it with the output of --traceback"
    return f"{what}; a fault of dualwinch, please report it with {path} to your supplier of dualwinch"


def _kept(written: list[Path]) -> str:
    """What an interrupted command leaves behind."""
    if not written:
        return "nothing was written"
    remainder = f" and {len(written) - 1} more" if len(written) > 1 else ""
    return f"{written[0]}{remainder} had been written before, and {'are' if remainder else 'is'} complete"


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; every failure is one line on standard error.

    Args:
        arguments: words of the command line; default: those of the process.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    # commands have threads of their own; those of linear algebra with matrices this small only wait, by spinning
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _open_streams()
    _check_text(words)
    _check_paths(words)
    written: list[Path] = []
    WRITTEN.set(written)
    NOTES.set([])
    try:
        command = [word for word in words if word != TRACEBACK]
        with _warnings_in_a_line():
            app(command, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except CycloptsError as error:
        _fail(str(error), WRONG_INPUT)
    except KeyboardInterrupt as error:
        _fail(f"interrupted; {error if error.args else _kept(written)}", INTERRUPTED)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}", FAILED)
    except Exception as error:  # noqa: BLE001  # an unforeseen failure is one line, too
        from dualwinch.codegen.errors import DualwinchError
        from dualwinch.model.errors import ConfigurationError

        if not isinstance(error, DualwinchError):
            _fail(_unforeseen(error, printed=TRACEBACK in words), FAILED)
        _fail(error, WRONG_INPUT if isinstance(error, ConfigurationError) else FAILED)
