"""Robustness margins of gains, and of the paper's beside them: the size at which each imperfection breaks them."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np

from dualwinch.codegen.drivers.batch import compile_batch
from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.paper_controller import has_paper_gains, paper_controller
from dualwinch.model.arguments import instance, whole_number
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.rollout import BatchResult, ParameterScenarioGrid, run_grid
from dualwinch.simulation.batch.workers import Workers, map_all, threads_of
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.settings import override
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.robustness.imperfections import (
    ALL,
    METHOD,
    Imperfection,
    ScaledEnsemble,
    all_together,
    imperfections,
    union,
)
from dualwinch.tuning.robustness.limits import (
    BrokenLimit,
    RobustnessLimit,
    broken,
    constraints_of,
    failures,
    is_no_measure,
    limits_of,
)
from dualwinch.tuning.robustness.result import PAPER, Breakdown, ImperfectionResult, RobustnessResult
from dualwinch.tuning.robustness.sizes import STEPS, Bisection, SizeRange, joint_range, size, size_range, sizes_at

NO_BASE = "none"
"""Stands for the experiment itself, without any ensemble."""

SCENARIOS = 20
"""Scenarios of every size where nothing else is asked for."""

KEPT_KEYS = ("controller.", "metrics", "plant.")
"""What the keys begin with that an experiment keeps, although an ensemble sets them alike."""

STRESS_ENSEMBLE, BASE_ENSEMBLE = "rig", "sea"
"""Gives the imperfections of tuned gains; and what they come on top of where the gains are tuned with them."""


def stress(
    experiment: Experiment,
    *,
    ensemble: str | PathLike[str] | Ensemble = "rig",
    base: str | PathLike[str] | Ensemble | None = "sea",
    settings: Mapping[str, Any] | None = None,
    constraints: Sequence[str] | None = None,
    noted: Sequence[str] = (),
    scenarios: int = SCENARIOS,
    seed: int = 0,
    name: str = "given",
    workers: Workers = None,
    progress: Progress = no_progress,
) -> RobustnessResult:
    """Robustness margins of an experiment's gains and of the paper's: the size at which each imperfection breaks them.

    An imperfection is what the ensemble draws or sets and the base does not. Each is made larger, alone and all
    together, from a thousandth of its size in the ensemble to a hundred times it, in the same scenarios at every size,
    until the worst of them breaks a constraint.

    Args:
        experiment: its controller is tried; the values of its plant, sea and sensors where the ensembles set none.
        ensemble: name or file of the ensemble that gives the imperfections, on top of the base; or one of your own.
        base: name or file of the ensemble that is kind to the gains, likewise; ``None``: the experiment itself.
        settings: dotted key → nominal value in base and ensemble.
        constraints: such as ``worst.peak_tension<=6000`` or ``mean.chatter<=0.25*paper``, the latter meaning what the
            paper's gains reach in the base; default: those of `noted`, and beside them: no slack rope, no peak beyond
            the limit, no more than four times the paper's mean square error.
        noted: constraints of the study that the gains are from.
        scenarios: of every size.
        seed: of the draws.
        name: what the gains are called.
        workers: of this machine, or an executor; default: one thread a core.
        progress: called now and then with the share that is done.

    Returns:
        What was found; it has a table as text and in a notebook, and `plot`.

    Raises:
        ConfigurationError: anything wrong with a key, a value, an ensemble or a constraint, or no imperfection.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    instance("experiment", experiment, Experiment)
    kind, harsh = base_and_ensemble(experiment, ensemble, base, settings or {})
    own = experiment.controller
    controllers = {PAPER: paper_controller(own)}
    if not has_paper_gains(own):
        if name == PAPER:
            raise ConfigurationError(f"name = {name}: stands for the paper's gains; give another")
        controllers[name] = own
    return breakdowns(
        controllers,
        kind,
        harsh,
        constraints_of(constraints, noted, harsh.experiment),
        scenarios=scenarios,
        seed=seed,
        workers=workers,
        progress=progress,
    )


def check_stress(problem: TuningProblem) -> None:
    """Find out now whether there is an imperfection that the gains of a problem are not tuned for.

    Raises:
        ConfigurationError: there is none, or gains are drawn.
    """
    base, ensemble = base_and_ensemble(problem.experiment, STRESS_ENSEMBLE, _base_of(problem))
    try:
        imperfections(base, union(base, ensemble))
    except ConfigurationError as error:
        raise ConfigurationError(f"--stress: {error}") from error


