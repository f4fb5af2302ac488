"""The table and its JSON."""

import json
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks import limits
from benchmarks.document import markdown, put
from benchmarks.measure import TOLERANCE, Timing
from benchmarks.peers import ADAPTIVE_LIMIT, DEFAULT, LIMIT, OURS, gcc
from benchmarks.peers.peer import UnavailableError
from dualwinch.codegen.compiler import find_compiler, processor_name, vector_features
from dualwinch.simulation.batch.workers import cores

NARROWEST = 120
"""Columns the table takes where the output is no terminal."""


def machine() -> dict[str, str]:
    """Processor, compilers and versions."""
    try:
        gcc_version = f"{gcc.version()} {' '.join(gcc.FLAGS)}"
    except UnavailableError:
        gcc_version = "none"
    facts = {
        "processor": processor_name(),
        "vector instructions": ", ".join(vector_features()) or "none known",
        "system": f"{platform.system()} {platform.machine()}",
        "dualwinch's compiler": find_compiler().version,
        "gcc": gcc_version,
        "Python": platform.python_version(),
    }
    for package in ("casadi", "numpy", "scipy", "numba", "jax", "diffrax", "archimedes"):
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "none"
    return facts


def as_json(timings: list[Timing], duration: float) -> dict[str, Any]:
    """Everything that was measured."""
    return {
        "rollout": {"case": 4, "controller": "fando-nftsm", "duration_s": duration, "tolerance_m": TOLERANCE},
        "machine": machine(),
        "peers": [
            {
                "key": timing.peer.key,
                "title": timing.peer.title,
                "integrator": timing.peer.case.integrator,
                "substeps": timing.peer.case.substeps,
                "missing": timing.missing,
                "median_s": timing.middle if timing.seconds else None,
                "seconds": timing.seconds,
                "deviation_m": None if timing.missing else timing.deviation,
            }
            for timing in timings
        ],
    }


def write_json(file: Path, timings: list[Timing], duration: float) -> None:
    """Write `as_json` to a file."""
    file.write_text(json.dumps(as_json(timings, duration), indent=2) + "\n")


def _headings_and_rows(timings: list[Timing]) -> tuple[list[str], list[list[str]]]:
    by_key = {timing.peer.key: timing for timing in timings if timing.seconds}
    yardsticks = {"hand C": LIMIT, "hand C, adaptive": ADAPTIVE_LIMIT, "dualwinch": OURS, "its default": DEFAULT}
    yardsticks = {name: by_key[key].middle for name, key in yardsticks.items() if key in by_key}
    rows = []
    for timing in timings:
        if not timing.seconds:
            rows.append([f"{timing.peer.title}: {timing.missing}"])
            continue
        extent = f"{_duration(min(timing.seconds))} – {_duration(max(timing.seconds))}"
        ratios = [f"{timing.middle / yardstick:.3g}" for yardstick in yardsticks.values()]
        rows.append([timing.peer.title, _duration(timing.middle), extent, str(len(timing.seconds)), *ratios])
    return ["peer", "median", "range", "n", *(f"time over {name}" for name in yardsticks)], rows


def write_markdown(file: Path, timings: list[Timing]) -> None:
    """Put the table and the machine's description between the two marks of a file."""
    headings, rows = _headings_and_rows(timings)
    facts = " · ".join(f"{name}: {value}" for name, value in machine().items())
    put(file, "table", f"{markdown(headings, rows)}\n\n*{facts}*")
    put(file, "limits", markdown(limits.HEADINGS, limits.rows(timings, cores())))


def show(timings: list[Timing], duration: float) -> None:
    """Print the table."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=NARROWEST)
    headings, rows = _headings_and_rows(timings)
    table = Table(
        title=f"One rollout of Case 4: FANDO-NFTSM, {duration:g} s at 1 kHz; RK4 × 4 where no other is named",
        caption=(
            "median over n interleaved rounds; range from fastest to slowest; "
            f"every peer's positions equal dualwinch's within {TOLERANCE:g} m over the whole run"
        ),
    )
    for heading in headings:
        table.add_column(heading.replace("over ", "over\n"), justify="left" if heading == "peer" else "right")
    for row in rows:
        table.add_row(*row)
    console.print(" · ".join(f"{name}: {value}" for name, value in machine().items()), highlight=False)
    console.print(table)
    reached = Table(title="Rates, and what they are to reach (positions apart from what a row is checked against)")
    for heading in limits.HEADINGS:
        reached.add_column(heading)
    for row in limits.rows(timings, cores()):
        reached.add_row(*row)
    console.print(reached)


def _duration(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 1 else f"{seconds * 1e3:.1f} ms"
