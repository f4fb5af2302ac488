"""How long the first result takes: with nothing compiled yet (cold, by gcc and by zig), and from the cache (warm).

``python -m benchmarks.startup`` prints the table; ``--write FILE`` puts it between the file's two marks. Every number
comes from processes of their own, with cache folders of their own.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from statistics import median

COMPILERS = ("gcc", "zig")

STAGES = ("import", "symbolic", "generate", "find compiler", "library")
"""What a process does before its first result; `library` compiles where cold, and looks up where warm."""

COLUMNS = (
    "cold: generate + compile",
    "cold: process to first result",
    "warm: process to first result",
    "warm: of which look-up",
    "cold: process to first batch",
    "warm: process to first batch",
)


def child(kind: str) -> None:
    """In a process of its own: the stages of one compilation as JSON, or a first result."""
    marks = [time.perf_counter()]

    def mark() -> None:
        marks.append(time.perf_counter())

    from dualwinch.simulation.batch.rollout import rollout
    from dualwinch.simulation.paper import case
    from dualwinch.simulation.simulate import simulate

    if kind == "run":
        simulate(case(4), stride=0)
        return
    if kind == "batch":
        rollout(["controller.observer.l0"], [[5.0]], [case(4)])
        return
    from dualwinch.codegen.cache import library
    from dualwinch.codegen.compiler import find_compiler
    from dualwinch.codegen.drivers.rollout import rollout_source
    from dualwinch.simulation.loop.closed_loop import closed_loop
    from dualwinch.simulation.loop.structure import parameters_of, structure_of, zeros_of

    mark()
    structure = structure_of(case(4))
    loop = closed_loop(structure, zeros_of(structure, parameters_of(case(4))))
    mark()
    source = rollout_source(loop)
    mark()
    compiler = find_compiler()
    mark()
    library(source, compiler)
    mark()
    seconds = [later - earlier for earlier, later in pairwise(marks)]
    print(json.dumps(dict(zip(STAGES, seconds, strict=True))))


def _process(kind: str, compiler: str, cache: str) -> tuple[float, str]:
    """Wall time in s of a process and what it printed."""
    environment = os.environ | {"DUALWINCH_CC": compiler, "DUALWINCH_CACHE_DIR": cache}
    command = [sys.executable, "-m", "benchmarks.startup", "--child", kind]
    begin = time.perf_counter()
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begin
    if done.returncode:
        raise RuntimeError(next(reversed(done.stderr.strip().splitlines()), "no message"))
    return seconds, done.stdout


def measure(compiler: str, rounds: int) -> list[float]:
    """Medians in s of `COLUMNS`.

    Raises:
        RuntimeError: a process failed, e.g. for want of the compiler.
    """
    found: list[list[float]] = []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory(prefix="startup-") as folder:
            caches = {kind: f"{folder}/{kind}" for kind in ("stages", "run", "batch")}
            stages = json.loads(_process("stages", compiler, caches["stages"])[1])
            cold = {kind: _process(kind, compiler, caches[kind])[0] for kind in ("run", "batch")}
            warm = {kind: _process(kind, compiler, caches[kind])[0] for kind in ("run", "batch")}
            looked_up = json.loads(_process("stages", compiler, caches["stages"])[1])["library"]
        compiled = stages["symbolic"] + stages["generate"] + stages["find compiler"] + stages["library"]
        found.append([compiled, cold["run"], warm["run"], looked_up, cold["batch"], warm["batch"]])
    return [median(column) for column in zip(*found, strict=True)]


def main() -> int:
    """Measure, print, write; 1 where no compiler worked or the document cannot be written."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.startup", description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, metavar="N", help="times everything is done (3)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document with the marks of `startup`")
    parser.add_argument("--child", choices=("stages", "run", "batch"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.child:
        child(chosen.child)
        return 0
    if chosen.rounds < 1:
        parser.error(f"--rounds {chosen.rounds}: must be >= 1")

    from rich.console import Console

    from benchmarks.document import duration, markdown, put

    rows, worked = [], 0
    for compiler in COMPILERS:
        try:
            with Console(stderr=True).status(f"starting processes, {compiler}"):
                rows.append([compiler, *map(duration, measure(compiler, chosen.rounds))])
            worked += 1
        except RuntimeError as error:
            rows.append([f"{compiler}: {error}", *("–" for _ in COLUMNS)])
    table = markdown(["compiler", *COLUMNS], rows)
    print(table)
    try:
        if chosen.write:
            put(chosen.write, "startup", table)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0 if worked else 1


if __name__ == "__main__":
    sys.exit(main())
