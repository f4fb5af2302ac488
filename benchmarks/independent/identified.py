"""Whether `dualwinch.identify` is right about a machine that the product did not simulate: logs of machine.c, fitted.

``python -m benchmarks.independent.identified --logs 200 --file logs.jsonl`` logs 50 s of Case 4's motion of each seed's
machine of the sea: vortices, current, changing rail load, friction of the drums, torques 0 to 3 samples late and
controller gains that the fit is not told; the sea is described for every second log. Each is a line of the file, and
those that are there already are not done again. ``--every 5`` logs at 200 Hz. With ``--integrated`` the phase of the
vortices is the integral of their frequency, from a drawn one on, and the fit is told neither. ``--write FILE`` puts the
table between the file's two marks.
"""

import argparse
import json
import sys
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.document import put
from benchmarks.identify import done, table
from benchmarks.independent.judge import DRAWN, LOGGED, Conditions, Judge
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import log as log_of_columns

DURATION = 50.0
"""Of each log in s."""

SEA = {"disturbance.current_sigma": 0.05, "disturbance.normal_force_sigma": 0.1, "disturbance.vortex_amplitude": 0.2}


def gains_of(seed: int) -> dict[str, float]:
    """Gains of the controller of a seed: the paper's, each up to a fifth more or less, and another preload."""
    draw, own = np.random.default_rng(seed), leaves(Experiment(controller=paper_controller()))
    names = ("nftsm.k", "winch_1.kp", "winch_1.kd", "winch_2.kp", "winch_2.kd")
    gains = {
        f"controller_{name.replace('.', '_')}": float(own[f"controller.{name}"]) * float(draw.uniform(0.8, 1.2))
        for name in names
    }
    return gains | {"controller_coordination_preload": float(draw.uniform(900.0, 1500.0))}


def phase_of(seed: int) -> dict[str, float]:
    """Vortices of a seed whose phase is integrated."""
    return {"shedding_by_way": 1.0, "shedding_phase": float(np.random.default_rng([seed, 1]).uniform(-np.pi, np.pi))}


def one_log(seed: int, judge: Judge, every: int, sea: float, *, integrated: bool = False) -> dict[str, Any]:
    """What comes of a seed's log: of each parameter the error of the estimate in standard deviations."""
    conditions = Conditions(imperfect=0.0, delay=seed % 4, outage_length=0.0)
    settings = gains_of(seed) | (phase_of(seed) if integrated else {})
    drawn, rows = judge.log(conditions, seed, settings, every)
    described = seed % 2 == 1
    nominal = override(case(4), {key: sea * size for key, size in SEA.items()}) if described else Experiment()
    record: dict[str, Any] = {"scenario": seed, "delay": conditions.delay, "described": described, "every": every}
    try:
        log = log_of_columns(dict(zip(LOGGED, rows.T, strict=True)))
        found = identify([log], DRAWN, nominal, workers=1)
    except ConfigurationError as error:
        return record | {"refused": str(error)}
    numbers = {
        key: {"off": float((value - truth) / deviation), "share": float(deviation / value), "unseen": False}
        for key, value, deviation, truth in zip(DRAWN, found.values, found.deviations, drawn, strict=True)
    }
    return record | {
        "converged": found.converged, "seconds": found.seconds, "notes": found.notes,
        "numbers": {key: {**number, "named": False} for key, number in numbers.items()},
    }  # fmt: skip


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=200, metavar="N", help="logs, those there are counted (200)")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="samples between rows (1)")
    parser.add_argument("--integrated", action="store_true", help="integrate the frequency of the vortices")
    parser.add_argument("--sea", type=float, default=1.0, metavar="FACTOR", help="described sea, over the real one (1)")
    parser.add_argument("--file", type=Path, default=Path("logs.jsonl"), help="of the logs (logs.jsonl)")
    parser.add_argument("--processes", type=int, default=2, metavar="N", help="logs side by side (2)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    chosen = parser.parse_args()
    records = done(chosen.file)
    there = {record["scenario"] for record in records}
    seeds = [seed for seed in range(1, chosen.logs + 1) if seed not in there]
    with TemporaryDirectory() as folder, Pool(chosen.processes) as pool:
        judge = Judge(Experiment(controller=paper_controller()), Path(folder))
        of_seed = partial(one_log, judge=judge, every=chosen.every, sea=chosen.sea, integrated=chosen.integrated)
        for record in pool.imap_unordered(of_seed, seeds):
            records.append(record)
            with chosen.file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(record) + "\n")
            print(f"{len(records)} of {chosen.logs}: {record.get('seconds', 0):.0f} s", file=sys.stderr)
    text = table(sorted(records, key=lambda record: record["scenario"])[: chosen.logs], DURATION)
    print(text)
    if chosen.write:
        at = f" at {1000 / chosen.every:g} Hz" if chosen.every > 1 else ""
        at = f" with integrated phases{at}" if chosen.integrated else at
        put(chosen.write, f"coverage of the independent machine{at}", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
