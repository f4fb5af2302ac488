"""Robustness margins of gains, compared with the paper's: the size of each imperfection at which they break."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np

from dualwinch.toolbox import (
    ConfigurationError,
    Controller,
    Ensemble,
    Experiment,
    TuningProblem,
    arguments,
    batches,
    compiled,
    ensemble_file,
    executors,
    experiment_file,
    leaves,
    paper_gains,
    preparation,
    progresses,
    settings,
    tuning_constraints,
)
from dualwinch.toolboxes.stress.imperfections import (
    ALL,
    METHOD,
    Imperfection,
    ScaledEnsemble,
    all_together,
    imperfections,
    union,
)
from dualwinch.toolboxes.stress.limits import (
    StressLimit,
    ViolatedLimit,
    constraints_of,
    failures,
    is_no_measure,
    limits_of,
    violated_limits,
    where_paper_is_no_measure,
)
from dualwinch.toolboxes.stress.result import PAPER, ImperfectionResult, RobustnessMargin, StressResult
from dualwinch.toolboxes.stress.sizes import STEPS, Bisection, SizeRange, joint_range, size, size_range, sizes_at

NO_BASE = "none"
"""Stands for the experiment itself, without any ensemble."""

SCENARIOS = 20
"""Default number of scenarios per size."""

KEPT_KEYS = ("controller.", "metrics", "plant.")
"""Prefixes of keys that an experiment keeps even if the ensemble sets the same values."""

STRESS_ENSEMBLE, BASE_ENSEMBLE = "rig", "sea"
"""Ensemble with the imperfections for tuned gains; base for gains that were tuned in that ensemble."""


def stress(
    experiment: Experiment,
    *,
    ensemble: str | PathLike[str] | Ensemble = "rig",
    base: str | PathLike[str] | Ensemble | None = "sea",
    settings: Mapping[str, Any] | None = None,
    constraints: Sequence[str] | None = None,
    study_constraints: Sequence[str] | Mapping[str, float | None] = (),
    scenarios: int = SCENARIOS,
    seed: int = 0,
    name: str = "given",
    workers: executors.Workers = None,
    progress: progresses.Progress = progresses.no_progress,
) -> StressResult:
    """Compute the robustness margins of an experiment's gains and of the paper's, by bisection.

    An imperfection is a value that the ensemble draws or sets and the base does not. Each is scaled, alone and all
    together, from a thousandth to a hundred times its size in the ensemble, with the same scenarios at every size. The
    robustness margin is the smallest size at which the worst scenario violates a constraint.

    Args:
        experiment: with the controller, and with values of plant, sea and sensors that the ensembles do not set.
        ensemble: name or file of the ensemble with the imperfections, on top of the base; or one of your own.
        base: name or file of the ensemble without the imperfections; or one of your own; ``None``: the experiment
            itself.
        settings: dotted key → nominal value in base and ensemble.
        constraints: such as ``worst.peak_tension<=6000`` or ``mean.chatter<=0.25*paper``, a factor on the value with
            the paper's gains in the base; default: `study_constraints`, and on other metrics: no slack rope, no peak
            beyond the limit, and at most four times the paper's mean square error.
        study_constraints: constraints of the study in which the gains were tuned; in a dictionary, each with its bound
            there as a number, for machines where the paper's gains are no measure.
        scenarios: number per size.
        seed: of the draws.
        name: of the gains in the result.
        workers: number of threads of this machine, or an executor; default: one thread per core.
        progress: called repeatedly with the share of the work that is done.

    Returns:
        The robustness margins, with a table as text and in a notebook, and `plot`.

    Raises:
        ConfigurationError: an invalid key, value, ensemble or constraint, or no imperfection.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.

    Example:
        >>> import dualwinch as dw
        >>> run = dw.override(dw.case(4), {"simulation.duration": 2.0})
        >>> mass = {"plant.vehicle.mass": dw.Drawn(dw.Uniform(9e3, 1.1e4))}
        >>> loads = dw.Ensemble("loads", "vehicles of 9 to 11 t", run, mass)
        >>> robustness = dw.stress(run, ensemble=loads, base=None, scenarios=2)
        >>> robustness.ranking[0].imperfection.keys
        ('plant.vehicle.mass',)
    """
    arguments.instance("experiment", experiment, Experiment)
    base_scenes, scenes = base_and_ensemble(experiment, ensemble, base, settings or {})
    controller_of_gains = experiment.controller
    controllers = {PAPER: paper_gains.paper_controller(controller_of_gains)}
    if not paper_gains.has_paper_gains(controller_of_gains):
        if name == PAPER:
            raise ConfigurationError(f"name = {name}: stands for the paper's gains; give another")
        controllers[name] = controller_of_gains
    return breakdowns(
        controllers,
        base_scenes,
        scenes,
        constraints_of(constraints, list(study_constraints), scenes.experiment),
        bounds=study_constraints if isinstance(study_constraints, Mapping) else {},
        scenarios=scenarios,
        seed=seed,
        workers=workers,
        progress=progress,
    )


def check_stress(problem: TuningProblem) -> None:
    """Check that there is an imperfection for which a problem's gains are not tuned.

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
    workers: executors.Workers = None,
    progress: progresses.Progress = progresses.no_progress,
) -> StressResult:
    """`stress` for the best of a tuning problem, with its ensemble as the base, and with its constraints."""
    return stress(
        best,
        ensemble=STRESS_ENSEMBLE,
        base=_base_of(problem),
        study_constraints=[constraint.text for constraint in problem.constraints],
        scenarios=scenarios or SCENARIOS,
        seed=problem.seed,
        name=name,
        workers=workers,
        progress=progress,
    )


