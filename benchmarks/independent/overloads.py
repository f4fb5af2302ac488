"""Gains on machines as they are built that are overloaded: pushes, payloads, drives that lack torque.

``python -m benchmarks.independent.overloads --config best.toml`` prints a row for each overload, on machines with all
effects of `benchmarks.independent.site`. The sizes are typical values: a push changes the vehicle's speed by 0.24 m/s,
or lasts for most of the cruise; the drives' power is what 133 N m at 60 rad/s take.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import dualwinch
from benchmarks.document import markdown, put
from benchmarks.independent.judge import Conditions, Judge, Runs
from benchmarks.independent.realistic import KNOWN
from benchmarks.independent.site import EFFECTS, draw
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment

OVERLOADS: Mapping[str, Mapping[str, float]] = {
    "none": {},
    "torque of 133 N m to 60 rad/s, then constant power": {"most_torque": 133.0, "base_speed": 60.0},
    "payload at 20 s: mass + 15 %, drag + 40 %": {"payload_mass": 0.15, "payload_drag": 0.4},
    "push of 8 kN for 0.3 s": {"push_force": 8e3, "push_length": 0.3},
    "push of 2.4 kN for 9 s": {"push_force": 2.4e3, "push_length": 9.0},
    "drive 2 without torque for 0.1 s": {"dropout_length_2": 0.1},
}
"""Row → effects of the independent machine."""

LIMIT = 6000.0
"""tension_max in N."""

HEADINGS = ("slack", "above 6 kN", "largest peak (N)", "median RMS (mm)", "median largest error (mm)")


def cells(runs: Runs) -> list[str]:
    """What a controller came to in a row: counts of machines, the largest tension, and errors."""
    return [
        f"{np.sum(runs.slack > 0)}",
        f"{np.sum(runs.peak_tension > LIMIT)}",
        f"{np.max(runs.peak_tension):.0f}",
        f"{float(f'{1e3 * np.median(np.sqrt(runs.mse)):.3g}'):g}",
        f"{float(f'{1e3 * np.median(runs.largest_error):.3g}'):g}",
    ]


def judged(
    judges: Mapping[str, tuple[Judge, float]], seeds: Sequence[int], settings: Mapping[str, float] | None = None
) -> dict[str, dict[str, Runs]]:
    """Runs of every row by every controller with its damping of drum speeds: row → name → runs.

    `settings` are further ones of every run.
    """
    calm, found = Conditions(outage_length=0.0), dict[str, dict[str, Runs]]()
    for row, overload in OVERLOADS.items():
        sys.stderr.write(f"{row}\n")
        found[row] = {}
        for name, (judge, damping) in judges.items():
            known = {f"nominal_winch_{number}_inertia": KNOWN for number in (1, 2)} | {"speed_damping": damping}
            effects = {**known, **overload, **(settings or {})}
            found[row][name] = judge.run(calm, seeds, lambda seed, own=effects: {**draw(seed, tuple(EFFECTS)), **own})
    return found


def table(found: Mapping[str, Mapping[str, Runs]]) -> str:
    """A row for each overload, with the columns of `HEADINGS` for each controller."""
    names = list(next(iter(found.values())))
    headings = ["overload", *(f"{name}: {heading}" for name in names for heading in HEADINGS)]
    return markdown(
        headings, [[row, *(cell for of in runs.values() for cell in cells(of))] for row, runs in found.items()]
    )


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line; 0 done, 1 where the gains cannot be judged."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.independent.overloads",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", required=True, help="gains: best.toml of `dualwinch tune`")
    add("--linear-speed", type=float, default=0.01, metavar="FLOAT", help="of the gains in m/s (default: 0.01)")
    add("--machines", type=int, default=40, metavar="INT", help="machines in each row (default: 40)")
    add("--seed", type=int, default=1, metavar="INT", help="of the first machine (default: 1)")
    add("--paper-damping", type=float, default=140.0, metavar="FLOAT", help="of drum speeds beside the paper's gains")
    add("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    arguments = parser.parse_args(words)
    try:
        with TemporaryDirectory() as folder:
            gains = dualwinch.load(arguments.config)
            experiments = {
                "gains": dualwinch.override(gains, {"controller.nftsm.linear_speed": arguments.linear_speed}),
                "the same, a power throughout": dualwinch.override(gains, {"controller.nftsm.linear_speed": 0.0}),
                "paper": Experiment(controller=paper_controller()),
            }
            judges: dict[str, tuple[Judge, float]] = {}
            for name, experiment in experiments.items():
                (place := Path(folder) / name.replace(" ", "_")).mkdir()
                judges[name] = Judge(experiment, place), arguments.paper_damping if name == "paper" else 0.0
            found = judged(judges, range(arguments.seed, arguments.seed + arguments.machines))
    except (ConfigurationError, ValueError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    text = f"{table(found)}\n\n*{arguments.machines} machines in each row, of seeds from {arguments.seed}.*"
    print(text)
    if arguments.write:
        put(arguments.write, "overloads", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
