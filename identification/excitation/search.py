"""The motion that makes numbers visible: CMA-ES over way-points, led by the information of simulated logs.

D-optimal motions keep the volume of the estimates' joint confidence region small, A-optimal ones the mean of their
variances, each over what is believed (Pukelsheim, Optimal Design of Experiments; Goodwin and Payne, Dynamic System
Identification: Experiment Design and Data Analysis).
"""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.blind import believed
from dualwinch.identification.excitation.excited import Excited
from dualwinch.identification.excitation.expected import Expected, expected, moved
from dualwinch.identification.excitation.motions import Room, dimensions, motion, moves_in
from dualwinch.identification.unknowns import Prior, Unknown, keys_of, unknowns_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.reference import Reference, own_duration
from dualwinch.simulation.batch.threads import run_all
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]
Criterion = Literal["D", "A"]

SIGMA = 0.3
"""First standard deviation, in shares of each range."""

OUTSIDE = 1e3
"""Added to how far a motion leaves its limits, to be worse than any that keeps to them."""

SHORTEST, LONGEST = 5.0, 3600.0
"""Duration in s of a run."""


def excite(
    keys: Sequence[str],
    experiment: Experiment,
    room: Room,
    *,
    duration: float = 60.0,
    criterion: Criterion = "D",
    priors: dict[str, Prior] | None = None,
    trials: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Excited:
    """Find a motion whose log tells some numbers well.

    Args:
        keys: what is to be fitted, as for `identification.identify.identify`.
        experiment: what is believed of the machine, its sensors and the sea; its controller carries the motion out.
        room: limits of the run.
        duration: of the run in s.
        criterion: ``D``: the volume of the estimates' confidence region; ``A``: the mean of their variances.
        priors: key → what is known beforehand.
        trials: motions that are simulated; default: 200, or any number within `seconds`.
        seconds: time after which no further generation of motions begins.
        seed: of the search.
        threads: default: one a core.
        progress: called after every generation with the share that is done.

    Raises:
        ConfigurationError: nothing to fit, an option out of range, or no motion within the limits.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    import cmaes

    began = perf_counter()
    if not SHORTEST <= duration <= LONGEST:
        raise ConfigurationError(f"duration = {duration:g}: must be {SHORTEST:g} to {LONGEST:g} s")
    if criterion not in {"D", "A"}:
        raise ConfigurationError(f"criterion = {criterion}: must be D or A")
    if trials is not None and trials < 1:
        raise ConfigurationError(f"trials = {trials}: must be >= 1")
    trials = trials or (200 if seconds is None else None)
    unknowns = unknowns_of(keys_of(keys, experiment), experiment, priors or {})
    present = expected(_present(experiment, duration), unknowns, None)
    size = dimensions(moves_in(duration))
    strategy = cmaes.CMA(np.full(size, 0.5), SIGMA, np.tile([0.0, 1.0], (size, 1)), seed=seed)
    best: tuple[float, Reference | None, Expected] = (np.inf, None, Expected(None, np.inf, "no time for any motion"))
    tried = 0
    while (trials is None or tried < trials) and (seconds is None or perf_counter() - began < seconds or not tried):
        points = [strategy.ask() for _ in range(strategy.population_size)]
        found: list[tuple[float, Reference | None, Expected]] = [best] * len(points)

        def look(index: int, points: list[Floats] = points, found: list = found) -> None:
            reference = motion(points[index], room, duration)
            there = (
                expected(moved(experiment, reference, duration), unknowns, room)
                if reference
                else Expected(None, 2.0, "no time for any motion")
            )
            found[index] = _worth(there, unknowns, criterion), reference, there

        if not run_all([lambda index=index: look(index) for index in range(len(points))], threads):
            raise KeyboardInterrupt
        strategy.tell([(point, each[0]) for point, each in zip(points, found, strict=True)])
        best, tried = min([best, *found], key=lambda each: each[0]), tried + len(points)
        spent = 0.0 if seconds is None else (perf_counter() - began) / seconds
        progress(min(max(spent, 0.0 if trials is None else tried / trials), 1.0))
    _, reference, there = best
    if reference is None or there.covariance is None:
        raise ConfigurationError(f"no motion of {tried} keeps to the limits; the nearest has {there.words}")
    return Excited(
        experiment=moved(experiment, reference, duration),
        unknowns=unknowns,
        covariance=there.covariance,
        present=present.covariance,
        criterion=criterion,
        duration=duration,
        tried=tried,
        seed=seed,
        seconds=perf_counter() - began,
    )


def _present(experiment: Experiment, duration: float) -> Experiment:
    """The experiment as it is, for the same time; for its own where its motion would leave the track by then."""
    from dualwinch.simulation.check import check

    longer = moved(experiment, experiment.reference, duration)
    try:
        check(longer)
    except ConfigurationError:
        return moved(experiment, experiment.reference, min(own_duration(experiment.reference), duration))
    return longer


def _worth(there: Expected, unknowns: Sequence[Unknown], criterion: Criterion) -> float:
    """How bad a motion is: the logarithm of a typical standard deviation over what is believed."""
    if there.covariance is None:
        return OUTSIDE + there.violation
    by = believed(unknowns)
    scaled = there.covariance / np.outer(by, by)
    if criterion == "A":
        return float(np.log(np.mean(np.diag(scaled))) / 2)
    return float(np.linalg.slogdet(scaled)[1] / (2 * len(by)))
