"""Ensemble files: an experiment and a table of distributions, read with errors that name key, file and line."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.resources import as_file, files
from os import PathLike
from pathlib import Path
from typing import Any

from dualwinch.config.distribution_entries import check_range, drawn_from, entry_of, is_entry
from dualwinch.config.experiment_file import from_table, to_toml
from dualwinch.config.plugins import load_entry_points
from dualwinch.config.toml_text import Source, read_source, toml_value
from dualwinch.model.arguments import path_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import unknown
from dualwinch.simulation.ensembles.ensemble import Drawn, Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import current, from_folder, known_keys, override

TUNED_IN, NO_ENSEMBLE = "ensemble", "none"
"""Key of the ensemble at the head of a file of tuned gains, and its value for gains tuned in a single run."""


HEADING = ("name", "description", "base")
"""Keys of the table ``[ensemble]``; `base` names the ensemble whose values and distributions a file continues."""


def built_in_ensembles() -> dict[str, Path]:
    """Name → file of the built-in ensembles."""
    with as_file(files("dualwinch.simulation") / "ensembles") as folder:
        return {file.stem: file for file in sorted(folder.glob("*.toml"))}


def find_ensemble(name: str | PathLike[str]) -> Path:
    """The file of an ensemble, from the name of a built-in one (``sea``, ``rig``, ``site``) or the path of a TOML file.

    Raises:
        ConfigurationError: neither.
    """
    built_in = built_in_ensembles()
    if str(name) in built_in:
        return built_in[str(name)]
    path = path_of("file", name)
    if path.suffix or path.exists():
        return path
    raise ConfigurationError(unknown("ensemble", name, built_in, " (or the path of a TOML file)"))


def load_ensemble(name: str | PathLike[str], base: Experiment | None = None) -> Ensemble:
    """Read an ensemble.

    Args:
        name: of a built-in one (``sea``, ``rig``, ``site``), or the path of a TOML file.
        base: experiment with the values missing from the file (default: ``Experiment()``).

    Raises:
        ConfigurationError: no such ensemble, a file that cannot be read or is no TOML, an unknown key, or a value or
            distribution out of range.

    Example:
        >>> import dualwinch as dw
        >>> rig = dw.load_ensemble("rig")
        >>> rig.name, rig.distributions["plant.vehicle.mass"]
        ('rig', Drawn(distribution=Uniform(low=0.9, high=1.1), relative=True, together=None))
    """
    load_entry_points()
    path = find_ensemble(name)
    return _from_source(read_source(path), base, path.stem)


def loads_ensemble(text: str, base: Experiment | None = None, name: str = "ensemble") -> Ensemble:
    """Read an ensemble from a TOML text, as `load_ensemble` does from a file.

    `name` is that of the text in messages, and of the ensemble if the text gives none.

    Raises:
        ConfigurationError: not valid TOML, an unknown key, or a value or distribution out of range.
    """
    return _from_source(Source(name, text), base, name)


def _from_source(source: Source, base: Experiment | None, name: str) -> Ensemble:
    table = source.table()
    heading, entries = table.pop("ensemble", {}), table.pop("distributions", {})
    for key, group in (("ensemble", heading), ("distributions", entries)):
        if not isinstance(group, dict):
            raise ConfigurationError(f"{source.name}: {key}: must be a table, [{key}]")
    for key, value in heading.items():
        with source.located(f"ensemble.{key}"):
            if key not in HEADING:
                raise ConfigurationError(unknown("key", f"ensemble.{key}", [f"ensemble.{name}" for name in HEADING]))
            if not isinstance(value, str):
                raise ConfigurationError(f"ensemble.{key} = {value}: must be a text")
    for key in HEADING:
        if key in table:
            with source.located(key):
                raise ConfigurationError(f"{key}: belongs below a line [ensemble]")
    continued = load_ensemble(heading["base"], base) if "base" in heading else None
    experiment = from_table(table, source, continued.experiment if continued else base or Experiment())
    distributions = dict(continued.distributions) if continued else dict[str, Drawn]()
    for key, entry in _entries(entries):
        with source.located(f"distributions.{key}"):
            distributions[current(key)] = drawn_from(current(key), _located(key, entry, source), experiment)
    return Ensemble(heading.get("name", name), heading.get("description", ""), experiment, distributions)


def _located(key: str, entry: Any, source: Source) -> Any:
    """An entry in which paths among the choices are relative to the ensemble's file."""
    if not isinstance(entry, dict):
        return entry
    lists = {word: entry[word] for word in ("choice", "values") if isinstance(entry.get(word), list)}
    return entry | {
        word: [from_folder({key: value}, source.folder)[key] for value in values] for word, values in lists.items()
    }


def reset(ensemble: Ensemble, values: Mapping[str, Any]) -> Ensemble:
    """A copy of an ensemble with other nominal values; relative distributions follow.

    Raises:
        ConfigurationError: an unknown key, a value out of range, a key whose distribution is not relative to the
            nominal value, or a distribution that would leave its key's range.
    """
    for key in values:
        distribution = ensemble.distributions.get(current(key))
        if distribution is not None and not distribution.relative:
            raise ConfigurationError(
                f"{key}: is drawn in the ensemble '{ensemble.name}', whatever its nominal value; edit the file"
            )
    experiment = override(ensemble.experiment, values)
    if experiment is ensemble.experiment:
        return ensemble
    for key, distribution in ensemble.distributions.items():
        check_range(key, distribution, experiment)
    return replace(ensemble, experiment=experiment)


def ensemble_to_toml(ensemble: Ensemble) -> str:
    """The complete ensemble as TOML: name, distributions and every key of the experiment.

    Raises:
        ConfigurationError: a distribution that is not registered.
    """
    lines = ["[ensemble]", f"name = {toml_value(ensemble.name)}", f"description = {toml_value(ensemble.description)}"]
    lines += ["", "[distributions]"]
    lines += [f"{key} = {entry_of(key, distribution)}" for key, distribution in ensemble.distributions.items()]
    return "\n".join(lines) + "\n\n" + to_toml(ensemble.experiment)


def _entries(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted key and entry of every distribution, from tables of any nesting."""
    keys = known_keys()
    for name, value in table.items():
        key = prefix + name
        if key in keys or not (isinstance(value, dict) and value) or is_entry(value):
            yield key, value
        else:
            yield from _entries(value, f"{key}.")
