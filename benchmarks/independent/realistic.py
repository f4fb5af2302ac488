"""Gains on machines as they are built: ropes that weigh something, winches that are heavy, gears that give.

``python -m benchmarks.independent.realistic --config best.toml`` prints a row for each effect (a quarter of an hour on
two cores with 40 machines); without gains, the paper's alone. ``--json FILE`` keeps all numbers, a run each.

Each row adds an effect to the machines of `rig` without outages, whose drums are Table 1's; with ``--winch site`` to
drums, rotors and ropes on them as data sheets give them, which the controller knows, and the last row has all effects.
The sizes are those of `benchmarks.independent.site`; of the rows on Table 1's drums those of the names.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import dualwinch
from benchmarks.document import markdown, put
from benchmarks.independent.judge import Conditions, Judge, Runs, Settings
from benchmarks.independent.site import ARC_MINUTE, DRUM, EFFECTS, RATIO, ROPE, ROTOR, SPARE, draw
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment

SAGGING = {"submerged_weight": 20.2, "transverse_mass": 2.96, "transverse_drag": 1.2, "slack_below": 20.0}

GEAR = {"inertia_factor": 0.5, "rotor_inertia": 0.9 / RATIO**2, "gear_stiffness": 1.4e6, "gear_damping": 20.0}
"""Half of Table 1's inertia on either side of a gearbox; damping 1 % of critical."""

LUGRE = {"break_away": 1.5, "bristle_stiffness": 5e6, "bristle_damping": 1e5}

ON_RIG: Mapping[str, Mapping[str, float]] = {
    "nothing": {},
    "rope mass, 0.6 kg/m": {"rope_mass": 0.6},
    "rope mass, 1.2 kg/m": {"rope_mass": 1.2},
    "rope mass, 2.36 kg/m": {"rope_mass": ROPE},
    "drum inertia + 10 kg m²": {"drum_inertia": 10.0},
    "drum inertia + 20 kg m²": {"drum_inertia": 20.0},
    "drum inertia + 30 kg m²": {"drum_inertia": 30.0},
    "drum inertia + 100 kg m²": {"drum_inertia": 100.0},
    "drum inertia 220 kg m²": {"drum_inertia": 220.0, "inertia_factor": 0.0},
    "sag on rollers every 1 m": SAGGING | {"roller_spacing": 1.0},
    "speed wheel 0.2 %": {"wheel_error": 2e-3},
    "gearbox 1.4e6 N m/rad": GEAR,
    "transmission error 0.5′": GEAR | {"transmission_error": 0.5 * ARC_MINUTE},
    "backlash 30′": GEAR | {"backlash": 30 * ARC_MINUTE},
    "Stribeck 1.5, LuGre": LUGRE,
    "Dahl's hysteresis, 14 N": {"dahl_force": 14.0},
    "E A − 25 %": {"modulus_factor": 0.75},
    "load cells of 50 Hz": {"cell_bandwidth": 50.0},
    "torque steps of 0.13 N m": {"torque_step": 0.13},
    "rail tilted by 1 mrad": {"rail_tilt": 1e-3},
}
"""Rows on Table 1's drums."""

ON_SITE: Mapping[str, tuple[str, ...]] = {
    "nothing": ("winch",),
    **{name: ("winch", "gearbox", name) if name == "teeth" else ("winch", name) for name in EFFECTS if name != "winch"},
    "rope mass and its damping": ("winch", "rope mass", "rope damping"),
    "all but the speed wheel": tuple(name for name in EFFECTS if name != "speed wheel"),
    "all": tuple(EFFECTS),
}
"""Rows on winches as data sheets give them: effects of `benchmarks.independent.site`."""

KNOWN = ROTOR * RATIO**2 + DRUM + ROPE * 0.8**2 * (SPARE + 26.0)
"""Inertia in kg m² that the controller knows of such a winch: rotor, drum and half of the rope."""

LOST = 0.5
"""m: a machine that is further off at any sample is lost, even where it stays on the track."""

SLACK_SHARE = 1e-3
"""Of a run's tensions, which are two a sample: beyond it a rope counts as slack for long."""


def rows(winch: str, damping: float) -> dict[str, Settings]:
    """Settings of the runs of each row."""
    if winch == "rig":
        return {name: _always({**effects, "speed_damping": damping}) for name, effects in ON_RIG.items()}
    known = {f"nominal_winch_{number}_inertia": KNOWN for number in (1, 2)} | {"speed_damping": damping}
    return {name: _drawn(names, known) for name, names in ON_SITE.items()}


def _always(settings: Mapping[str, float]) -> Settings:
    return lambda _: settings


def _drawn(names: tuple[str, ...], known: Mapping[str, float]) -> Settings:
    return lambda seed: {**draw(seed, names), **known}


