"""A tuning problem from command-line arguments, and as a record that a study keeps."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from dualwinch.analysis.design import formula_design, limits_of
from dualwinch.analysis.stability import SLIDING_MODE
from dualwinch.config.distribution_entries import check_range
from dualwinch.config.ensemble_file import (
    built_in_ensembles,
    ensemble_to_toml,
    find_ensemble,
    load_ensemble,
    reset,
)
from dualwinch.config.experiment_file import assigned, experiment_from, own_keys, to_toml
from dualwinch.config.toml_text import flattened, read_source
from dualwinch.controllers.controller import Controller
from dualwinch.model.actuators import is_ideal
from dualwinch.model.arguments import instance, texts, whole_number
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.overloads import SIZES
from dualwinch.model.plant import sags
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.tuning.baseline import (
    DAMPING,
    POSITION_NOISE,
    RESERVE,
    SWINGING,
    default_coordination,
    default_estimator,
    default_reserve,
    further_gains,
    starting_gains,
    swings,
    uncertain_drums,
    undamped,
)
from dualwinch.tuning.constraints import (
    DEFAULT_OBJECTIVES,
    OVERLOADED_OBJECTIVES,
    constraints_with,
    default_constraints,
    objectives_from,
)
from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.problem import AS_DESCRIBED, DESIGNED, TuningProblem
from dualwinch.tuning.space import entry_from, space_of, space_to_record
from dualwinch.tuning.storage.parts import part_records

DESIGN_FACTOR = 10.0
"""Factor of a search's bounds above and below the gains that are designed for a machine."""

ESTIMATOR = "controller.estimator"
COORDINATION = "controller.coordination.kind"


