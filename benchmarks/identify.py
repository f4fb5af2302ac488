"""Whether what `dualwinch.identify` says of a machine is so: logs of many simulated machines, each fitted.

``python -m benchmarks.identify --logs 1000 --file coverage.jsonl`` draws machines of the ensemble `rig`, simulates a
log of each, fits everything that the ensemble draws and a log can tell, and looks where the truth lies. Each is a line
of the file, and those that are there already are not done again. ``--write FILE`` puts the table between the file's two
marks. ``--ensemble site --config FILE --file heavy.jsonl`` does so with machines of another ensemble, under the
controller of a file, for a table of its own.

A parameter that its log does not determine is one that an oracle, a filter at the true values, does not determine, too.
"""

import argparse
import json
import sys
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.document import markdown, put
from dualwinch.codegen.errors import DualwinchError
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.experiment_file import load
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.workers import cores
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.identification.diagnostics import unidentifiable_directions, uninformed_keys
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod, covariance_of
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log, log_of
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import Prior, UnknownParameter, problem_of

SEED = 18
"""Of the machines."""

DURATION = 60.0
"""Of each log in s."""

SHARE = 0.95
"""Of the intervals that are looked at."""


def one_log(scenario: Scenario, nominal: Experiment, priors: dict[str, Prior]) -> dict[str, Any]:
    """What comes of a scenario's log: for each number the truth, the estimate, and whether it is told."""
    truth = override(scenario.experiment, {"simulation.readings": True, "simulation.duration": DURATION})
    began, log = perf_counter(), log_of(simulate(truth))
    record: dict[str, Any] = {"scenario": scenario.index}
    try:
        found = identify([log], list(priors), nominal, priors=priors, workers=1)
    except ConfigurationError as error:
        return record | {"refused": str(error)}
    values, names = leaves(truth), {key for each in found.unidentifiable for key in each.keys} | set(found.uninformed)
    unseen = invisible(log, truth, found.unknowns)
    record |= {"converged": found.converged, "seconds": perf_counter() - began, "numbers": {}}
    for unknown, value, deviation in zip(found.unknowns, found.values, found.deviations, strict=True):
        off = value - float(values[unknown.key])
        off = (off + np.pi) % (2 * np.pi) - np.pi if unknown.cyclic else off
        record["numbers"][unknown.key] = {
            "off": float(off / deviation),
            "deviation": float(deviation),
            "unseen": unknown.key in unseen,
            "named": unknown.key in names,
        }
    return record


def invisible(log: Log, truth: Experiment, unknowns: tuple[UnknownParameter, ...]) -> set[str]:
    """What a log does not determine, by the information at the true values."""
    fitting = PredictionErrorMethod(sections_of([log], truth), truth, unknowns)
    values = leaves(truth)
    information = fitting.information(np.array([float(values[unknown.key]) for unknown in unknowns]))
    if information is None:
        return set()
    deviations = np.sqrt(np.diag(covariance_of(information, unknowns)))
    hardly = uninformed_keys(unknowns, deviations)
    return set(hardly) | {key for each in unidentifiable_directions(information, unknowns) for key in each.keys}


def table(records: list[dict[str, Any]], duration: float = DURATION) -> str:
    """The table of all logs: of each number how often its interval held the truth."""
    fitted = [record for record in records if "numbers" in record]
    keys = list(dict.fromkeys(key for record in fitted for key in record["numbers"]))
    rows, unseen, named = [], 0, 0
    for key in keys:
        each = [record["numbers"][key] for record in fitted if key in record["numbers"]]
        unseen += sum(number["unseen"] for number in each)
        named += sum(number["unseen"] and number["named"] for number in each)
        told = [number for number in each if not number["unseen"]]
        if not told:
            rows.append([f"`{key}`", "0", "", "", "", "determined by no log"])
            continue
        inside = sum(abs(number["off"]) < Z for number in told)
        between = binomtest(inside, len(told)).proportion_ci(SHARE, "exact")
        spread = float(np.sqrt(np.mean([number["off"] ** 2 for number in told])))
        rows.append([
            f"`{key}`", f"{len(told)}", f"{inside / len(told):.1%}", f"{between.low:.1%} to {between.high:.1%}",
            f"{spread:.2f}", "",
        ])  # fmt: skip
    headings = [
        "parameter",
        "logs that determine it",
        "coverage of 95 % intervals",
        "its 95 % interval",
        "RMS error / std. deviation",
        "",
    ]
    seconds = float(np.median([record["seconds"] for record in fitted])) if fitted else float("nan")
    refused, settled = len(records) - len(fitted), sum(record["converged"] for record in fitted)
    notes = f"{len(records)} logs of {duration:g} s, {refused} refused, {settled} converged, {seconds:.3g} s a log"
    notes += " (median)."
    if unseen:
        notes += f" Parameters that their log does not determine: {unseen}, of which named: {named}."
    return f"{markdown(headings, rows)}\n\n*{notes}*"


Z = 1.959963984540054
"""Half the width of an interval, over the standard deviation."""


def done(file: Path) -> list[dict[str, Any]]:
    """What a file holds; a line that was cut off is none."""
    found = []
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else []:
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def main() -> int:
    """Run the command line; 0 done, 1 where dualwinch cannot run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ensemble", default="rig", metavar="NAME", help="of the machines (rig)")
    parser.add_argument("--config", type=Path, metavar="FILE", help="of their controller (that of the ensemble)")
    parser.add_argument("--logs", type=int, default=1000, metavar="N", help="logs, those there are counted (1000)")
    parser.add_argument("--file", type=Path, default=Path("coverage.jsonl"), help="of the logs (coverage.jsonl)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    chosen = parser.parse_args()
    if chosen.logs < 1:
        parser.error(f"--logs {chosen.logs}: must be >= 1")
    try:
        ensemble = load_ensemble(chosen.ensemble)
        if chosen.config:
            ensemble = ensemble.controlled_as(load(chosen.config))
        nominal, _, priors = problem_of([], None, ensemble, {})
        records = done(chosen.file)
        there = {record["scenario"] for record in records}
        wanted = [scenario for scenario in ensemble.scenarios(chosen.logs, SEED) if scenario.index not in there]
        with Pool(cores()) as pool:
            for record in pool.imap_unordered(partial(one_log, nominal=nominal, priors=priors), wanted):
                records.append(record)
                with chosen.file.open("a", encoding="utf-8") as lines:
                    lines.write(json.dumps(record) + "\n")
                print(f"{len(records)} of {chosen.logs}: {record.get('seconds', 0):.0f} s", file=sys.stderr)
    except DualwinchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    text = table(sorted(records, key=lambda record: record["scenario"])[: chosen.logs])
    print(text)
    if chosen.write:
        put(chosen.write, "coverage" if chosen.ensemble == "rig" else f"coverage in {chosen.ensemble}", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
