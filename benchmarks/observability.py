"""What each sensor tells of encoders, drums and ropes: standard deviations after ten seconds, at rest and in cruise.

The exact linear model of the plant (`dualwinch.model.linear`) is extended by unknown constants: the errors of both
encoders, a force on the vehicle and both motor torques. What so many samples tell of these and of the state at the
beginning is the observability Gramian, weighted by the sensors' noise. With the prior deviations,
its inverse is the covariance that no estimator can do better than (Cramér and Rao).

``python -m benchmarks.observability`` prints the table; ``--write FILE`` puts it between its two marks.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.document import command, markdown, publish
from dualwinch.controllers.estimators.encoder_calibration import DrumGains
from dualwinch.model.linear.linearisation import linearise_at
from dualwinch.model.linear.operating_point import operating_points
from dualwinch.model.plant import Plant
from dualwinch.model.ropes import rope_lengths

Floats = NDArray[np.float64]

SAMPLE_TIME, DURATION = 1e-2, 10.0
"""Ten samples of a real controller, whose noise is averaged, are one here; in s."""

NOISE = {"position": 6e-4, "speed": 2e-3, "tensions": 10.0, "encoders": 1e-5}
"""Standard deviation of a sample of 1 ms in m, m/s, N and m of rope, as in the ensemble ``sea``."""

ERRORS = ("zero_1", "scale_1", "excess_1", "zero_2", "scale_2", "excess_2")
PRIOR = (DrumGains.zero, DrumGains.scale, DrumGains.compliance) * 2
"""What is unknown of the encoders, and how uncertain it is before."""

CONSTANTS = {"D": 1e3, "tau_1": 5.0, "tau_2": 5.0}
STATE = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
"""Deviations of what else is unknown: forces in N, torques in N m, the state at the beginning in m, rad and s."""

ALL = tuple(NOISE)


@dataclass(frozen=True)
class Known:
    """What is known after the window.

    Attributes:
        deviations: of `ERRORS`.
        sum_of_zeros: deviation of zero_1 + zero_2 in m, which both encoders together see.
        position: deviation of the vehicle's position in m, at the window's end.
    """

    deviations: dict[str, float]
    sum_of_zeros: float
    position: float


def known_after(x: float, v: float, sensors: tuple[str, ...] = ALL) -> Known:
    """What sensors tell in the window.

    Args:
        x: position in m in its middle; the run began at x = 0.
        v: speed in m/s.
        sensors: those of `NOISE` that are there.
    """
    plant = Plant()
    (system,) = linearise_at(operating_points(x, v, 6000.0, plant), plant, SAMPLE_TIME)
    point, n = system.operating_point, len(system.states)
    held = [system.inputs.index(name) for name in CONSTANTS]
    size = n + len(CONSTANTS) + len(ERRORS)
    step = np.eye(size)
    step[:n, :n], step[:n, n : n + len(held)] = system.A, system.B[:, held]
    drums = ((1, 1.0, plant.winch_1, plant.rope_1), (2, -1.0, plant.winch_2, plant.rope_2))
    prior = np.array([*STATE, *CONSTANTS.values(), *PRIOR])
    information, passed = np.eye(size), np.eye(size)
    averaged = SAMPLE_TIME / 1e-3
    for number in range(round(DURATION / SAMPLE_TIME)):
        wound = x + v * (number * SAMPLE_TIME - DURATION / 2)
        rows: list[tuple[str, Floats]] = []
        for name, output in (("position", "x"), ("speed", "v"), ("tensions", "F1"), ("tensions", "F2")):
            row = np.zeros(size)
            row[:n] = system.C[system.outputs.index(output)]
            rows.append((name, row))
        lengths = rope_lengths(wound, plant.track)
        for drum, direction, winch, rope in drums:
            stretch = rope.resting_stretch(point[f"F{drum}"], lengths[drum - 1])
            row, first = np.zeros(size), n + len(held) + 3 * (drum - 1)
            row[system.states.index(f"theta_{drum}")] = winch.drum_radius
            row[first : first + 3] = 1.0, -direction * wound, stretch
            rows.append(("encoders", row))
        for name, row in rows:
            if name in sensors:
                seen = row @ passed * prior
                information += averaged * np.outer(seen, seen) / NOISE[name] ** 2
        passed = step @ passed
    covariance = prior[:, None] * np.linalg.inv(information) * prior
    first = n + len(held)
    at_end = passed[system.states.index("x")]
    pair = np.zeros(size)
    pair[[first, first + 3]] = 1.0
    return Known(
        dict(zip(ERRORS, np.sqrt(np.diag(covariance)[first:]).tolist(), strict=True)),
        float(np.sqrt(pair @ covariance @ pair)),
        float(np.sqrt(at_end @ covariance @ at_end)),
    )


WITHOUT_POSITION = ("speed", "tensions", "encoders")
CASES = {
    "before": (25.0, 0.0, ()),
    "rest, all sensors": (25.0, 0.0, ALL),
    "rest at x = 0, all sensors": (0.0, 0.0, ALL),
    "rest, position sensor silent": (25.0, 0.0, WITHOUT_POSITION),
    "cruise, all sensors": (25.0, 1.8, ALL),
    "cruise, position sensor silent": (25.0, 1.8, WITHOUT_POSITION),
    "cruise, position and speed alone": (25.0, 1.8, ("position", "speed")),
}
"""Rows of the table: position in m, speed in m/s, sensors."""


def table() -> str:
    """The table as Markdown."""
    rows = []
    for name, (x, v, sensors) in CASES.items():
        known = known_after(x, v, sensors)
        found = known.deviations
        numbers = (
            1e3 * found["zero_1"],
            1e3 * known.sum_of_zeros,
            1e3 * found["scale_1"],
            1e2 * found["excess_1"],
            1e3 * known.position,
        )
        rows.append([name, *(f"{number:.2g}" if number < 100 else "unknown" for number in numbers)])
    headings = ("", "zero_1 (mm)", "zero_1 + zero_2 (mm)", "scale_1 (‰)", "excess_1 (%)", "position at the end (mm)")
    return markdown(headings, rows)


def main() -> None:
    """Print or write the table."""
    publish(command(__doc__).parse_args().write, {"observability": table()})


if __name__ == "__main__":
    main()