def tuning_problem(
    experiment: Experiment | None = None,
    *,
    case: int | None = None,
    config: str | Path | None = None,
    settings: Sequence[str] = (),
    ensemble: str | Path | Ensemble | None = None,
    space: Sequence[str] = (),
    objectives: Sequence[str] = (),
    constraints: Sequence[str] | None = None,
    scenarios: int | None = None,
    seed: int = 0,
    excluded: Collection[str] = (),
    violation: float | None = None,
    confidence: float | None = None,
    options: TuningOptions | None = None,
    starts: Sequence[Controller] = (),
) -> TuningProblem:
    """Make a tuning problem for `dualwinch.tune` from the arguments of the command ``dualwinch tune``.

    With an ensemble the estimator is the calibrating Kalman filter, since sensors are noisy and ropes differ from the
    nominal ones. Where drums, encoder zeros or the position sensor are uncertain, as in ``rig``, or ropes sag, it is
    the self-calibrating filter. Where drums swing on their ropes (`dualwinch.tuning.baseline.swings`), with an ensemble
    or without, fast force is shared by tension, and gains start from those that are designed for the machine
    (`dualwinch.designed`). Parts and gains that a file or a setting names stay as they are, and so does a whole
    `experiment`. `TuningProblem.choices` names what was chosen. A search for all gains of the sliding-mode law in an
    ensemble, or on such a machine, begins with the better of this start and the verified design.

    Args:
        experiment: an experiment to start from, as it is, possibly with parts of your own.
        case: one of the paper's cases to start from.
        config: a configuration file to start from.
        settings: such as ``controller.estimator=none``.
        ensemble: name or file of an ensemble, whose nominal values replace those of the experiment, case or file; or an
            ensemble of your own, with the experiment's controller; ``None``: the experiment is the only scenario.
        space: such as ``controller.nftsm.beta`` or ``controller.observer.l0=1:50:log``; default: every gain in use.
        objectives: statistics to minimise; default: ``mean.mse``, or ``geomean.mse`` where overloads are drawn.
        constraints: such as ``mean.chatter<=0.25*paper``. They add to the default ones (no slack, no peak, little
            chatter and, in an ensemble, stability margins); one on the same statistic replaces it. ``none`` among them,
            or an empty list, drops the default ones.
        scenarios: number of training scenarios drawn from the ensemble.
        seed: of scenarios and search.
        excluded: keys excluded from the space; they keep the values of `settings`.
        violation: largest probability that a draw of the ensemble violates a bound on the worst case; default: from
            `options`.
        confidence: of the statement that the best stays below `violation`; default: from `options`.
        options: parameters of the method.
        starts: controllers of the same parts, from whose gains the search may begin as well; the better begins.

    Raises:
        ConfigurationError: an invalid key, value, space, objective or constraint.

    Example:
        >>> import dualwinch as dw
        >>> problem = dw.tuning_problem(case=4, space=["controller.nftsm.beta", "controller.observer.l0=1:50:log"])
        >>> problem.space.names
        ('controller.nftsm.beta', 'controller.observer.l0')
    """
    instance("experiment", experiment, Experiment, optional=True)
    values = assigned(texts("settings", settings))
    config = None if config is None else Path(config)
    if experiment is not None and (case is not None or config is not None):
        raise ConfigurationError("experiment: give it alone, without case or config")
    base, reasons = experiment or experiment_from(case, config, None, []), list[str]()
    design = dict[str, float]()
    named = None if experiment else {*values, *named_keys(config), *named_keys(ensemble)}
    draws = machines = _ensemble(ensemble, base, experiment is case is config is None)
    if draws is None:
        base = override(base, values)
        for name, option in (("scenarios", scenarios), ("violation", violation), ("confidence", confidence)):
            if option is not None:
                raise ConfigurationError(f"--{name}: needs --ensemble; without one there is a single run, and no draws")
        machines = Ensemble("this machine", "", base, {}) if swings(base.plant) else None
    if machines is not None:
        if named is not None:
            machines, reasons, design = _with_defaults(machines, values, named)
        else:
            machines = reset(machines, values)
            if keys := undamped(machines.experiment):
                reasons.append(f"gains as the experiment has them, with {' and '.join(keys)} = 0, though {SWINGING}")
        for key, distribution in machines.distributions.items():
            check_range(key, distribution, machines.experiment)
        base = machines.experiment
        draws = None if draws is None else machines
    options = _certified(options or TuningOptions(), violation, confidence)
    count = options.draws if scenarios is None else scenarios
    whole_number("scenarios", count, 1)
    whole_number("seed", seed)
    swinging = swings(base.plant)
    overloads = any(leaves(base).get(key) or (draws and key in draws.distributions) for key in SIZES)
    defaults = default_constraints(
        draws is not None,
        lag=not is_ideal(base.actuator),
        swinging=swinging,
        resonance=swinging and isinstance(base.controller.law, SLIDING_MODE),
        own=draws is not None and draws.name not in built_in_ensembles(),
        overloads=overloads,
    )
    objectives = objectives or (OVERLOADED_OBJECTIVES if overloads else DEFAULT_OBJECTIVES)
    minimised = objectives_from(objectives, base.metrics)
    bounded = constraints_with(constraints, defaults, base)
    gains = space_of(_entries(space), base, further_gains(machines) if machines else None).without(excluded)
    if not space:
        gains = gains.around(design, DESIGN_FACTOR)
    designable = machines is not None and not space and isinstance(base.controller.law, SLIDING_MODE)
    problem = TuningProblem(
        experiment=base,
        ensemble=draws,
        space=gains,
        objectives=minimised,
        constraints=bounded,
        scenarios=count if draws else 1,
        seed=seed,
        options=options,
        choices=tuple(reasons),
        starts=tuple(starts),
        fixed=tuple(sorted(named.difference(gains.keys))) if designable and named is not None else None,
        start_words=DESIGNED if design else AS_DESCRIBED,
    )
    problem.check()
    return problem


def _certified(options: TuningOptions, violation: float | None, confidence: float | None) -> TuningOptions:
    """Options with other probabilities."""
    probabilities = {"violation": violation, "confidence": confidence}
    return replace(options, **{name: value for name, value in probabilities.items() if value is not None})


def named_keys(file: str | Path | Ensemble | None) -> Collection[str]:
    """Keys given in a configuration file, or in that of an ensemble; none for an ensemble itself."""
    if file is None or isinstance(file, Ensemble):
        return ()
    return own_keys(file if isinstance(file, Path) else find_ensemble(file))


def _ensemble(ensemble: str | Path | Ensemble | None, base: Experiment, alone: bool) -> Ensemble | None:
    """An ensemble around an experiment; one that is given alone keeps its own controller."""
    if not isinstance(ensemble, Ensemble):
        return None if ensemble is None else load_ensemble(ensemble, base)
    return ensemble if alone else ensemble.controlled_as(base)


