"""Heavy winches and ropes: the rule for the drums' resonance against linear loops, and what preload buys."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import dualwinch as dw
from benchmarks.document import markdown
from dualwinch.analysis.resonance import UNDECIDED
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.heavy_ropes import ernst_factor
from dualwinch.model.ropes import kelvin_voigt
from dualwinch.tuning.tuning_problem import tuning_problem

SMOOTH = dw.override(dw.case(4), {"controller.nftsm.smoothing": 0.05, "controller.observer.kf": 0.0})
"""Where the slope of the law is that at zero for all speed errors of less than some cm/s."""

SMALL = 1e-6
"""Amplitude in m/s at which a describing function is the slope at zero."""

PLACES, SPEED = (25.0, 10.0, 3.0), 0.5
"""Positions in m and the speed in m/s at which eigenvalues are looked at; amid the track both drums swing alike."""


def both(**values: float) -> dict[str, Any]:
    """Values of both sides by keys such as ``rope__damping``; those of ``gain__`` are the winch controllers'."""
    tables = {"rope": "plant.rope_{}.{}", "winch": "plant.winch_{}.{}", "gain": "controller.winch_{}.{}"}
    split = {tuple(name.split("__")): value for name, value in values.items()}
    return {tables[of].format(number, name): value for (of, name), value in split.items() for number in (1, 2)}


def machine(**values: float) -> dw.Experiment:
    """Case 4 with values of both sides."""
    return dw.override(SMOOTH, both(**values) | {"plant.rope_slack": False, "simulation.substeps": 8})


HEAVY = {"rope__mass_per_length": 2.36, "winch__inertia": 150.0, "rope__damping": 300.0}

SITE = replace(dw.load_ensemble("site").experiment, controller=SMOOTH.controller)
SITE = dw.override(SITE, {"controller.coordination.preload": 6000.0, "actuator.motor.time_constant": 1e-3})
SITE = dw.override(SITE, both(gain__damping=164.0))

MACHINES = {
    "Table 1, winches of 11.8 kg m²": machine(winch__inertia=11.8),
    "Table 1, ropes of 1.2 kg/m": machine(rope__mass_per_length=1.2),
    "ropes of 2.36 kg/m and 300 N s/m, damping 20": machine(
        rope__mass_per_length=2.36, rope__damping=300.0, gain__damping=20.0
    ),
    "winches of 150 kg m², ki 0.002": machine(winch__inertia=150.0, gain__ki=0.002),
    "both, damping 60": machine(**HEAVY, gain__damping=60.0),
    "both, damping 164": machine(**HEAVY, gain__damping=164.0),
    "both, damping 164, ki 0.2, kp 0.005": machine(**HEAVY, gain__damping=164.0, gain__ki=0.2, gain__kp=5e-3),
    "both, damping 164, three samples late": dw.override(
        machine(**HEAVY, gain__damping=164.0), {"simulation.delay_samples": 3}
    ),
    "`site`, damping 164": SITE,
    "`site`, motors of 8 ms": dw.override(SITE, {"actuator.motor.time_constant": 8e-3}),
    "`site`, `self-calibrating-kalman`": dw.override(SITE, {"controller.estimator": "self-calibrating-kalman"}),
}
"""Machines and winch gains by what they have; preload 6 kN in `site`."""


def law_of(experiment: dw.Experiment) -> FandoNftsm:
    """The paper's law."""
    return experiment.controller.law  # pyright: ignore[reportReturnType]


def worst(experiment: dw.Experiment, x: float = PLACES[0]) -> dw.ResonanceGain:
    """The larger of the loop gains at the resonances of both drums, for small errors."""
    return max(dw.resonance_gains(experiment, x, amplitudes=[SMALL]), key=lambda each: each.gain)


def with_gain(experiment: dw.Experiment, gain: float, x: float = PLACES[0]) -> dw.Experiment:
    """The experiment with an observer that makes the loop gain at the resonance what is asked for."""
    now = worst(experiment, x)
    more = (gain - now.gain) * now.damping / now.mass
    return dw.override(experiment, {"controller.observer.l0": law_of(experiment).observer.l0 + more})


def swings_up(experiment: dw.Experiment, x: float) -> bool:
    """Whether an oscillation of more than 10 rad/s grows, in motion."""
    poles = dw.linear_closed_loop(experiment, x, SPEED).poles()
    fast = np.abs(np.angle(poles)) > 10 * experiment.simulation.sample_time
    return bool(np.abs(poles[fast]).max() > 1)


def bound(experiment: dw.Experiment, x: float) -> float:
    """The loop gain at which the loop loses its stability, by eigenvalues: bisection, to a per cent."""
    low, high = UNDECIDED[0], 4.0
    while high / low > 1.01:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if swings_up(with_gain(experiment, middle, x), x) else (middle, high)
    return low


