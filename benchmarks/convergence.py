"""How accurate each integrator is: the table of docs/accuracy.md.

``python -m benchmarks.convergence`` prints the table; ``--write FILE`` puts it between the file's two marks.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from rich.progress import track

from benchmarks.document import command, publish
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CASES, case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

SETTINGS = (
    ("adaptive", 5),
    ("adaptive", 8),
    ("exponential", 1),
    ("exponential", 2),
    ("exponential", 4),
    ("exponential", 8),
    ("rk4", 4),
    ("rk4", 8),
    ("rk4", 16),
    ("rk4", 32),
)
CONVERGED = ("exponential", 64)

PROFILES = {"Cases 1 and 3": (1, 3), "Cases 2 and 4": (2, 4)}
"""Reference that starts at full speed and slackens a rope, and the trapezoidal one: heading → cases."""


@dataclass(frozen=True)
class Line:
    """One setting: largest errors in position (m) and tension (N) by profile."""

    integrator: str
    substeps: int
    position: dict[str, float]
    tension: dict[str, float]


def with_integrator(number: int, integrator: str, substeps: int) -> Experiment:
    """A case of the paper with an integrator of one's choice."""
    return override(case(number), {"simulation.integrator": integrator, "simulation.substeps": substeps})


def errors(result: Result, converged: Result) -> tuple[float, float]:
    """Largest difference in position in m and in tension in N over a run."""
    position = np.max(np.abs(result["x"] - converged["x"]))
    tension = max(np.max(np.abs(result[rope] - converged[rope])) for rope in ("F1", "F2"))
    return float(position), float(tension)


def lines() -> Iterator[Line]:
    """Every setting over all four cases."""
    converged = {number: simulate(with_integrator(number, *CONVERGED)) for number in CASES}
    for integrator, substeps in track(SETTINGS, "integrators", transient=True):
        by_case = {
            number: errors(simulate(with_integrator(number, integrator, substeps)), converged[number])
            for number in CASES
        }
        yield Line(
            integrator,
            substeps,
            {profile: max(by_case[number][0] for number in numbers) for profile, numbers in PROFILES.items()},
            {profile: max(by_case[number][1] for number in numbers) for profile, numbers in PROFILES.items()},
        )


def markdown() -> str:
    """The table."""
    rows = [
        "| integrator | sub-steps | " + " | ".join(f"{profile}: m | N" for profile in PROFILES) + " |",
        "|---|--:|" + "--:|--:|" * len(PROFILES),
    ]
    for line in lines():
        cells = [f"{line.position[profile]:.1e} | {line.tension[profile]:.1g}" for profile in PROFILES]
        rows.append(f"| {line.integrator} | {line.substeps} | {' | '.join(cells)} |")
    return "\n".join(rows)


def main() -> None:
    """Print or write the table."""
    publish(command(__doc__).parse_args().write, {"convergence": markdown()})


if __name__ == "__main__":
    main()