def _base_of(problem: TuningProblem) -> Ensemble | str | None:
    """The ensemble in which the gains were tuned, or its base if it has the imperfections itself."""
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
        ConfigurationError: an invalid key, value or ensemble.
    """
    values = dict(settings or {})
    benign = _ensemble(base, _without(ensemble, experiment), values)
    return benign, _ensemble(ensemble, benign.experiment, values)


def _without(ensemble: str | PathLike[str] | Ensemble, experiment: Experiment) -> Experiment:
    """An experiment without the values of the ensemble in which its gains were tuned: these are to be added again.

    Its plant and its method of integration stay: gains for heavy winches do not apply to light ones.
    """
    if isinstance(ensemble, Ensemble):
        ensemble_experiment, keys = ensemble.experiment, leaves(ensemble.experiment).keys()
    else:
        ensemble_experiment = ensemble_file.load_ensemble(ensemble, experiment).experiment
        keys = {settings.current(key) for key in experiment_file.given_keys(ensemble_file.find_ensemble(ensemble))}
    defaults, ensemble_values, values = leaves(Experiment()), leaves(ensemble_experiment), leaves(experiment)
    common = {
        key for key in ensemble_values.keys() & keys if defaults.get(key) != ensemble_values[key] == values.get(key)
    }
    return settings.override(
        experiment, {key: defaults[key] for key in common - METHOD if key in defaults and not key.startswith(KEPT_KEYS)}
    )


def _ensemble(
    choice: str | PathLike[str] | Ensemble | None, experiment: Experiment, values: Mapping[str, Any]
) -> Ensemble:
    """An ensemble with the controller and the metrics of an experiment."""
    if choice is None or choice == NO_BASE:
        return ensemble_file.reset(Ensemble(NO_BASE, "", experiment, {}), values)
    if isinstance(choice, Ensemble):
        return ensemble_file.reset(choice.controlled_as(experiment), values)
    return ensemble_file.reset(ensemble_file.load_ensemble(choice, experiment), values)


class ScaledRunner:
    """Runs scenarios of scaled imperfections, and reports the share that is done of the `expected` number of sizes."""

    def __init__(
        self, scaling: ScaledEnsemble, expected: int, workers: executors.Workers, progress: progresses.Progress
    ) -> None:
        self._scaling, self._expected, self._workers, self._progress = scaling, expected, workers, progress
        self._done = 0

    def compile(self, controllers: Iterable[Controller], sizes: Sequence[Mapping[str, float]]) -> None:
        """Compile the code for scenarios of given sizes, in parallel: that takes longer than all their runs."""
        scenarios = [self._scaling.scenario(0, controller, each) for controller in controllers for each in sizes]
        loops = dict.fromkeys(
            batches.ParameterScenarioGrid([], np.empty((1, 0)), [scenario]).loop for scenario in scenarios
        )
        executors.map_all(compiled.compile_batch, list(loops), executors.threads_of(self._workers))

    def run(self, controller: Controller, sizes: Sequence[Mapping[str, float]]) -> list[batches.BatchResult]:
        """Run the scenarios of each of several sizes, given by scaled key; an empty one is the base."""
        scenarios = np.empty((len(sizes), self._scaling.count), dtype=object)
        for row, each in enumerate(sizes):
            scenarios[row] = self._scaling.scenarios(controller, each)

        def report(share: float, before: int = self._done) -> None:
            self._progress((before + share * len(sizes)) / self._expected)

        runs = batches.run_grid(scenarios, workers=self._workers, progress=report)
        if runs.interrupted:
            raise KeyboardInterrupt
        self._done += len(sizes)
        return [runs.take(row, axis=0) for row in range(len(sizes))]


HALVINGS = int(math.log2(STEPS))
"""Rounds of a bisection after its powers of ten."""


def breakdowns(
    controllers: Mapping[str, Controller],
    base: Ensemble,
    ensemble: Ensemble,
    constraints: Sequence[tuning_constraints.Constraint],
    *,
    bounds: Mapping[str, float | None] | None = None,
    scenarios: int,
    seed: int,
    workers: executors.Workers = None,
    progress: progresses.Progress = progresses.no_progress,
) -> StressResult:
    """Compute the robustness margins of several controllers for each imperfection, by bisection.

    Each imperfection of the ensemble that the base lacks is scaled, alone and with all others, until a constraint is
    violated. Scenarios are the same, with the same quantiles of every distribution, at every size and for all
    controllers, among them the paper's gains (`PAPER`); everything else is the base's, except its own controller.
    Factors in constraints are on the value with the paper's gains in the base. `bounds` are numbers of the study, by
    the constraint's text, for use where these are no measure. Other arguments are as in `stress`.

    Raises:
        ConfigurationError: no imperfection, a count or seed out of range, or a controller that does not suit the plant.
    """
    arguments.whole_number("scenarios", scenarios, 1)
    arguments.whole_number("seed", seed)
    ensemble = union(base, ensemble)
    scaling = ScaledEnsemble(
        base, ensemble, imperfections(base, ensemble), scenarios, seed, tuple(controllers.values())
    )
    for name, controller in controllers.items():
        try:
            preparation.prepare(scaling.scenario(0, controller, {}).experiment)
        except ConfigurationError as error:
            raise ConfigurationError(f"{name}: {error}") from error
    single = {imperfection: size_range(scaling, imperfection) for imperfection in scaling.single}
    reaches = single | ({all_together(scaling.single): joint_range(scaling, single)} if len(single) > 1 else {})
    sizes = sum(len(reach.steps) + HALVINGS for reach in reaches.values())
    runner = ScaledRunner(scaling, len(controllers) * (1 + sizes), workers, progress)

    def sizes_of(imperfection: Imperfection, step: int) -> dict[str, float]:
        return sizes_at(step, single if imperfection.name == ALL else {imperfection: reaches[imperfection]})

    initial_sizes = [sizes_of(imperfection, step) for imperfection, reach in reaches.items() for step in reach.steps]
    runner.compile(controllers.values(), [{}, *initial_sizes])
    base_runs = {name: runner.run(controller, [{}])[0] for name, controller in controllers.items()}
    limits = {name: limits_of(constraints, base_runs[PAPER], {name: runs}) for name, runs in base_runs.items()}
    failed = {
        name: failures(limits[name], runs, controllers[name].limits.tension_max) for name, runs in base_runs.items()
    }
    passing = {name: runs for name, runs in base_runs.items() if not failed[name]}
    left_out: tuple[tuning_constraints.Constraint, ...] = ()
    if is_no_measure(failed[PAPER]) and len(controllers) > 1:  # others are judged by multiples of their own values
        applicable, left_out = where_paper_is_no_measure(constraints, bounds or {})
        limits |= {name: limits_of(applicable, runs, {name: runs}) for name, runs in base_runs.items() if name != PAPER}
    else:  # all by the same bounds
        limits |= dict.fromkeys(passing, limits_of(constraints, base_runs[PAPER], passing))
    margins_of = {
        name: _margins(runner, controller, limits[name], reaches, sizes_of)
        for name, controller in controllers.items()
        if not failed[name]
    }
    rows = [
        ImperfectionResult(imperfection, reach, {name: margins[imperfection] for name, margins in margins_of.items()})
        for imperfection, reach in reaches.items()
    ]
    progress(1.0)
    return StressResult(scaling, dict(controllers), limits, failed, tuple(rows), left_out)


def _margins(
    runner: ScaledRunner,
    controller: Controller,
    limits: Sequence[StressLimit],
    reaches: Mapping[Imperfection, SizeRange],
    sizes_of: Callable[[Imperfection, int], dict[str, float]],
) -> dict[Imperfection, RobustnessMargin]:
    """Bisect for all imperfections at once: each round is one batch."""
    searches = {imperfection: Bisection(reach.bottom, reach.top) for imperfection, reach in reaches.items()}
    violations: dict[tuple[Imperfection, int], tuple[ViolatedLimit, ...]] = {}
    while steps_to_run := [
        (imperfection, step) for imperfection, search in searches.items() for step in search.wanted()
    ]:
        sizes = [sizes_of(imperfection, step) for imperfection, step in steps_to_run]
        for (imperfection, step), runs in zip(steps_to_run, runner.run(controller, sizes), strict=True):
            violations[imperfection, step] = violated_limits(limits, runs)
            searches[imperfection].outcomes[step] = bool(violations[imperfection, step])
    return {
        imperfection: RobustnessMargin(
            size=None if search.breakdown is None else size(search.breakdown),
            held=0.0 if search.held is None else size(search.held),
            violated=() if search.breakdown is None else violations[imperfection, search.breakdown],
            monotone=search.monotone,
        )
        for imperfection, search in searches.items()
    }
