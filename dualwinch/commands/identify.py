"""The command ``identify``: a machine's numbers from its logs, as tables, files for other commands, and drawn."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dualwinch.codegen.files import atomic
from dualwinch.commands.doctor import versions
from dualwinch.commands.output import check_folder, terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.config.ensemble_file import ensemble_to_toml, load_ensemble, reset
from dualwinch.config.experiment_file import experiment_from, to_toml
from dualwinch.config.toml_text import parse_assignment
from dualwinch.identification.identify import identify
from dualwinch.identification.result import IdentificationResult
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.file_formats import format_of


def run_identify(
    logs: Sequence[Path],
    fit: Sequence[str],
    case: int | None,
    config: Path | None,
    assignments: Sequence[str],
    *,
    ensemble: str | None,
    priors: Sequence[str],
    columns: Sequence[str],
    hold_out: str,
    starts: int,
    seed: int,
    profiles: Sequence[str],
    disturbance: Path | None,
    unrecorded: str,
    out: Path | None,
    plot: Path | None,
) -> None:
    """Fit, print, write. Everything that can be wrong with words is found before anything is read.

    Raises:
        ConfigurationError: anything wrong with a file, a key, a value or a log.
        KeyboardInterrupt: interrupted; nothing is written.
    """
    share, most = _share("--hold-out", hold_out), _share("--unrecorded", unrecorded)
    known = dict(map(prior_from, priors))
    if out and out.suffix.lower() != ".toml":
        raise ConfigurationError(f"--out {out}: must end in .toml")
    if disturbance:
        format_of(disturbance)
        check_folder(disturbance.parent)
    experiment, drawn = believed_from(case, config, ensemble, assignments)
    console = terminal(stderr=True)
    with ProgressLine("fitting") as progress:
        found = identify(
            list(logs),
            fit,
            experiment,
            ensemble=drawn,
            priors=known,
            columns=columns,
            hold_out=share,
            starts=starts,
            seed=seed,
            profiles=profiles,
            forces=disturbance is not None,
            unrecorded=most,
            progress=progress,
        )
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    written = [*(write_identified(out, found, seed) if out else []), *([plot] if plot else [])]
    written += write_forces(disturbance, found) if disturbance else []
    if plot:
        from dualwinch.simulation.plots import save

        save(found.plot(), plot)
    for file in written:
        console.print(f"wrote {file}", soft_wrap=True, highlight=False)


def believed_from(
    case: int | None, config: Path | None, ensemble: str | None, assignments: Sequence[str]
) -> tuple[Experiment | None, Ensemble | None]:
    """What words say that is believed: an experiment or an ensemble.

    Raises:
        ConfigurationError: both, or anything wrong with one.
    """
    if not ensemble:
        return experiment_from(case, config, None, assignments), None
    if case is not None or config:
        raise ConfigurationError("give --ensemble, which has an experiment of its own, or --case or --config")
    return None, reset(load_ensemble(ensemble), dict(map(parse_assignment, assignments)))


def write_forces(file: Path, found: IdentificationResult) -> list[Path]:
    """Write the force on the vehicle in each log, as ``disturbance.force.file`` takes it.

    Returns:
        The files: the one, or of several logs NAME-1, NAME-2, ...
    """
    many = len(found.forces) > 1
    files = [file.with_stem(f"{file.stem}-{k}") if many else file for k in range(1, len(found.forces) + 1)]
    for path, force in zip(files, found.forces, strict=True):
        format_of(path).write(force.content, path)
    return files


def write_identified(out: Path, found: IdentificationResult, seed: int) -> list[Path]:
    """Write the machine, the ensemble of machines that the logs allow for, and all numbers as JSON.

    Returns:
        The files.
    """
    beside = out.with_name(f"{out.stem}-ensemble.toml"), out.with_suffix(".json")
    record = found.to_record() | {f"version_{name}": version for name, version in versions().items()}
    texts = (
        to_toml(found.experiment),
        ensemble_to_toml(found.ensemble(out.stem, seed)),
        json.dumps(record, indent=1, allow_nan=False) + "\n",
    )
    files = [out, *beside]
    for file, text in zip(files, texts, strict=True):
        with atomic(file) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    return files


def _share(option: str, text: str) -> float:
    parts = re.fullmatch(r"\s*([0-9.]+)\s*(%?)\s*", text)
    try:
        value = float(parts[1]) / (100 if parts[2] else 1) if parts else -1.0
    except ValueError:
        value = -1.0
    if not 0 <= value < 1:
        raise ConfigurationError(f"{option} {text}: must be 0% to less than 100%, e.g. 20%")
    return value


def prior_from(text: str) -> tuple[str, tuple[float, float]]:
    """A key with mean and deviation, from a text such as ``plant.vehicle.mass=1e4±500``.

    Raises:
        ConfigurationError: anything else.
    """
    parts = re.fullmatch(r"\s*([\w.]+)\s*=\s*(\S+?)\s*(?:±|\+-)\s*(\S+)\s*", text)
    values: Any = (parts[2], parts[3]) if parts else ("", "")
    try:
        mean, deviation = map(float, values)
    except ValueError:
        mean = deviation = -1.0
    if not parts or not 0 < deviation < float("inf") or abs(mean) == float("inf"):
        raise ConfigurationError(f"--prior {text}: must be KEY=MEAN±DEVIATION, e.g. plant.vehicle.mass=1e4±500")
    return parts[1], (mean, deviation)
