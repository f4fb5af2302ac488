"""Run the plant's model exchange by FMPy's CVode and print how far it is from co-simulation, by tolerance."""

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import put
from dualwinch.simulation.paper import case
from dualwinch.toolboxes.fmu.export import export_fmu

TORQUES, DURATION = {"tau_1": 60.0, "tau_2": 20.0}, 10.0
"""Held for so many seconds: the vehicle moves off, both ropes stay taut."""

TOLERANCES, INTERVALS = (None, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10), (0.1, 0.01, 0.001)
"""Relative tolerances, None: what the description proposes; seconds between two outputs."""


def run(path: Path, kind: str, **settings: Any) -> Any:
    """Position and tensions by FMPy."""
    import fmpy

    return fmpy.simulate_fmu(
        str(path), fmi_type=kind, stop_time=DURATION, start_values=TORQUES, output=["x", "F1", "F2"], **settings
    )


def cell(path: Path, exact: Any, tolerance: float | None, interval: float) -> str:
    """Largest differences in position and tension, or that the solver gives up."""
    try:
        found = run(path, "ModelExchange", relative_tolerance=tolerance, output_interval=interval)
    except RuntimeError as error:
        return "mxstep" if "mxstep" in str(error) else "gives up"
    same = exact[:: round(interval / 1e-3)][: len(found)]
    x, *forces = (float(np.abs(found[name] - same[name]).max()) for name in ("x", "F1", "F2"))
    return f"{x:.0e} m, {max(forces):.1g} N"


def table() -> str:
    """All tolerances and intervals, in Markdown."""
    headings = ["relative tolerance", *(f"output every {interval:g} s" for interval in INTERVALS)]
    lines = [f"| {' | '.join(headings)} |", "|---|" + "---|" * len(INTERVALS)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plant.fmu"
        export_fmu(case(4), path, block="plant")
        exact = run(path, "CoSimulation", step_size=1e-3, output_interval=1e-3)
        for tolerance in TOLERANCES:
            cells = [cell(path, exact, tolerance, interval) for interval in INTERVALS]
            lines.append(f"| {'as proposed' if tolerance is None else f'{tolerance:g}'} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.importers.solvers", description=__doc__)
    parser.add_argument("--write", type=Path, metavar="FILE", help="put the table between the marks of a document")
    chosen = parser.parse_args()
    text = table()
    print(text)
    if chosen.write:
        put(chosen.write, "solvers", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