def stress_tuned(
    problem: TuningProblem,
    best: Experiment,
    *,
    scenarios: int | None = None,
    name: str = "given",
    workers: Workers = None,
    progress: Progress = no_progress,
) -> RobustnessResult:
    """`stress` for the best of a tuning problem: on top of what it was tuned in, under the problem's constraints."""
    return stress(
        best,
        ensemble=STRESS_ENSEMBLE,
        base=_base_of(problem),
        noted=[constraint.text for constraint in problem.constraints],
        scenarios=scenarios or SCENARIOS,
        seed=problem.seed,
        name=name,
        workers=workers,
        progress=progress,
    )


def _base_of(problem: TuningProblem) -> Ensemble | str | None:
    """What the gains were tuned in, without the imperfections."""
    tuned_in = problem.ensemble
    return BASE_ENSEMBLE if tuned_in and tuned_in.name == STRESS_ENSEMBLE else tuned_in


def base_and_ensemble(
    experiment: Experiment,
    ensemble: str | PathLike[str] | Ensemble,
    base: str | PathLike[str] | Ensemble | None,
    settings: Mapping[str, Any] | None = None,
) -> tuple[Ensemble, Ensemble]:
    """Base and ensemble of `stress`, with the controller and the metrics of an experiment.

    Raises:
        ConfigurationError: anything wrong with a key, a value or an ensemble.
    """
    values = dict(settings or {})
    kind = _ensemble(base, _without(ensemble, experiment), values)
    return kind, _ensemble(ensemble, kind.experiment, values)


def _without(ensemble: str | PathLike[str] | Ensemble, experiment: Experiment) -> Experiment:
    """An experiment without what it has of an ensemble in which its gains were tuned: that is to be added.

    Its plant and its method of integration stay: gains for heavy winches have no meaning on light ones.
    """
    plain = Experiment()
    asked = ensemble.experiment if isinstance(ensemble, Ensemble) else load_ensemble(ensemble, plain).experiment
    usual, theirs, ours = leaves(plain), leaves(asked), leaves(experiment)
    taken = {key for key, value in theirs.items() if value != usual.get(key) and value == ours.get(key)}
    return override(
        experiment,
        {key: usual[key] for key in taken - METHOD if key in usual and not key.startswith(KEPT_KEYS)},
    )


def _ensemble(
    asked: str | PathLike[str] | Ensemble | None, experiment: Experiment, values: Mapping[str, Any]
) -> Ensemble:
    """An ensemble with the controller and the metrics of an experiment."""
    if asked is None or asked == NO_BASE:
        return reset(Ensemble(NO_BASE, "", experiment, {}), values)
    if isinstance(asked, Ensemble):
        return reset(asked.controlled_as(experiment), values)
    return reset(load_ensemble(asked, experiment), values)


class ScaledRunner:
    """Runs scenarios, and tells how much of what is expected has been done."""

    def __init__(self, scaling: ScaledEnsemble, expected: int, workers: Workers, progress: Progress) -> None:
        """Set the bench up.

        Args:
            scaling: gives the scenarios.
            expected: number of sizes that will be run, at most.
            workers: of this machine, or an executor; default: one thread a core.
            progress: called now and then with the share that is done.
        """
        self._scaling, self._expected, self._workers, self._progress = scaling, expected, workers, progress
        self._done = 0

    def compile(self, controllers: Iterable[Controller], sizes: Sequence[Mapping[str, float]]) -> None:
        """Compile what scenarios of some sizes are run by, side by side: a compiler takes longer than all their runs.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        first = [self._scaling.scenario(0, controller, each) for controller in controllers for each in sizes]
        loops = dict.fromkeys(ParameterScenarioGrid([], np.empty((1, 0)), [scenario]).loop for scenario in first)
        map_all(compile_batch, list(loops), threads_of(self._workers))

    def run(self, controller: Controller, sizes: Sequence[Mapping[str, float]]) -> list[BatchResult]:
        """What the scenarios of each of some sizes come to.

        Args:
            controller: with the gains.
            sizes: key → size of what is scaled; nothing: the base.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        scenarios = np.empty((len(sizes), self._scaling.count), dtype=object)
        for row, each in enumerate(sizes):
            scenarios[row] = self._scaling.scenarios(controller, each)

        def report(share: float, before: int = self._done) -> None:
            self._progress((before + share * len(sizes)) / self._expected)

        runs = run_grid(scenarios, workers=self._workers, progress=report)
        if runs.interrupted:
            raise KeyboardInterrupt
        self._done += len(sizes)
        return [runs.take(row, axis=0) for row in range(len(sizes))]


HALVINGS = int(math.log2(STEPS))
"""Rounds of a bisection behind its powers of ten."""


