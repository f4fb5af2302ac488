"""A call of the command line that nobody means well, and what must hold of it whatever its words are."""

import contextlib
import faulthandler
import io
import json
import re
import signal
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck

from dualwinch.cli import main
from dualwinch.cli.app import TRACEBACK

PATIENCE = 240
"""Time in s after which a call hangs: hundreds of times what the slowest takes on a machine that is not busy."""

SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large]
"""What Hypothesis need not complain of."""

WIDEST, MOST_LINES = 1600, 60
"""Characters of a line and lines of what is said on standard error: about a screen."""


class HangsError(BaseException):
    """A call that does not end; no `Exception`, so that nobody catches it on its way."""


@dataclass(frozen=True)
class Answer:
    """What a call came to.

    Attributes:
        code: exit code.
        error: what it said on standard error.
        new: files that were not there before.
    """

    code: int
    error: str
    new: tuple[Path, ...]


def call(words: Sequence[str], folder: Path) -> Answer:
    """Call the command line in this process.

    Args:
        words: of the command line.
        folder: where it is called; what it writes is removed again.
    """
    before = set(folder.rglob("*"))
    output, error = io.StringIO(), io.StringIO()
    with watchdog(), contextlib.chdir(folder), contextlib.redirect_stdout(output), contextlib.redirect_stderr(error):
        try:
            main([*words, TRACEBACK])
            code: Any = 0
        except SystemExit as ended:
            code = 0 if ended.code is None else ended.code
    new = sorted(set(folder.rglob("*")) - before, reverse=True)
    answer = Answer(code, error.getvalue(), tuple(new))
    try:
        check(answer)
    finally:
        for path in new:
            path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
    return answer


def check(answer: Answer) -> None:
    """What holds of every call."""
    said = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", answer.error)
    assert "Traceback" not in said, said
    assert "unforeseen" not in said, said
    assert answer.code in {0, 1, 2}, answer
    lines = said.splitlines()
    assert all(len(line) <= WIDEST for line in lines), said
    assert len(lines) <= MOST_LINES, said
    if answer.code:
        assert lines[-1].startswith("dualwinch: error: "), said
    if answer.code == 2:
        assert not answer.new, f"refused ({lines[-1]}), and left {answer.new}"
    for path in answer.new:
        assert not path.name.startswith("."), f"left {path}"
        whole(path)


def whole(path: Path) -> None:
    """Fail where a file is not what its name says."""
    if path.is_dir():
        return
    assert path.suffix == ".journal" or path.stat().st_size, f"{path} is empty"
    if path.suffix == ".json":
        json.loads(path.read_text(encoding="utf-8"))
    elif path.suffix == ".toml":
        tomllib.loads(path.read_text(encoding="utf-8"))
    elif path.suffix == ".html":
        assert "</html>" in path.read_text(encoding="utf-8")


@contextlib.contextmanager
def watchdog() -> Iterator[None]:
    """Raise `HangsError` where something takes too long; end the process where it does not even notice that."""

    def bark(*_: object) -> None:
        raise HangsError

    before = signal.signal(signal.SIGALRM, bark)
    signal.alarm(PATIENCE)
    faulthandler.dump_traceback_later(3 * PATIENCE, exit=True)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        faulthandler.cancel_dump_traceback_later()