def _with_defaults(
    ensemble: Ensemble, values: Mapping[str, Any], named: Collection[str]
) -> tuple[Ensemble, list[str], dict[str, float]]:
    """An ensemble with some values set, and default parts and gains where none is named.

    Returns:
        The ensemble, the reasons, and key → value of each gain that is designed for the machine.
    """
    reasons, parts, design = list[str](), dict[str, str](), dict[str, float]()
    where = f"in '{ensemble.name}'" if ensemble.distributions else f"on {ensemble.name}"
    if ESTIMATOR not in named:
        parts[ESTIMATOR] = usual = default_estimator(ensemble)
        causes = ["sensors are noisy"]
        if uncertain_drums(ensemble):
            causes.append("encoder zeros, drums or the position sensor are not exact")
        if sags(ensemble.experiment.plant):
            causes.append("ropes sag")
        reason = f"{where} {', '.join(causes)}" if ensemble.distributions else SWINGING
        reasons.append(f"estimator {usual}: none is named, and {reason}")
    if (sharing := default_coordination(ensemble)) and COORDINATION not in named:
        parts[COORDINATION] = sharing
        reasons.append(f"coordination {sharing}: none is named, and {where} ropes sag between rollers")
    ensemble = reset(ensemble, {**parts, **values})
    gains = {RESERVE: default_reserve(ensemble)} | starting_gains(ensemble)
    started = {key: value for key, value in gains.items() if key not in named}
    if (noise := started.get(POSITION_NOISE)) is not None and noise != leaves(ensemble.experiment)[POSITION_NOISE]:
        reasons.append(f"{POSITION_NOISE} = {noise:g}: noise and rounding of the described position sensor")
    ensemble = reset(ensemble, started)
    if swings(ensemble.experiment.plant):
        experiment = formula_design(ensemble.experiment, kept=named)
        before, after = leaves(ensemble.experiment), leaves(experiment)
        ensemble = replace(ensemble, experiment=experiment)
        design = {key: value for key, value in after.items() if value != before[key]}
        damped = ", ".join(f"{key} = {after[key]:.3g}" for key in DAMPING if key in after and key not in named)
        limit, *_ = limits_of(experiment)
        reasons.append(
            f"gains that no file names are designed for this machine ({damped}), for a bandwidth of {limit}: {SWINGING}"
        )
    return ensemble, reasons, design


def definition_of(problem: TuningProblem, method: str) -> dict[str, Any]:
    """A problem as a record that a study keeps."""
    return {
        "configuration": configuration(problem),
        "ensemble": problem.ensemble.name if problem.ensemble else "",
        "parts": part_records(problem),
        "space": space_to_record(problem.space),
        "objectives": [objective.name for objective in problem.objectives],
        "constraints": [constraint.text for constraint in problem.constraints],
        "scenarios": problem.scenarios,
        "seed": problem.seed,
        "options": asdict(problem.options),
        "method": method,
    }


def configuration(problem: TuningProblem) -> str:
    """Ensemble or experiment as TOML."""
    if problem.ensemble is None:
        return to_toml(problem.experiment)
    return ensemble_to_toml(replace(problem.ensemble, experiment=problem.experiment))


def check_words(text: str) -> None:
    """Raise `ConfigurationError` for an invalid text of ``--space``."""
    if not text.endswith(".toml"):
        entry_from(text)


def _entries(texts: Sequence[str]) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for text in texts:
        if text.endswith(".toml"):
            entries |= _read(Path(text))
        else:
            name, entry = entry_from(text)
            if not name:
                raise ConfigurationError(f"--space {text}: must name a gain")
            entries[name] = entry
    if texts and not entries:
        raise ConfigurationError("--space: is empty; name at least one gain, e.g. --space controller.nftsm.beta")
    return entries


def _read(path: Path) -> dict[str, Any]:
    """Entries of a file's ``[space]`` table: ``controller.nftsm.beta = { lower = 0.005, upper = 5, log = true }``."""
    table = read_source(path).table()
    if not isinstance(table.get("space"), dict) or set(table) != {"space"}:
        raise ConfigurationError(f"{path}: must contain one table, [space]")
    entries: dict[str, Any] = {}
    for key, value in flattened(table["space"]):
        name, _, last = key.rpartition(".")
        if "/" in last:
            entries[key] = value
        elif last in {"lower", "upper", "log"}:
            entries.setdefault(name, {})[last] = value
        elif value is True:
            entries[key] = {}
        else:
            raise ConfigurationError(f"{path}: space.{key}: must be true, or a table of lower, upper and log")
    return entries
