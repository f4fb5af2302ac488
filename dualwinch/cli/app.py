"""The application: every command, and failures as one line with an exit code."""

import os
import signal
import sys
from typing import NoReturn

from cyclopts import App, CycloptsError

from dualwinch import __version__
from dualwinch.cli import (
    certify,
    compare,
    config,
    doctor,
    export,
    linearise,
    preload,
    race,
    reproduce,
    simulate,
    stress,
    sweep,
    tune,
    worker,
)

DONE, FAILED, WRONG_INPUT = 0, 1, 2
"""Exit codes."""

app = App(
    name="dualwinch",
    help="""Control of a vehicle towed by two winches: simulate, reproduce the paper, generate compiled code.

Start with `dualwinch reproduce`, or look at one run:

    dualwinch simulate --case 4 --plot run.png
    dualwinch simulate --case 4 --set controller.observer.l0=20 --out run.csv
    dualwinch config --case 4 > my.toml && dualwinch simulate --config my.toml
""",
    help_format="markdown",
    version=__version__,
    version_flags=["--version"],
    suppress_keyboard_interrupt=False,
)

COMMANDS = (
    reproduce,
    simulate,
    sweep,
    linearise,
    compare,
    tune,
    race,
    stress,
    preload,
    worker,
    config,
    certify,
    export,
    doctor,
)
"""In the order of the help."""

for module in COMMANDS:
    app.command(module.app)


def _fail(message: object, code: int) -> NoReturn:
    text = " ".join(str(message).split())
    sys.stderr.write(f"dualwinch: error: {text}\n")
    sys.stderr.flush()
    raise SystemExit(code)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; every failure is one line on standard error.

    Args:
        arguments: default: those of the process.
    """
    try:
        app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except CycloptsError as error:
        _fail(str(error), WRONG_INPUT)
    except KeyboardInterrupt:
        _fail("interrupted; files already written are complete", FAILED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(128 + signal.SIGPIPE) from None
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}", FAILED)
    except Exception as error:
        from dualwinch.codegen.errors import DualwinchError
        from dualwinch.model.errors import ConfigurationError

        if not isinstance(error, DualwinchError):
            raise
        _fail(error, WRONG_INPUT if isinstance(error, ConfigurationError) else FAILED)
