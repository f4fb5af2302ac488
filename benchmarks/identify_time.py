"""How long a fit of six numbers to a log of 50 s at 1 kHz takes, beside other ways to the same prediction errors.

``python -m benchmarks.identify_time`` prints the table; ``--write FILE`` puts it between the file's two marks. Beside
`dualwinch.identify` stands:

- one solve with given gains by `scipy.optimize.least_squares` with finite differences: same predictions, same compiled
  filter, no slopes; the product's own share of such a solve is timed beside it;
- a fit by hand in CasADi with multiple shooting and IPOPT (`benchmarks.shooting` says what it minimises), from the same
  start, with the noise levels that the whole fit has to find out; the product's own fit with these levels given is
  timed beside it.

Times are wall times of one run each, on whatever machine it is; the whole fit is timed before and after the one by
hand, and the slower counts.
"""

import argparse
import sys
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.optimize import least_squares

from benchmarks.document import duration, markdown, put, times
from benchmarks.report import machine
from benchmarks.shooting import Shot, shoot
from dualwinch.codegen.errors import DualwinchError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod, covariance_of
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log, log_of
from dualwinch.toolboxes.identification.predictor import parameter_names
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import SearchCoordinates, estimable_keys, unknown_parameters

KEYS = (
    "plant.vehicle.mass", "plant.vehicle.drag_coefficient", "plant.rope_*.modulus", "plant.winch_*.inertia",
)  # fmt: skip

SENSORS = {
    "sensors.position_noise": 5e-4, "sensors.position_resolution": 1e-3, "sensors.speed_noise": 2e-3,
    "sensors.tension_noise": 10.0, "sensors.encoder_counts": 4096, "simulation.delay_samples": 1,
    "disturbance.current_sigma": 0.05, "disturbance.normal_force_sigma": 0.1, "simulation.readings": True,
}  # fmt: skip

NOMINAL = {
    "plant.vehicle.mass": 1.1e4, "plant.vehicle.drag_coefficient": 0.25, "plant.rope_1.modulus": 7.4e10,
    "plant.rope_2.modulus": 8.5e10, "plant.winch_1.inertia": 2.0, "plant.winch_2.inertia": 1.7,
}  # fmt: skip
"""What is wrong by some 10 %."""


def solve_times(right: Experiment, nominal: Experiment) -> tuple[float, float, int, int]:
    """Times in s of one solve with given gains, by exact slopes and by differences, and passes through the log."""
    unknowns = unknown_parameters(estimable_keys(KEYS, nominal), nominal, {})
    start = np.array([unknown.start for unknown in unknowns])
    fitting = PredictionErrorMethod(sections_of([log_of(simulate(right))], nominal), nominal, unknowns)
    values, noise = fitting.run(start).values, fitting.initial_noise()
    weights = fitting.filters.run(fitting.with_values(values), noise, robust=False)
    begin = values * 1.002  # near enough that both come to the same end
    before, begun = fitting.passes, perf_counter()
    exact, _ = fitting.likelihood.solve_with_gains(begin, noise, weights, SearchCoordinates(unknowns))
    taken, passes = perf_counter() - begun, fitting.passes - before

    base, calls = fitting.filters.parameters(fitting.with_values(values), noise), 0
    names = [parameter_names(fitting.structure).index(unknown.key) for unknown in unknowns]

    def surprises(shares: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        vector = base.copy()
        vector[names] = shares * values
        runs = fitting.filters.predict(vector, fitting.with_values(values), noise, weights, rows=True)
        every = np.concatenate([np.ravel(run.innovations) for run in runs if run.innovations is not None])
        return every[np.isfinite(every)]

    begun = perf_counter()
    found = least_squares(surprises, begin / values, x_scale="jac", xtol=1e-7, ftol=1e-8)
    other = perf_counter() - begun
    apart = np.max(np.abs(found.x * values - exact) / exact)
    if apart > 1e-3:
        print(f"note: the two solves differ by {apart:.1e}", file=sys.stderr)
    return taken, other, passes, calls


def shot_by_hand(log: Log, right: Experiment, nominal: Experiment) -> tuple[Shot, tuple[float, int], str]:
    """The fit by hand, beside the product's with the same levels given, time in s and passes.

    Returns:
        Both, and in words how far numbers are off: those by hand, and those of a fit in the same section.
    """
    unknowns = unknown_parameters(estimable_keys(KEYS, nominal), nominal, {})
    start, truth = np.array([unknown.start for unknown in unknowns]), leaves(right)
    fitting = PredictionErrorMethod(sections_of([log], nominal), nominal, unknowns)
    fit = fitting.run(start)
    shot = shoot(fitting.filters, nominal, fit.noise, [unknown.key for unknown in unknowns], start)
    again = PredictionErrorMethod(sections_of([log], nominal), nominal, unknowns)
    begun = perf_counter()
    passes = again.run(start, noise=fit.noise).passes
    given = perf_counter() - begun, passes
    true = np.array([float(truth[unknown.key]) for unknown in unknowns])
    deviations = np.sqrt(np.diag(covariance_of(fit.information, unknowns)))
    ours, theirs = np.abs(fit.values - true) / deviations, np.abs(shot.values - true) / deviations
    apart = np.abs(shot.values - fit.values) / deviations
    furthest = unknowns[int(np.argmax(apart))].key
    words = (
        f"Errors of the fit: up to {ours.max():.2g} of its standard deviations; by hand: up to {theirs.max():.2g} of "
        f"these. The two are up to {apart.max():.2g} of these apart (`{furthest}`), median {np.median(apart):.2g}."
    )
    return shot, given, words


def main() -> int:
    """Run the command line; 0 done, 1 where dualwinch cannot run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    chosen = parser.parse_args()
    try:
        right = override(case(4), SENSORS)
        nominal = override(right, NOMINAL)
        log = log_of(simulate(right))
        identify([log], KEYS, nominal)  # compiled
        found = identify([log], KEYS, nominal)
        exact, differences, passes, calls = solve_times(right, nominal)
        shot, (known, known_passes), off = shot_by_hand(log, right, nominal)
        whole = max(found.seconds, identify([log], KEYS, nominal).seconds)
    except DualwinchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    ended = "converged" if shot.status == "Solve_Succeeded" else "given up"
    rows = [
        ["whole fit, compiled before", duration(whole), f"{found.passes}", "1 ×", "", ""],
        ["fit with noise levels given", duration(known), f"{known_passes}", "", "1 ×", ""],
        [
            f"by hand: CasADi, multiple shooting, IPOPT ({ended})", duration(shot.seconds), f"{shot.iterations}",
            times(shot.seconds / whole), times(shot.seconds / known), "",
        ],
        ["one solve with given gains, exact slopes", duration(exact), f"{passes}", "", "", "1 ×"],
        ["the same by SciPy, by differences", duration(differences), f"{calls}", "", "", times(differences / exact)],
    ]  # fmt: skip
    headings = [
        "", "time", "passes through the log, iterations", "over the whole fit", "over that with levels given",
        "over one solve",
    ]  # fmt: skip
    facts = " · ".join(f"{name}: {value}" for name, value in machine().items())
    notes = (
        f"By hand: {shot.unknowns} unknowns, noise levels given, expressions and compiler {duration(shot.building)} on "
        f"top. {off}"
    )
    text = f"{markdown(headings, rows)}\n\n*{notes} {facts}*"
    print(text)
    if chosen.write:
        put(chosen.write, "fit time", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