@dataclass(frozen=True)
class Verdict:
    """What gains came to in a row: median RMS error in mm, counts of machines, median and largest peak tension in N.

    `failed` are lost, or slack at any sample; `slack_long` are lost, or slack for more than `SLACK_SHARE`.
    """

    rms: float
    failed: int
    slack_long: int
    lost: int
    peak: float
    largest_peak: float
    smallest: float

    @classmethod
    def of(cls, runs: Runs) -> "Verdict":
        """Of all runs, the lost ones with the error that they had until then."""
        share, lost = runs.slack / (2 * runs.samples), ~runs.completed | (runs.largest_error > LOST)
        return cls(
            rms=1e3 * float(np.median(np.sqrt(runs.mse))),
            failed=int(np.sum(lost | (runs.slack > 0))),
            slack_long=int(np.sum(lost | (share > SLACK_SHARE))),
            lost=int(np.sum(lost)),
            peak=float(np.median(runs.peak_tension)),
            largest_peak=float(np.max(runs.peak_tension)),
            smallest=float(np.min(runs.min_tension)),
        )

    def cells(self) -> list[str]:
        """For the table."""
        error = "lost" if self.rms > LOST * 1e3 else f"{self.rms:.3f}"
        return [
            error,
            f"{self.failed}",
            f"{self.slack_long}",
            f"{self.lost}",
            f"{self.peak:.0f}",
            f"{self.smallest:.0f}",
        ]


HEADINGS = ("median RMS (mm)", "slack or lost", "for long", "lost", "peak (N)", "smallest (N)")


def judged(
    judges: Mapping[str, Judge],
    damping: Mapping[str, float],
    winch: str,
    seeds: Sequence[int],
    only: Sequence[str] = (),
) -> dict[str, dict[str, Runs]]:
    """Runs of every row by every controller: row → name of the controller → runs."""
    settings = {name: rows(winch, damping[name]) for name in judges}
    names = [row for row in next(iter(settings.values())) if not only or row in only]
    found: dict[str, dict[str, Runs]] = {}
    for row in names:
        sys.stderr.write(f"{row}\n")
        conditions = Conditions(outage_length=0.0)
        found[row] = {name: judge.run(conditions, seeds, settings[name][row]) for name, judge in judges.items()}
    return found


def table(found: Mapping[str, Mapping[str, Runs]]) -> str:
    """A row for each effect, with the columns of `HEADINGS` for each controller."""
    names = list(next(iter(found.values())))
    headings = ["added", *(f"{name}: {heading}" for name in names for heading in HEADINGS)]
    lines = [[row, *(cell for name in names for cell in Verdict.of(runs[name]).cells())] for row, runs in found.items()]
    return markdown(headings, lines)


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line; 0 done, 1 where the gains cannot be judged."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.independent.realistic",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="gains beside the paper's: best.toml of `dualwinch tune`")
    add("--winch", choices=("rig", "site"), default="rig", help="Table 1's drums, or those of data sheets")
    add("--machines", type=int, default=40, metavar="INT", help="machines in each row (default: 40)")
    add("--seed", type=int, default=1, metavar="INT", help="of the first machine (default: 1)")
    add("--damping", type=float, default=0.0, metavar="FLOAT", help="of drum speeds in N m s/rad, beside the gains")
    add("--paper-damping", type=float, default=0.0, metavar="FLOAT", help="the same beside the paper's gains")
    add("--row", action="append", default=[], metavar="NAME", help="only this row; may be repeated")
    add("--json", type=Path, metavar="FILE", help="all numbers, a run each")
    add("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    add("--block", metavar="NAME", help="which of its tables (default: realistic, and the winch)")
    arguments = parser.parse_args(words)
    if arguments.machines < 1:
        parser.error(f"--machines {arguments.machines}: must be a whole number from 1")
    missing = [row for row in arguments.row if row not in rows(arguments.winch, 0.0)]
    if missing:
        parser.error(f"--row {missing[0]}: must be one of {', '.join(rows(arguments.winch, 0.0))}")
    try:
        with TemporaryDirectory() as folder:
            judges: dict[str, Judge] = {}
            if arguments.config:
                judges["gains"] = Judge(dualwinch.load(arguments.config), _new(Path(folder) / "gains"))
            judges["paper"] = Judge(Experiment(controller=paper_controller()), _new(Path(folder) / "paper"))
            damping = {"gains": arguments.damping, "paper": arguments.paper_damping}
            seeds = range(arguments.seed, arguments.seed + arguments.machines)
            found = judged(judges, damping, arguments.winch, seeds, arguments.row)
    except (ConfigurationError, ValueError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    text = f"{table(found)}\n\n*{arguments.machines} machines in each row, of seeds from {arguments.seed}.*"
    print(text)
    if arguments.json:
        kept = {
            row: {name: {f.name: getattr(of, f.name).tolist() for f in fields(of)} for name, of in runs.items()}
            for row, runs in found.items()
        }
        about = {"winch": arguments.winch, "seeds": list(seeds), "damping": damping, "config": str(arguments.config)}
        arguments.json.write_text(json.dumps(about | {"rows": kept}, indent=1))
    if arguments.write:
        put(arguments.write, arguments.block or f"realistic {arguments.winch}", text)
    return 0


def _new(folder: Path) -> Path:
    folder.mkdir()
    return folder


if __name__ == "__main__":
    sys.exit(main())
