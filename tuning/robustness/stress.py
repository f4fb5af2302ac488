"""What breaks first: gains under imperfections that are made larger, beside the paper's."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any

from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.tuning.baseline import baseline_controller, is_baseline
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.robustness.imperfections import imperfections, union
from dualwinch.tuning.robustness.limits import constraints_of
from dualwinch.tuning.robustness.result import RobustnessResult
from dualwinch.tuning.robustness.run import PAPER
from dualwinch.tuning.robustness.run import stress as run

NO_BASE = "none"
"""Stands for the experiment itself, without any ensemble."""

SCENARIOS = 20
"""Scenarios of every size where nothing else is asked for."""

ENSEMBLE, KIND = "rig", "sea"
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
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> RobustnessResult:
    """Find out which imperfection breaks an experiment's gains first, and at which size; likewise the paper's.

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
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Returns:
        What was found; it has a table as text and in a notebook, and `plot`.

    Raises:
        ConfigurationError: anything wrong with a key, a value, an ensemble or a constraint, or no imperfection.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    kind, harsh = base_and_ensemble(experiment, ensemble, base, settings or {})
    own = experiment.controller
    controllers = {PAPER: baseline_controller(own)}
    if not is_baseline(own):
        if name == PAPER:
            raise ConfigurationError(f"name = {name}: stands for the paper's gains; give another")
        controllers[name] = own
    return run(
        controllers,
        kind,
        harsh,
        constraints_of(constraints, noted, harsh.experiment),
        scenarios=scenarios,
        seed=seed,
        threads=threads,
        progress=progress,
    )


def check_stress(problem: TuningProblem) -> None:
    """Find out now whether there is an imperfection that the gains of a problem are not tuned for.

    Raises:
        ConfigurationError: there is none, or gains are drawn.
    """
    base, ensemble = base_and_ensemble(problem.experiment, ENSEMBLE, _base_of(problem))
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
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> RobustnessResult:
    """`stress` for the best of a tuning problem: on top of what it was tuned in, under the problem's constraints."""
    return stress(
        best,
        ensemble=ENSEMBLE,
        base=_base_of(problem),
        noted=[constraint.text for constraint in problem.constraints],
        scenarios=scenarios or SCENARIOS,
        seed=problem.seed,
        name=name,
        threads=threads,
        progress=progress,
    )


def _base_of(problem: TuningProblem) -> Ensemble | str | None:
    """What the gains were tuned in, without the imperfections."""
    tuned_in = problem.ensemble
    return KIND if tuned_in and tuned_in.name == ENSEMBLE else tuned_in


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
    """An experiment without what it has of an ensemble, such as gains that were tuned in it: that is to be added."""
    plain = Experiment()
    asked = ensemble.experiment if isinstance(ensemble, Ensemble) else load_ensemble(ensemble, plain).experiment
    usual, theirs, ours = leaves(plain), leaves(asked), leaves(experiment)
    taken = {key for key, value in theirs.items() if value != usual.get(key) and value == ours.get(key)}
    return override(
        experiment,
        {key: usual[key] for key in taken if key in usual and not key.startswith(("controller.", "metrics"))},
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