def resonance() -> str:
    """The bounds of all machines, and what the rule without the winch controllers' gains says at the first."""
    rows = []
    for name, experiment in MACHINES.items():
        bounds = [bound(experiment, x) for x in PLACES]
        at = with_gain(experiment, bounds[0])
        found, pid = worst(at), at.controller.coordination.winch_1  # pyright: ignore[reportAttributeAccessIssue]
        winch, rope = at.plant.winch_1, at.plant.rope_1
        tension_loop = pid.ki * winch.gear_ratio / winch.drum_radius
        alone = (found.feedback - tension_loop) * found.mass / rope.tangent(1000.0, 25.5)[1]
        rows.append([name, *(f"{value:.2f}" for value in bounds), f"{alone:.2g}"])
    heading = [f"bound at x = {x:g} m" for x in PLACES]
    return markdown(["machine", *heading, "the same at 25 m without the winch's gains"], rows)


PRELOADS = (2000.0, 2600.0, 3000.0, 3500.0, 4000.0)
"""In N."""

SHARING = ("differential-tension", "proportional-tension")
"""Kinds of coordination: fast force by halves, and in proportion to the tensions."""

DRAWS, DRAWN_WITH = 400, 6
"""Draws of `site` and their seed."""


def preloads() -> str:
    """How stiff sagging ropes are under a preload, and how often one goes all but slack with either way to share.

    Spans of s swing at sqrt(T/m)/2s, with the rope's mass and that of the water that moves with it.
    """
    problem = tuning_problem(ensemble="site")
    if problem.ensemble is None:
        raise ValueError("a tuning in site has an ensemble")
    own, rope = problem.experiment, kelvin_voigt(problem.experiment.plant.rope_1)
    allowed = 0.4 * own.controller.limits.tension_min
    paper = replace(own, controller=paper_controller(own.controller))
    reference = dw.run_ensemble(replace(problem.ensemble, experiment=paper), DRAWS, seed=DRAWN_WITH)
    load, rows = np.nanmean(reference.metrics["continuous_load"]), []
    for preload in PRELOADS:
        gains = dw.override(own, {"controller.coordination.preload": preload})
        shared = [dw.override(gains, {"controller.coordination.kind": kind}) for kind in SHARING]
        results = [
            dw.run_ensemble(replace(problem.ensemble, experiment=each), DRAWS, seed=DRAWN_WITH) for each in shared
        ]
        stiff = [ernst_factor(rope.submerged_weight, span, preload / 2, rope.modulus * rope.area) for span in (1, 2)]
        across = rope.mass_per_length + rope.added_mass_per_length
        swing = math.sqrt(preload / 2 / across) / (2 * 2)
        slack = [int((np.asarray(result.metrics["min_tension"]) < allowed).sum()) for result in results]
        error = 1e3 * math.sqrt(np.nanmedian(results[-1].metrics["mse"]))
        more = np.nanmean(results[-1].metrics["continuous_load"]) / load
        rows.append(
            [
                f"{preload:g}",
                *(f"{share:.2f}" for share in stiff),
                f"{swing:.1f}",
                *map(str, slack),
                f"{error:.2f}",
                f"{more:.2f}",
            ]
        )
    heading = [
        "stiffness left, rollers of 1 m",
        "of 2 m",
        "spans of 2 m swing at (Hz)",
        f"draws of {DRAWS} with a tension below {allowed:g} N, fast force shared by halves",
        "the same, shared in proportion",
    ]
    return markdown(["preload (N)", *heading, "median RMS (mm)", "continuous load over the paper's"], rows)


LEADS = (0.0, 1e-3, 2e-3, 3e-3, 4e-3)
"""Leads of the drums' damping in s."""

AT_REST = 12
"""Draws whose loops are looked at."""


def leads() -> str:
    """What a lead of the drums' damping does to margins at rest and to the error, with gains tuned in `site`."""
    tuned = dw.load(Path(__file__).parents[1] / "independent" / "tuned_in_site.toml")
    rows = []
    for lead in LEADS:
        own = dw.override(tuned, both(gain__lead=lead))
        ensemble = dw.load_ensemble("site", own)
        drawn = [ensemble.scenario(index, DRAWN_WITH).experiment for index in range(AT_REST)]
        survey = [
            dw.margins(dw.linear_open_loop(each, share * each.plant.track.length, opening=opening))
            for each in (own, *drawn)
            for share in (0.05, 0.5, 0.95)
            for opening in ("tau_1", "tau_2")
        ]
        result = dw.run_ensemble(ensemble, DRAWS, seed=DRAWN_WITH)
        least = [
            np.array([(1e3 * each.delay, each.disk) for each in some if each.stable]).min(axis=0)
            for some in (survey[:6], survey)
        ]
        rows.append(
            [
                f"{1e3 * lead:g}",
                *(f"{value:.2g}" for each in least for value in each),
                f"{sum(not each.stable for each in survey)} of {len(survey)}",
                f"{1e3 * math.sqrt(np.nanmean(result.metrics['mse'])):.3f}",
                f"{np.nanmean(result.metrics['chatter']):.2f}",
            ]
        )
    margins = ["delay margin (ms)", "disk margin", f"least of {AT_REST} drawn machines (ms)", "disk margin there"]
    return markdown(["lead (ms)", *margins, "unstable", "root mean MSE (mm)", "chatter (N)"], rows)
