"""From logs to a machine: the library's call, with files and names in the place of objects."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.identification import identify as fitting
from dualwinch.identification.doubts import ANOTHER
from dualwinch.identification.log import Log, log_of
from dualwinch.identification.log_file import column_map, read_log
from dualwinch.identification.result import Identified
from dualwinch.identification.unknowns import Prior, keys_of
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.run import Run

Source = Log | Run | str | PathLike[str]


def identify(
    logs: Source | Sequence[Source],
    keys: str | Sequence[str],
    experiment: Experiment | None = None,
    *,
    ensemble: str | PathLike[str] | Ensemble | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    columns: Sequence[str] = (),
    hold_out: float = 0.0,
    starts: int = 1,
    seed: int = 0,
    profiles: str | Sequence[str] = (),
    forces: bool = False,
    unrecorded: float = ANOTHER,
    threads: int | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Identified:
    """Find out what some numbers of a machine are from what its sensors said.

    Logged torques drive the plant, an extended Kalman filter predicts all readings one sample ahead, and the numbers
    are those with which it is surprised least.

    Args:
        logs: of one machine: files (CSV, Parquet, MATLAB, NumPy), results with ``simulation.readings``, or `Log`.
        keys: what to fit, such as ``plant.vehicle.mass`` or ``plant.rope_*.modulus``.
        experiment: what is believed: everything that is not fitted, and where the search begins; default: the
            ensemble's, or ``Experiment()``.
        ensemble: name or file of an ensemble, such as ``rig``: what it draws that a log can tell is fitted as well,
            with what it says of it known beforehand.
        priors: key → mean and standard deviation of what is known beforehand.
        columns: of files, such as ``F1=load_cell_left:kN``, where they go by other names or units.
        hold_out: share of each log, its end, that is not fitted but predicted.
        starts: searches from different starts; all but the first are drawn.
        seed: of these draws.
        profiles: some of what is fitted, whose likelihood is followed away from the best.
        forces: whether to find out as well what acted on the vehicle and nobody recorded: `forces` of what comes back,
            for ``disturbance.force``.
        unrecorded: torque or force that nobody recorded, over the recorded one, from which on a fit is refused: the log
            is of another machine, or the model lacks something.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Returns:
        Estimates with deviations and correlations, what the logs cannot tell, and whether what is left is noise. It
        has a table as text and in a notebook; `experiment` and `ensemble` go on from there.

    Raises:
        ConfigurationError: anything wrong with a file, a key or a prior, or a log that no such machine can have made.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    believed, wanted, given = believed_of(keys, experiment, ensemble, priors)
    sources = [logs] if isinstance(logs, (Log, Run, str, PathLike)) else list(logs)
    map_ = column_map(columns)
    return fitting.identify(
        [_log(source, map_) for source in sources],
        wanted,
        believed,
        priors=given,
        hold_out=hold_out,
        starts=starts,
        seed=seed,
        profiles=[profiles] if isinstance(profiles, str) else profiles,
        forces=forces,
        unrecorded=unrecorded,
        threads=threads,
        progress=progress,
    )


def believed_of(
    keys: str | Sequence[str],
    experiment: Experiment | None,
    ensemble: str | PathLike[str] | Ensemble | None,
    priors: Mapping[str, tuple[float, float]] | None,
) -> tuple[Experiment, tuple[str, ...], dict[str, Prior]]:
    """What is believed, all keys that are fitted, and what is known of them beforehand; arguments as of `identify`.

    Raises:
        ConfigurationError: an ensemble that cannot be read, or a key that no log tells.
    """
    known = load_ensemble(ensemble) if isinstance(ensemble, (str, PathLike)) else ensemble
    believed = experiment or (known.experiment if known else Experiment())
    wanted = keys_of([keys] if isinstance(keys, str) else keys, believed)
    given = {key: Prior(*prior) for key, prior in (priors or {}).items()}
    if known:
        given = priors_of(known, believed, beside=(*wanted, *given)) | given
    return believed, (*wanted, *(key for key in given if key not in wanted)), given


def priors_of(ensemble: Ensemble, believed: Experiment, beside: Sequence[str] = ()) -> dict[str, Prior]:
    """What an ensemble says of the numbers that it draws and a log can tell: mean and deviation of the draws.

    Args:
        ensemble: says it.
        believed: gives nominal values.
        beside: keys that it says nothing of.
    """
    values, known = leaves(believed), set(keys_of(["*"], believed)) - set(beside)
    found = {}
    for key, drawn in ensemble.distributions.items():
        if key in known:
            shares = [(index + 0.5) / SHARES for index in range(SHARES)]
            draws = [float(drawn.value(share, values[key])) for share in shares]
            mean = sum(draws) / SHARES
            found[key] = Prior(mean, (sum((draw - mean) ** 2 for draw in draws) / SHARES) ** 0.5)
    return found


SHARES = 200
"""Quantiles that mean and deviation of a distribution are taken of."""


def _log(source: Source, columns: Mapping) -> Log:
    if isinstance(source, Log):
        return source
    return log_of(source) if isinstance(source, Run) else read_log(str(source), columns)
