"""What a run that nobody has made yet would tell: the information of its simulated log."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.excitation.motions import Room
from dualwinch.identification.fit import Fitting, covariance_of
from dualwinch.identification.log import log_of
from dualwinch.identification.sections import sections_of
from dualwinch.identification.unknowns import Unknown
from dualwinch.model.reference import Reference
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.run import Run
from dualwinch.simulation.simulate import simulate

Floats = NDArray[np.float64]

SLACK = 5e-3
"""Share of a run in which a rope may be without tension: by noise, at rest."""

OVERSHOOT = 0.05
"""Share by which the vehicle's speed may exceed that of the reference."""


@dataclass(frozen=True, eq=False)
class Expected:
    """What is to be expected of a run.

    Attributes:
        covariance: (p, p) of the estimates' errors, with what is known beforehand; None: the run leaves its limits.
        violation: by which share it leaves its limits; 0: not.
        words: which limit that is; empty: none.
    """

    covariance: Floats | None
    violation: float
    words: str


def moved(experiment: Experiment, reference: Reference, duration: float) -> Experiment:
    """An experiment with another motion, whose rows hold what the sensors say."""
    simulation = replace(experiment.simulation, duration=duration, readings=True)
    return replace(experiment, reference=reference, simulation=simulation)


def expected(experiment: Experiment, unknowns: Sequence[Unknown], room: Room | None) -> Expected:
    """What a fit to a run's log would tell, were the experiment the truth.

    Args:
        experiment: of `moved`.
        unknowns: what would be fitted.
        room: limits; None: any run will do.
    """
    run = simulate(experiment)
    violation, words = _violation(run, room) if room else (0.0, "")
    if run.outcome != "completed":
        violation, words = 1.0, f"the run {run.outcome.replace('_', ' ')}"
    if violation:
        return Expected(None, violation, words)
    fitting = Fitting(sections_of([log_of(run)], experiment), experiment, unknowns, threads=1)
    information = fitting.information(np.array([unknown.start for unknown in unknowns]))
    if information is None:
        return Expected(None, 1.0, "a filter goes astray")
    return Expected(covariance_of(information, unknowns), 0.0, "")


def _violation(run: Run, room: Room) -> tuple[float, str]:
    """By which share a run leaves its limits the furthest, and which limit that is."""
    peak, slack = float(run.metrics.peak_tension), float(run.metrics.slack_share)
    torque = max(float(np.abs(run[name]).max()) for name in ("tau_1", "tau_2"))
    speed, fastest = float(np.abs(run["v"]).max()), (1 + OVERSHOOT) * room.speed
    found = [
        (peak / room.tension - 1, f"a rope's tension of {peak:.4g} N: must be <= {room.tension:g} N"),
        (torque / room.torque - 1, f"a motor's torque of {torque:.4g} N m: must be <= {room.torque:g} N m"),
        (speed / fastest - 1, f"a speed of {speed:.3g} m/s: must be <= {fastest:.3g} m/s"),
        (slack - SLACK, f"a rope without tension for {slack:.2%} of the run: must be <= {SLACK:.1%}"),
    ]
    worst = max(found, key=lambda each: each[0])
    return worst if worst[0] > 0 else (0.0, "")
