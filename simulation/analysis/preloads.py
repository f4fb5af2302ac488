"""A run with four preloads side by side: constant, the best constant one, scheduled, and the least there could be."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dualwinch.controllers.coordinations.coordination import Coordination
from dualwinch.controllers.coordinations.differential_tension import DifferentialTension
from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.analysis.least_preload import Least, LeastPreload, least_preload
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate

MEASURE: dict[Least, str] = {"load": "continuous_load", "peak": "peak_tension", "energy": "energy"}
"""What is to be least → its figure of merit."""

CONSTANTS = 96
"""Constant preloads that are tried, evenly between what the limits allow."""

AS_GOOD = 1.01
"""Mean square error, over that of the schedule, up to which a constant preload counts as good as that."""


@dataclass(frozen=True)
class Preloads:
    """The four of them.

    Attributes:
        measure: figure of merit that is to be least.
        constant: the run with the constant preload that the experiment has.
        best: that with the constant preload of least measure whose error is that of the schedule and whose smallest
            tension no smaller; ``None`` where no constant preload comes to that.
        scheduled: the run of the experiment.
        least: what no controller goes below that keeps the vehicle as near to its reference as was asked for.
    """

    measure: str
    constant: Result
    best: Result | None
    scheduled: Result
    least: LeastPreload

    @property
    def saved(self) -> float:
        """Share of what the least preload saves against the best constant one that the schedule saves; NaN without."""
        if self.best is None:
            return np.nan
        best, scheduled = (result.metrics[self.measure] for result in (self.best, self.scheduled))
        return float((best - scheduled) / (best - getattr(self.least, self.measure)))


def preloads(
    experiment: Experiment,
    least: Least = "load",
    *,
    error: float = 0.0,
    torque_rate: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Preloads:
    """Run an experiment whose preload is scheduled, and what it is to be compared with.

    Args:
        experiment: its coordination is the schedule. With constant preloads all else is the same, gains of the winches
            among it.
        least: ``load``, ``peak`` or ``energy``: what decides.
        error: of the optimum, the largest distance from the reference in m.
        torque_rate: of the optimum, the largest rate of each motor torque in N m/s (default: any).
        progress: called now and then with the share that is done.

    Raises:
        ConfigurationError: the preload is not scheduled, or a value is out of its range.
        DualwinchError: no tensions within the limits give the motion, or there is no compiler.
    """
    schedule = experiment.controller.coordination
    if not isinstance(schedule, ScheduledPreload):
        raise ConfigurationError(
            f'controller.coordination.kind = "{schedule.kind}": must be "{ScheduledPreload.kind}" here'
        )
    say = progress or (lambda _share: None)
    bound = least_preload(experiment, least, error=error, torque_rate=torque_rate)
    say(0.3)
    scheduled = simulate(experiment)
    constant = _with(experiment, DifferentialTension(schedule.winch_1, schedule.winch_2))
    as_it_is = simulate(constant)
    say(0.5)
    preload = _best_constant(constant, scheduled, MEASURE[least], lambda share: say(0.5 + 0.4 * share))
    best = None
    if preload is not None:
        limits = replace(constant.controller.limits, preload=preload)
        best = simulate(replace(constant, controller=replace(constant.controller, limits=limits)))
    say(1.0)
    return Preloads(MEASURE[least], as_it_is, best, scheduled, bound)


def _with(experiment: Experiment, coordination: Coordination) -> Experiment:
    return replace(experiment, controller=replace(experiment.controller, coordination=coordination))


def _best_constant(
    experiment: Experiment, scheduled: Result, measure: str, progress: Callable[[float], None]
) -> float | None:
    """The constant preload in N of least measure that is as good as the schedule; ``None``: there is none."""
    limits = experiment.controller.limits
    tried = np.linspace(2 * limits.tension_min, 2 * limits.command_max, CONSTANTS + 2)[1:-1]
    batch = rollout(["controller.coordination.preload"], tried[:, None], [experiment], progress=progress)
    found = {name: values[:, 0] for name, values in batch.metrics.items()}
    good = found["mse"] <= AS_GOOD * scheduled.metrics.mse
    good &= found["min_tension"] >= scheduled.metrics.min_tension
    if not good.any():
        return None
    return float(tried[np.where(good, found[measure], np.inf).argmin()])