def breakdowns(
    controllers: Mapping[str, Controller],
    base: Ensemble,
    ensemble: Ensemble,
    constraints: Sequence[Constraint],
    *,
    scenarios: int,
    seed: int,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> RobustnessResult:
    """Find at which size of each imperfection each of some gains break.

    Each imperfection that the ensemble has and the base does not is made larger, alone and with all the others, until a
    constraint is broken in the scenarios: the same ones, with the same quantiles of every distribution, at every size
    and for all gains. Everything else is the base's.

    Args:
        controllers: name → controller, that with the paper's gains (`PAPER`) among them.
        base: what the imperfections come on top of; its own controller is not used.
        ensemble: gives the imperfections, at size 1.
        constraints: on the gains; factors are on what the paper's gains reach in the base.
        scenarios: how many.
        seed: of the draws.
        workers: of this machine, or an executor; default: one thread a core.
        progress: called now and then with the share that is done.

    Raises:
        ConfigurationError: no imperfection, a count or seed out of range, or a controller that does not fit.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    whole_number("scenarios", scenarios, 1)
    whole_number("seed", seed)
    ensemble = union(base, ensemble)
    scaling = ScaledEnsemble(base, ensemble, imperfections(base, ensemble), scenarios, seed)
    for name, controller in controllers.items():
        _check(scaling, name, controller)
    single = {imperfection: size_range(scaling, imperfection) for imperfection in scaling.single}
    reaches = single | ({all_together(scaling.single): joint_range(scaling, single)} if len(single) > 1 else {})
    sizes = sum(len(reach.steps) + HALVINGS for reach in reaches.values())
    bench = ScaledRunner(scaling, len(controllers) * (1 + sizes), workers, progress)

    def sizes_of(imperfection: Imperfection, step: int) -> dict[str, float]:
        return sizes_at(step, single if imperfection.name == ALL else {imperfection: reaches[imperfection]})

    tried = [sizes_of(imperfection, step) for imperfection, reach in reaches.items() for step in reach.steps]
    bench.compile(controllers.values(), [{}, *tried])
    plain = {name: bench.run(controller, [{}])[0] for name, controller in controllers.items()}
    limits = {name: limits_of(constraints, plain[PAPER], runs) for name, runs in plain.items()}
    lost = {name: failures(limits[name], runs, controllers[name].limits.tension_max) for name, runs in plain.items()}
    if is_no_measure(lost[PAPER]):  # others are held to multiples of what they reach themselves
        limits |= {name: limits_of(constraints, runs, runs) for name, runs in plain.items() if name != PAPER}
    found = {
        name: _breaks(bench, controller, limits[name], reaches, sizes_of)
        for name, controller in controllers.items()
        if not lost[name]
    }
    rows = [
        ImperfectionResult(imperfection, reach, {name: breaks[imperfection] for name, breaks in found.items()})
        for imperfection, reach in reaches.items()
    ]
    progress(1.0)
    return RobustnessResult(scaling, dict(controllers), limits, lost, tuple(rows))


def _check(scaling: ScaledEnsemble, name: str, controller: Controller) -> None:
    try:
        prepare(scaling.scenario(0, controller, {}).experiment)
    except ConfigurationError as error:
        raise ConfigurationError(f"{name}: {error}") from error


def _breaks(
    bench: ScaledRunner,
    controller: Controller,
    limits: Sequence[RobustnessLimit],
    reaches: Mapping[Imperfection, SizeRange],
    sizes_of: Callable[[Imperfection, int], dict[str, float]],
) -> dict[Imperfection, Breakdown]:
    """Search under all imperfections at once: each round is one batch."""
    searches = {imperfection: Bisection(reach.bottom, reach.top) for imperfection, reach in reaches.items()}
    found: dict[tuple[Imperfection, int], tuple[BrokenLimit, ...]] = {}
    while wanted := [(imperfection, step) for imperfection, search in searches.items() for step in search.wanted()]:
        sizes = [sizes_of(imperfection, step) for imperfection, step in wanted]
        for (imperfection, step), runs in zip(wanted, bench.run(controller, sizes), strict=True):
            found[imperfection, step] = broken(limits, runs)
            searches[imperfection].tried[step] = bool(found[imperfection, step])
    return {
        imperfection: Breakdown(
            size=None if search.broken is None else size(search.broken),
            held=0.0 if search.held is None else size(search.held),
            broken=() if search.broken is None else found[imperfection, search.broken],
            monotone=search.monotone,
        )
        for imperfection, search in searches.items()
    }
