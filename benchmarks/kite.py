"""What a public flight log says of its tether.

TU Delft's kite of 8 October 2019 (github.com/awegroup/Flightdata08102019, CC BY 4.0): ``python -m benchmarks.kite DIR``
reads the cycles (.csv) in a folder and prints a column for each. Beside what is in a cycle stands what a tether's
stiffness could show in it, and what a regression makes of it.
"""

import sys
from pathlib import Path

import numpy as np

from benchmarks.document import command, markdown, put
from dualwinch.model.errors import ConfigurationError
from dualwinch.toolboxes.identification.log import read_columns

GRAVITY = 9.81
"""m/s²: the log has forces in kilograms-force."""

STIFFNESS = 1e11 * np.pi * 0.005**2
"""N: modulus times cross-section of a Dyneema tether 10 mm thick."""

WINDOW = 51
"""Samples, of 0.1 s, of the moving mean that is taken away: what is slower is drift."""

HEADINGS = (
    "samples", "tether force (N)", "stretch that this range can make (m)", "distance less reeled length, scatter (m)",
    "stiffness found / of Dyneema", "share of the scatter that it explains",
    "correlation of force and speed, reeling out begins",
)  # fmt: skip


QUOTED = (4, 10)
"""Cycles, counted from one in the order of their files, that a document shows."""


def facts(file: Path) -> list[str]:
    """What a cycle says, in the order of `HEADINGS`.

    Raises:
        ConfigurationError: the file cannot be read, or lacks a column.
    """
    columns = {column.name: column.values for column in read_columns(file)}
    try:
        t, speed, distance = (columns[name] for name in ("time", "ground_tether_reelout_speed", "kite_distance"))
        force, phase = GRAVITY * columns["ground_tether_force"], columns["phase"]
    except KeyError as error:
        raise ConfigurationError(f"{file}: no column {error}") from None
    reeled = np.concatenate([[0.0], np.cumsum(np.diff(t) * (speed[1:] + speed[:-1]) / 2)])
    seen, strained = _quick(distance - reeled), _quick(force * distance)
    compliance = float(seen @ strained / (strained @ strained))
    left = seen - compliance * strained
    begins = phase == 1
    return [
        f"{len(t)}",
        f"{force.min():.0f} to {force.max():.0f}",
        f"{np.ptp(force) * distance.mean() / STIFFNESS:.2f}",
        f"{seen.std():.2f}",
        f"{1 / compliance / STIFFNESS:.3f}",
        f"{1 - float(left @ left) / float(seen @ seen):.0%}",
        f"{np.corrcoef(force[begins], speed[begins])[0, 1]:.3f}" if begins.sum() > 2 else "",
    ]


def _quick(values: np.ndarray) -> np.ndarray:
    """What is quicker than the moving mean."""
    return (values - np.convolve(values, np.ones(WINDOW) / WINDOW, "same"))[WINDOW:-WINDOW]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; 0 done, 1 where there is nothing to read."""
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, help="folder with cycles")
    chosen = parser.parse_args(arguments)
    files = sorted(chosen.folder.glob("*.csv"))
    try:
        columns = [facts(file) for file in files]
    except ConfigurationError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    if not columns:
        print("error: no .csv file there", file=sys.stderr)
        return 1
    print(markdown(["", *(file.stem for file in files)], list(zip(HEADINGS, *columns, strict=True))))
    if chosen.write:
        cycles = {number: column for number, column in enumerate(columns, 1) if number in QUOTED}
        headings = ["", *(f"cycle {number}" for number in cycles)]
        put(chosen.write, "kite", markdown(headings, list(zip(HEADINGS, *cycles.values(), strict=True))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
