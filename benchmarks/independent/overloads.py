"""Gains on machines as they are built that are overloaded, or whose sensors are wrong or late.

``python -m benchmarks.independent.overloads --config best.toml`` prints a row for each overload, or with ``--sensors``
for each fault of a sensor, or with ``--late`` for each delay of the position sensor, on machines with all effects of
`benchmarks.independent.site`. The sizes are typical values: a push changes the vehicle's speed by 0.24 m/s, or lasts
for most of the cruise; the drives' power is what 133 N m at 60 rad/s take; a wheel slips
for half a second; satellite navigation comes ten times a second, a tenth of a second late.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
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
    "drive 1 without torque for 0.02 s": {"dropout_length_1": 0.02},
    "drive 1 without torque for 0.1 s": {"dropout_length_1": 0.1},
}
"""Row → effects of the independent machine."""

TOLD, RATE = "controller_kalman_position_delay", "controller_trust_position_rate"
"""The filter's delay of the position sensor in s, and its readings a second."""

FAULTS: Mapping[str, Mapping[str, float]] = {
    "none": {},
    **{f"wheel slips by {share} %": {"wheel_slip": share / 100} for share in (30, 3, 1, 0.5)},
    "position off by 20 mm for 1 s": {"position_fault": 0.02, "fault_length": 1.0},
    "encoder 2 slips by 10 mm": {"encoder_slip_2": 0.01},
    "load cells drift by 80 N": {"cell_drift_1": 80.0, "cell_drift_2": -80.0},
}
"""Row → effects of the independent machine."""

PUNCTUAL = {TOLD: 0.0, RATE: 1000.0}
"""What the filter is told of a position sensor that reads at every sample, without a delay."""

LATE: Mapping[str, Mapping[str, float]] = {
    "none": PUNCTUAL,
    **{
        f"late by {late} ms, told {told} ms": PUNCTUAL | {"position_late": late * 1e-3, TOLD: told * 1e-3}
        for late, told in ((5, 5), (5, 6), (20, 20), (20, 19))
    },
    "10 readings a second, late by 100 ms, told": {"position_late": 0.1, "position_rate": 10.0, TOLD: 0.1, RATE: 10.0},
}
"""Row → effects of the independent machine, and what the filter is told."""

LIMIT = 6000.0
"""tension_max in N."""

TENSIONS: Mapping[str, Callable[[Runs], str]] = {
    "slack": lambda runs: f"{np.sum(runs.slack > 0)}",
    "median time slack (ms)": lambda runs: f"{np.median(runs.slack):.0f}",
    "above 6 kN": lambda runs: f"{np.sum(runs.peak_tension > LIMIT)}",
    "largest peak (N)": lambda runs: f"{np.max(runs.peak_tension):.0f}",
}
"""Columns of machines with a slack rope, how long it is, those above the limit, and the largest tension."""

ERRORS: Mapping[str, Callable[[Runs], str]] = {
    "median RMS (mm)": lambda runs: _in_mm(np.median(np.sqrt(runs.mse))),
    "median largest error (mm)": lambda runs: _in_mm(np.median(runs.largest_error)),
}
"""Columns of errors."""


def _in_mm(error: np.floating) -> str:
    return f"{float(f'{1e3 * error:.3g}'):g}"


def judged(
    judges: Mapping[str, tuple[Judge, float]],
    seeds: Sequence[int],
    rows: Mapping[str, Mapping[str, float]] = OVERLOADS,
    settings: Mapping[str, float] | None = None,
) -> dict[str, dict[str, Runs]]:
    """Runs of every row by every controller with its damping of drum speeds: row → name → runs.

    `settings` are further ones of every run.
    """
    calm = Conditions(outage_length=0.0)
    heavy = {f"nominal_winch_{number}_inertia": KNOWN for number in (1, 2)}
    runs: dict[str, dict[str, Runs]] = {}
    for row, effects in rows.items():
        sys.stderr.write(f"{row}\n")
        runs[row] = {}
        for name, (judge, damping) in judges.items():
            told = effects if name != "paper" else {key: effects[key] for key in effects if key not in (TOLD, RATE)}
            constant = {**heavy, "speed_damping": damping, **told, **(settings or {})}
            runs[row][name] = judge.run(
                calm, seeds, lambda seed, constant=constant: {**draw(seed, tuple(EFFECTS)), **constant}
            )
    return runs


def table(
    runs: Mapping[str, Mapping[str, Runs]], columns: Mapping[str, Callable[[Runs], str]], first: str = "overload"
) -> str:
    """A row for each overload or fault, with the columns for each controller."""
    names = list(next(iter(runs.values())))
    headings = [first, *(f"{name}: {heading}" for name in names for heading in columns)]
    return markdown(
        headings, [[row, *(cell(of) for of in by.values() for cell in columns.values())] for row, by in runs.items()]
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
    add(
        "--sensors",
        action="store_true",
        help="faults of sensors, with the filter's gate, without, and with the paper's",
    )
    add("--late", action="store_true", help="delays of the position sensor, as told and learnt, and with the paper's")
    add("--machines", type=int, default=40, metavar="INT", help="machines in each row (default: 40)")
    add("--seed", type=int, default=1, metavar="INT", help="of the first machine (default: 1)")
    add("--paper-damping", type=float, default=140.0, metavar="FLOAT", help="of drum speeds beside the paper's gains")
    add("--write", type=Path, metavar="FILE", help="document whose tables are replaced")
    arguments = parser.parse_args(words)
    try:
        with TemporaryDirectory() as folder:
            gains = dualwinch.load(arguments.config)
            experiments, rows = {"gains": gains}, OVERLOADS
            if arguments.sensors:
                ungated = dualwinch.override(gains, {"controller.trust.false_alarm": 0.0})
                experiments, rows = {"gate": gains, "no gate": ungated}, FAULTS
            if arguments.late:
                told = {"controller.kalman.position_delay": 1e-3, "controller.trust.position_rate": 1000.0}
                told_of = dualwinch.override(gains, told)
                learnt = dualwinch.override(told_of, {"controller.drums.delay": 1e-3})
                experiments, rows = {"as told": told_of, "learnt": learnt}, LATE
            experiments["paper"] = Experiment(controller=paper_controller())
            judges: dict[str, tuple[Judge, float]] = {}
            for name, experiment in experiments.items():
                (place := Path(folder) / name.replace(" ", "_")).mkdir()
                judges[name] = Judge(experiment, place), arguments.paper_damping if name == "paper" else 0.0
            runs = judged(judges, range(arguments.seed, arguments.seed + arguments.machines), rows)
    except (ConfigurationError, ValueError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    note = f"*{arguments.machines} machines in each row, of seeds from {arguments.seed}.*"
    block, tables = "overloads", [table(runs, TENSIONS), table(runs, ERRORS)]
    if arguments.sensors:
        block, tables = "sensors", [table(runs, columns, "fault") for columns in (TENSIONS, ERRORS)]
    if arguments.late:
        block, tables = "late", [table(runs, ERRORS, "position sensor")]
    text = "\n\n".join([*tables, note])
    print(text)
    if arguments.write:
        put(arguments.write, block, text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
