"""Result files: CSV, Parquet, NumPy and MATLAB, chosen by suffix; units and the experiment travel with each."""

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from dualwinch.model.arguments import path_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark, unknown
from dualwinch.model.quantities.tree import leaves, shown, with_leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import metrics_with
from dualwinch.simulation.results.file_formats import FileContent, format_of, number, plain
from dualwinch.simulation.results.result import Result


def rebuilt(values: Mapping[str, Any], base: Experiment) -> Experiment:
    """The experiment of which these are the `leaves`.

    Args:
        values: dotted key → value; missing ones are taken from `base`.
        base: an experiment; parts that no registry knows are taken from here.

    Raises:
        ConfigurationError: a part of a kind that is not known here, a key that is not, or a value out of range.
    """
    for key, leaf in describe_parts(base).items():
        if key in values and not {Mark.PART, Mark.PARTS}.isdisjoint(leaf.marks) and not leaf.admits(values[key]):
            raise ConfigurationError(
                f"{key} = {shown(values[key])}: no such part is registered; "
                "register it, dw.register(YourClass), or give an experiment that has it, as load_result(path, base)"
            )
    experiment = with_leaves(base, values)
    known = leaves(experiment)
    for key in values:
        if key not in known:
            raise ConfigurationError(unknown("key", key, known))
    return experiment


UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, NotImplementedError, EOFError)
"""Errors of the libraries where a file is not of the format of its suffix."""


def save(result: Result, path: str | PathLike[str], notes: Mapping[str, str] | None = None) -> None:
    """Write a result to a file, which appears whole or not at all; `load_result` reads it back.

    A CSV file holds nothing but the header and full double-precision numbers; all else stands beside it in
    ``FILE-metadata.json``, in the form of the W3C's "CSV on the Web". The other formats carry units, meanings, figures
    of merit, outcome, final state, the experiment with every value, and notes inside.

    Args:
        result: to be written.
        path: its suffix chooses the format: csv, parquet, npz, mat.
        notes: further texts to keep with the result, such as versions.

    Raises:
        ConfigurationError: unknown suffix, or not the result of a run.
        OSError: the file cannot be written.
    """
    if not isinstance(result, Result):
        raise ConfigurationError(
            f"result: is a {type(result).__name__}: must be the Result of a run (an ensemble's is written by "
            "save_ensemble, an experiment by Path(...).write_text(to_toml(experiment)))"
        )
    path = Path(path)
    facts = dict(notes or {}) | _facts(result)
    format_of(path).write(FileContent(result.columns, result.quantities, facts), path)


def load_result(path: str | PathLike[str], base: Experiment | None = None) -> Result:
    """Read a result that `save` has written; it equals the saved one, bit for bit.

    Args:
        path: the file; its suffix tells the format.
        base: an experiment that has the parts of the saved one that no registry knows, such as a law of your own.

    Raises:
        ConfigurationError: the file cannot be read, holds no result, or one of parts that are not known here; also
            where a CSV file's metadata is not beside it.
    """
    path = path_of("path", path)
    read = format_of(path).read
    try:
        with path.open("rb"):  # the libraries below tell less clearly why they cannot read a file
            pass
        return _result_of(read(path), base or Experiment())
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or 'it is damaged'}") from error
    except (*UNREADABLE, zipfile.BadZipFile, zlib.error) as error:
        raise ConfigurationError(f"{path}: holds no result that dualwinch has saved, or is damaged") from error


def _facts(result: Result) -> dict[str, Any]:
    """Facts that are written beside the columns."""
    facts = {
        "outcome": result.outcome,
        "end_time": result.end_time,
        "metrics": asdict(result.metrics),
        "final_state": result.final_state,
        "experiment": leaves(result.experiment),
    }
    if result.nominal is not None:
        facts["nominal"] = leaves(result.nominal)
    return plain(facts)


def _result_of(content: FileContent, base: Experiment) -> Result:
    lengths = {name: len(values) for name, values in content.columns.items()}
    if len(set(lengths.values())) > 1:
        (first, rows), *others = lengths.items()
        odd, count = next((name, count) for name, count in others if count != rows)
        raise ConfigurationError(f"column '{odd}' has {count} rows: must have {rows}, as '{first}'")
    facts = {key: content.facts[key] for key in ("end_time", "metrics", "final_state", "experiment")}
    facts |= {"nominal": content.facts.get("nominal")}
    facts = {key: json.loads(value) if isinstance(value, str) else value for key, value in facts.items()}
    experiment = rebuilt(facts["experiment"], base)
    metrics = {name: number(value) for name, value in facts["metrics"].items()}
    return Result(
        columns={name: np.asarray(values, float) for name, values in content.columns.items()},
        metrics=metrics_with(experiment.metrics)(**metrics),
        outcome=content.facts["outcome"],
        end_time=number(facts["end_time"]),
        final_state={name: number(value) for name, value in facts["final_state"].items()},
        experiment=experiment,
        quantities=content.quantities,
        nominal=None if facts["nominal"] is None else with_leaves(base.plant, facts["nominal"]),
    )
