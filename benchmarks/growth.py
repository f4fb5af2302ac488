"""How dualwinch's time grows with the length of a run, the number of rollouts in a call, and threads.

``python -m benchmarks.growth`` prints the table; ``--write FILE`` puts it between the file's two marks, ``--plot FILE``
draws the figure.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.case import Case
from benchmarks.document import duration, markdown, put
from benchmarks.growth_point import Point
from benchmarks.peers import compiled, hand_c
from benchmarks.peers.candidates import GAIN
from benchmarks.peers.peer import UnavailableError
from dualwinch.codegen.drivers.batch import LANES
from dualwinch.codegen.errors import DualwinchError
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.batch.workers import cores
from dualwinch.simulation.experiment import Simulation

HORIZONS = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
"""Lengths of a single run in s."""

CANDIDATES = tuple(sorted({1, 2, 4, 8, *(LANES * factor for factor in (1, 2, 4, 8, 16))}))
"""Rollouts in one call, on one thread; up to LANES they share one block of vector lanes."""

DURATION = 50.0
"""Length of the runs of the other series in s."""

MANY = 8 * LANES
"""Rollouts in one call where the threads differ."""


def _case(length: float) -> Case:
    default = Simulation()
    return Case(length, default.integrator, default.substeps)


def _batch(case: Case, count: int, threads: int) -> Callable[[], object]:
    gains = case.named_parameters[GAIN] * np.linspace(1, 2, count)[:, None]
    return lambda: rollout([GAIN], gains, [case.experiment], workers=threads)


def points() -> list[Point]:
    """Every setting, ready to be timed."""
    case, found = _case(DURATION), []
    for length in HORIZONS:
        found.append(Point("horizon", length, 1, compiled.prepare_call(_case(length))))
        try:
            found.append(Point("hand C, horizon", length, 1, hand_c.prepare_with("hand_adaptive")(_case(length))))
        except UnavailableError as missing:
            print(f"hand-written C: {missing}", file=sys.stderr)
    found += [Point("candidates", count, count, _batch(case, count, 1)) for count in CANDIDATES]
    found += [Point("threads", threads, MANY, _batch(case, MANY, threads)) for threads in range(1, cores() + 1)]
    return found


def measure(found: list[Point], rounds: int, say: Callable[[str], None]) -> None:
    """Time every point once a round, in turn, after one call that is not counted."""
    for number in range(rounds + 1):
        say(f"round {number} of {rounds}")
        for point in found:
            begin = time.perf_counter()
            point.call()
            if number:
                point.seconds.append(time.perf_counter() - begin)


def rows(found: list[Point]) -> list[list[str]]:
    """The table's rows: series, value, time of a call, a rollout's share, and simulated over real time."""
    words = {
        "horizon": "one rollout, C call alone, of {:g} s",
        "hand C, horizon": "hand-written C, one rollout of {:g} s",
        "candidates": f"rollouts of {DURATION:g} s in one call, 1 thread: {{:g}}",
        "threads": f"{MANY} rollouts of {DURATION:g} s in one call, threads: {{:g}}",
    }
    table = []
    for point in sorted(found, key=lambda point: list(words).index(point.series)):
        length = point.value if "horizon" in point.series else DURATION
        share = point.middle / point.rollouts
        speed = f"{length / share:,.0f}".replace(",", " ")
        table.append([words[point.series].format(point.value), duration(point.middle), duration(share), f"{speed} ×"])
    return table


def main() -> int:
    """Measure, print, write, draw; 1 where it cannot."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, metavar="N", help="times each setting is timed (7)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document with the marks of `growth`")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="figure: .svg, .png or .pdf")
    chosen = parser.parse_args()
    if chosen.rounds < 1:
        parser.error(f"--rounds {chosen.rounds}: must be >= 1")

    from rich.console import Console

    from benchmarks.report import machine

    try:
        with Console(stderr=True).status("compiling") as status:
            found = points()
            measure(found, chosen.rounds, status.update)
        headings = ["what", "a call", "a rollout's share", "faster than real time"]
        facts = " · ".join(f"{name}: {value}" for name, value in machine().items())
        table = f"{markdown(headings, rows(found))}\n\n*{facts}*"
        print(table)
        if chosen.write:
            put(chosen.write, "growth", table)
        if chosen.plot:
            from benchmarks.growth_figure import growth_figure
            from dualwinch.simulation.plots.page import save

            save(growth_figure(found), chosen.plot)
    except (DualwinchError, UnavailableError, OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
