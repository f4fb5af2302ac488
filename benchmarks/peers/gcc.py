"""gcc as the peers use it: ``-O3 -march=native``, no fast-math."""

import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from benchmarks.peers.peer import UnavailableError

MARCH = "BENCHMARKS_MARCH"
"""Environment variable: processor that peers are compiled for, in place of this one (`benchmarks.vector_width`)."""

FLAGS = ("-O3", f"-march={os.environ.get(MARCH, 'native')}", "-fPIC", "-shared")
"""Flags of every peer that gcc compiles."""


def find() -> str:
    """The path of gcc.

    Raises:
        UnavailableError: there is none.
    """
    gcc = shutil.which("gcc")
    if gcc is None:
        raise UnavailableError("gcc is not installed")
    return gcc


@cache
def version() -> str:
    """The first line gcc says of itself."""
    answer = subprocess.run([find(), "--version"], capture_output=True, text=True, check=True)
    return answer.stdout.splitlines()[0]


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="benchmarks-")


def build(source: Path) -> Path:
    """Compile one C file to a shared library that lives as long as this process.

    Raises:
        UnavailableError: gcc is missing or fails.
    """
    library = workplace() / f"{source.stem}.so"
    command = [find(), *FLAGS, str(source), "-o", str(library), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        complaint = next(iter(done.stderr.strip().splitlines()), "no message")
        raise UnavailableError(f"gcc failed on {source.name}: {complaint}")
    return library


def workplace() -> Path:
    """A folder for generated sources and libraries, removed when this process ends."""
    return Path(_folder().name)
