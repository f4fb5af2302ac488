"""Files of an ensemble's result: one row a scenario, as CSV, Parquet, NumPy or JSON; units travel with each."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe, describe_parts
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.result import EnsembleResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import metrics_with
from dualwinch.simulation.results.content import Content, plain
from dualwinch.simulation.results.formats import FORMATS


def content_of(result: EnsembleResult, notes: Mapping[str, str]) -> Content:
    """What a file holds: number of the scenario, drawn values, outcome, end, figures of merit; seed and statistics."""
    experiment = result.ensemble.experiment
    drawn = {**describe(Experiment), **describe_parts(experiment)}
    merits = describe(metrics_with(experiment.metrics))
    columns: dict[str, tuple[NDArray[Any], Quantity]] = {
        "scenario": (np.arange(len(result)), Quantity("", "number of the scenario")),
        **{key: (values, drawn[key].quantity) for key, values in result.draws.items()},
        "outcome": (np.array(result.outcomes), Quantity("", "how the run ended")),
        "end_time": (result.end_times, Quantity("s", "time at which the run ended")),
        **{name: (values, merits[name].quantity) for name, values in result.metrics.items()},
    }
    facts = {
        **notes,
        "ensemble": result.ensemble.name,
        "ensemble_seed": result.seed,
        "scenarios_asked": result.asked,
        "outcomes": result.outcome_counts,
        "statistics": result.statistics,
        "experiment": leaves(experiment),
        "distributions": {
            key: {"kind": drawn.distribution.kind, **asdict(drawn)}
            for key, drawn in result.ensemble.distributions.items()
        },
    }
    values = {name: values for name, (values, _) in columns.items()}
    return Content(values, {name: quantity for name, (_, quantity) in columns.items()}, plain(facts))


def save_ensemble(result: EnsembleResult, path: str | PathLike[str], notes: Mapping[str, str] | None = None) -> None:
    """Write a result to a file; the file appears whole or not at all.

    As with a single run (`simulation.results.storage.save`) a CSV file's units stand beside it in
    ``FILE-metadata.json``; the other formats carry units, seed, statistics, the nominal experiment, how values were
    drawn, and notes inside.

    Args:
        result: what to write.
        path: its suffix chooses the format: csv, parquet, npz, json.
        notes: further texts to keep with the result, such as the ensemble's TOML.

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    ensemble_writer(path)(content_of(result, notes or {}), path)


def ensemble_writer(path: str | PathLike[str]) -> Callable[[Content, Path], None]:
    """What writes the format of a path's suffix.

    Raises:
        ConfigurationError: unknown suffix.
    """
    path = Path(path)
    try:
        return WRITERS[path.suffix.lower()]
    except KeyError:
        allowed = ", ".join(WRITERS)
        raise ConfigurationError(f"{path.name}: unknown suffix {path.suffix!r}; must be one of {allowed}") from None


def _write_json(content: Content, path: Path) -> None:
    rows = zip(*(values.tolist() for values in content.columns.values()), strict=True)
    scenarios = [plain(dict(zip(content.columns, row, strict=True))) for row in rows]
    text = json.dumps({**content.facts, "units": content.units, "scenarios": scenarios}, indent=1, allow_nan=False)
    with atomic(path) as unfinished:
        unfinished.write_text(text + "\n", encoding="utf-8")


WRITERS: dict[str, Callable[[Content, Path], None]] = {
    **{suffix: FORMATS[suffix].write for suffix in (".csv", ".parquet", ".npz")},
    ".json": _write_json,
}
"""Suffix → what writes it."""
