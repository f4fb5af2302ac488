"""Ensemble files: an experiment with a table of distributions, read with errors that name key, file and line."""

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
"""Name behind which a file of tuned gains says at its head where they were tuned, and what it says of a single run."""


def built_in_ensembles() -> dict[str, Path]:
    """Name → file of the ensembles that come with the product."""
    with as_file(files("dualwinch.simulation") / "ensembles") as folder:
        return {file.stem: file for file in sorted(folder.glob("*.toml"))}


def find_ensemble(name: str | PathLike[str]) -> Path:
    """The file of an ensemble: of one that comes with the product, ``sea`` or ``rig``, or the path of a TOML file.

    Raises:
        ConfigurationError: it is neither.
    """
    known = built_in_ensembles()
    if str(name) in known:
        return known[str(name)]
    path = path_of("file", name)
    if path.suffix or path.exists():
        return path
    raise ConfigurationError(unknown("ensemble", name, known, " (or the path of a TOML file)"))


def load_ensemble(name: str | PathLike[str], base: Experiment | None = None) -> Ensemble:
    """Read an ensemble.

    Args:
        name: of one that comes with the product, ``sea`` or ``rig``, or the path of a TOML file.
        base: what the file's experiment keys are set on (default: ``Experiment()``).

    Raises:
        ConfigurationError: there is no such ensemble, its file cannot be read or is no TOML, a key names nothing, a
            value or a distribution is out of range.
    """
    load_entry_points()
    path = find_ensemble(name)
    return _from_source(read_source(path), base, path.stem)


def loads_ensemble(text: str, base: Experiment | None = None, name: str = "ensemble") -> Ensemble:
    """An ensemble from a TOML text, as `load_ensemble` reads one from a file; messages, and it itself, have its name.

    Raises:
        ConfigurationError: it is no TOML, a key names nothing, a value or a distribution is out of range.
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
            _check_heading(key, value)
    experiment = from_table(table, source, base or Experiment())
    distributions: dict[str, Drawn] = {}
    for key, entry in _entries(entries):
        with source.located(f"distributions.{key}"):
            distributions[current(key)] = drawn_from(current(key), _located(key, entry, source), experiment)
    return Ensemble(heading.get("name", name), heading.get("description", ""), experiment, distributions)


def _located(key: str, entry: Any, source: Source) -> Any:
    """An entry with the files among its choices relative to the ensemble's own."""
    if not isinstance(entry, dict):
        return entry
    lists = {word: entry[word] for word in ("choice", "values") if isinstance(entry.get(word), list)}
    return entry | {
        word: [from_folder({key: value}, source.folder)[key] for value in values] for word, values in lists.items()
    }


def reset(ensemble: Ensemble, values: Mapping[str, Any]) -> Ensemble:
    """A copy of an ensemble with some nominal values set; relative distributions follow.

    Raises:
        ConfigurationError: an unknown key, a value out of range, a key whose distribution does not follow the nominal
            value, or a distribution that would leave its key's range.
    """
    for key in values:
        drawn = ensemble.distributions.get(current(key))
        if drawn is not None and not drawn.relative:
            raise ConfigurationError(
                f"{key}: is drawn in the ensemble '{ensemble.name}', whatever its nominal value; edit the file"
            )
    experiment = override(ensemble.experiment, values)
    if experiment is ensemble.experiment:
        return ensemble
    for key, drawn in ensemble.distributions.items():
        check_range(key, drawn, experiment)
    return replace(ensemble, experiment=experiment)


def ensemble_to_toml(ensemble: Ensemble) -> str:
    """The complete ensemble as TOML: name, distributions and every key of the experiment.

    Raises:
        ConfigurationError: a distribution that no file can hold.
    """
    lines = ["[ensemble]", f"name = {toml_value(ensemble.name)}", f"description = {toml_value(ensemble.description)}"]
    lines += ["", "[distributions]"]
    lines += [f"{key} = {entry_of(key, drawn)}" for key, drawn in ensemble.distributions.items()]
    return "\n".join(lines) + "\n\n" + to_toml(ensemble.experiment)


def _check_heading(key: str, value: Any) -> None:
    if key not in ("name", "description"):
        raise ConfigurationError(unknown("key", f"ensemble.{key}", ("ensemble.name", "ensemble.description")))
    if not isinstance(value, str):
        raise ConfigurationError(f"ensemble.{key} = {value}: must be a text")


def _entries(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted key and content of every distribution, however the tables are nested."""
    known = known_keys()
    for name, value in table.items():
        key = prefix + name
        if key in known or not (isinstance(value, dict) and value) or is_entry(value):
            yield key, value
        else:
            yield from _entries(value, f"{key}.")
