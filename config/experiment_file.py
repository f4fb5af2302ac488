"""Experiments as annotated TOML: written with comments, read with errors that name key, file and line."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from os import PathLike
from pathlib import Path
from typing import Any

from dualwinch.codegen.text import one_line
from dualwinch.config.plugins import load_entry_points
from dualwinch.config.toml_text import Source, empty_tables, flattened, parse_assignment, read_source, toml_value
from dualwinch.model.arguments import instance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts, every_leaf
from dualwinch.model.quantities.part import built_in
from dualwinch.model.quantities.quantity import Leaf, Mark, Quantity, unknown
from dualwinch.model.quantities.tree import leaves, shown, with_leaves
from dualwinch.model.reference import KEYS_OF_KIND, cruise_speed
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.metrics.recovery import METRICS
from dualwinch.simulation.paper import case as paper_case
from dualwinch.simulation.settings import (
    check_reference_keys,
    current,
    describe_choices,
    from_folder,
    known_keys,
    override,
    with_settings,
    without_digests,
)


def load(
    path: str | PathLike[str], base: Experiment | None = None, settings: Mapping[str, Any] | None = None
) -> Experiment:
    """Read an experiment from a TOML file.

    Args:
        path: the file; missing keys keep their defaults. It may hold gains of several position laws, estimators and
            coordinations, of which only the chosen parts' are used. Parts that are not built in come from installed
            packages, or must be registered first (`dualwinch.register`).
        base: experiment with the defaults (default: ``Experiment()``).
        settings: dotted key → value, which replace the file's.

    Raises:
        ConfigurationError: the file cannot be read, is no TOML, or has an unknown key or a value out of range.

    Example:
        >>> from pathlib import Path
        >>> import dualwinch as dw
        >>> _ = Path("mine.toml").write_text("plant.vehicle.mass = 12000")
        >>> dw.load("mine.toml").plant.vehicle.mass
        12000.0
    """
    load_entry_points()
    source = read_source(path)
    return from_table(source.table(), source, base or Experiment(), settings or {})


def loads(text: str, base: Experiment | None = None) -> Experiment:
    """Read an experiment from a TOML text, as `load` does from a file; messages call it a configuration.

    Raises:
        ConfigurationError: not valid TOML, an unknown key, or a value out of range.
    """
    source = Source("configuration", text)
    return from_table(source.table(), source, base or Experiment())


def experiment_from(
    case: int | None = None,
    config: str | PathLike[str] | None = None,
    controller: str | None = None,
    assignments: Sequence[str] | None = None,
) -> Experiment:
    """The experiment of command-line options: a case of the paper, a TOML file or the defaults, with values set.

    Raises:
        ConfigurationError: both a case and a file, or anything wrong with a key or value.
    """
    if case is not None and config is not None:
        raise ConfigurationError("--case and --config: give one of them")
    values: dict[str, Any] = {} if controller is None else {"controller.kind": controller}
    values |= assigned(assignments or ())
    if config:
        return load(config, settings=values)
    return override(paper_case(case) if case is not None else Experiment(), values)


def assigned(assignments: Sequence[str]) -> dict[str, Any]:
    """Key → value of assignments; ``*`` stands for any part of a key, as in ``plant.rope_*.damping=300``.

    A key may follow a pattern that matches more than it, as an exception.

    Raises:
        ConfigurationError: no key or no ``=``, a value that no key can have, a pattern that matches no key, or a key
            that is given twice, with different values.
    """
    values: dict[str, Any] = {}
    before: dict[str, tuple[int, Any]] = {}  # present key → number of keys that its last assignment was for, and value
    for pattern, value in map(parse_assignment, assignments):
        keys = [key for key in known_keys() if fnmatchcase(key, pattern)] if "*" in pattern else [pattern]
        if not keys:
            raise ConfigurationError(f"{pattern}: no key is like this; dualwinch config prints all keys")
        for key in keys:
            count, last = before.get(current(key), (len(keys), value))
            if count <= len(keys) and last != value:
                both = f"{shown(last)} and {shown(value)}"
                hint = "give one value" if "*" not in pattern else f"give an exception after {pattern}"
                raise ConfigurationError(f"{key}: is given twice, as {both}; {hint}")
            before[current(key)] = len(keys), value
        values |= dict.fromkeys(keys, value)
    return values


def from_table(
    table: Mapping[str, Any], source: Source, base: Experiment, settings: Mapping[str, Any] | None = None
) -> Experiment:
    """The experiment of a TOML table, with arguments and errors as in `load`."""
    with source.located("metrics"):
        table = with_metric_kinds(table, tuple(base.metrics))
    for key in empty_tables({name: value for name, value in table.items() if not name.startswith("metrics")}):
        tables = {name.rpartition(".")[0] for name in known_keys()}
        if not any(f"{name}.".startswith(f"{key}.") for name in tables):
            with source.located(key):
                raise ConfigurationError(unknown("table", key, sorted(tables)))
    values, settings = from_folder(dict(flattened(table)), source.folder), dict(settings or {})
    alone, _ = with_settings(base, values, source.located)  # first alone, so that errors name the file's line
    if "reference.kind" not in settings:
        check_reference_keys(alone, values, source.located)
    experiment, _ = with_settings(base, without_digests(values) | settings)
    return override(experiment, settings)


def with_metric_kinds(table: Mapping[str, Any], known: tuple[Metric, ...] = ()) -> Mapping[str, Any]:
    """Normalise the key ``metrics`` of a file's table to a list of kinds, with the numbers of each below its name.

    A file may give a kind, a list of kinds and of tables with a kind and numbers, or a table of tables such as
    ``[metrics.overshoot]``. Known metrics need not be registered.
    """
    if "metrics" not in table:
        return table
    kinds = {kind.replace("-", "_"): kind for kind in (*METRICS, *(metric.kind for metric in known))}
    entries: dict[str, Any] = {}
    for name, numbers in _metric_entries(table["metrics"]):
        part = name.replace("-", "_")
        if part not in kinds:
            METRICS.find(name)
        if part in entries:
            raise ConfigurationError(f"metrics: '{name}' is given twice")
        entries[part] = numbers
    remainder = {key: value for key, value in table.items() if key != "metrics"}
    return (
        remainder
        | {"metrics": [kinds[part] for part in entries]}
        | {f"metrics.{part}": entries[part] for part in entries}
    )


def _metric_entries(metrics: Any) -> list[tuple[str, Mapping[str, Any]]]:
    """Name and numbers of each metric."""
    if isinstance(metrics, Mapping):
        for name, numbers in metrics.items():
            if not isinstance(numbers, Mapping):
                raise ConfigurationError(f"metrics.{name} = {toml_value(numbers)}: must be a table, [metrics.{name}]")
        return list(metrics.items())
    requirement = 'must be a list such as ["overshoot"], or tables such as [metrics.overshoot]'
    if isinstance(metrics, str):
        metrics = [metrics]
    if not isinstance(metrics, list):
        raise ConfigurationError(f"metrics = {toml_value(metrics)}: {requirement}")
    entries: list[tuple[str, Mapping[str, Any]]] = []
    for item in metrics:
        kind = item.get("kind") if isinstance(item, Mapping) else item
        if not isinstance(kind, str):
            raise ConfigurationError(f"metrics: {item!r}: {requirement}")
        numbers = item if isinstance(item, Mapping) else {}
        entries.append((kind, {key: value for key, value in numbers.items() if key != "kind"}))
    return entries


WIDEST = 60
"""Largest width of the column of entries, in characters; comments of longer entries start further right."""


def to_toml(
    experiment: Experiment, given: Collection[str] | None = None, checked: Collection[str] = frozenset()
) -> str:
    """The complete experiment as TOML, with unit, meaning, source and range of each key as a comment.

    A key without a value of its own is commented out, with the value that it takes from elsewhere, if any. Paths of
    files are absolute, with digests of their content.

    Args:
        experiment: to be written.
        given: keys given in the user's file (`own_keys`); all others are marked: still the paper's, or a default.
        checked: keys that the user has marked as right (`checked_keys`).

    Example:
        >>> import dualwinch as dw
        >>> lines = dw.to_toml(dw.case(4)).splitlines()
        >>> [line for line in lines if line.startswith("mass = 10000")]
        ['mass = 10000.0              # [kg] mass of the vehicle; > 0 (Table 1)']
    """
    instance("experiment", experiment, Experiment)
    lines = ["# dualwinch experiment; every key has a default, so a file may hold only what differs."]
    if given is not None:
        lines.append("# PAPER: not given, still the paper's machine; DEFAULT: not given, not of the paper either.")
    return "\n".join(lines + _tables(experiment, describe_parts(experiment), given, checked)) + "\n"


def given_keys(path: Path) -> frozenset[str]:
    """All keys in an experiment's file."""
    return frozenset(key for key, _ in flattened(read_source(path).table()))


MARKED = re.compile(r"^\s*[\w.-]+\s*=.*[^\s\[,]\s*#\s*(PAPER|DEFAULT): .*$", re.MULTILINE)
"""A line that `to_toml` has marked as not given."""


def own_keys(path: Path) -> frozenset[str]:
    """Keys given in an experiment's file, without those that `to_toml` has added and marked."""
    source = read_source(path)
    return frozenset(key for key, _ in flattened(replace(source, text=MARKED.sub("", source.text)).table()))


CHECKED = "CHECKED"
"""Beginning of the comment on a value that its user has marked as right."""

CHECKED_LINE = re.compile(rf"^\s*[\w.-]+\s*=.*#\s*{CHECKED}\b.*$", re.MULTILINE)
"""A line with such a comment."""


def checked_keys(path: Path) -> frozenset[str]:
    """Keys of an experiment's file whose values are marked as right, by a comment that begins with `CHECKED`."""
    source = read_source(path)
    remainder = replace(source, text=CHECKED_LINE.sub("", source.text))
    return given_keys(path) - {key for key, _ in flattened(remainder.table())}


def own_parts_to_toml(experiment: Experiment) -> str:
    """Tables of the user's registered parts that an experiment does not contain, with their defaults."""
    tables = {key.rpartition(".")[0] for key in describe_parts(experiment)}
    tables |= {leaf.key.rpartition(".")[0] for owner, leaf in every_leaf(Experiment) if built_in(owner)}
    lines: list[str] = []
    for key, leaf in describe_choices(experiment).items():
        several = Mark.PARTS in leaf.marks
        for kind in leaf.choices:
            other = with_leaves(experiment, {key: (kind,) if several else kind})
            leaves_of_parts = {
                name: leaf for name, leaf in describe_parts(other).items() if name.rpartition(".")[0] not in tables
            }
            if several and kind not in leaves(experiment)[key]:
                lines += ["", *(f"# {line}" for line in _tables(other, {key: leaf, **leaves_of_parts})[1:])]
            elif leaves_of_parts:
                lines += ["", f'# where {key} = "{kind}":', *_tables(other, leaves_of_parts)[1:]]
                tables |= {name.rpartition(".")[0] for name in leaves_of_parts}
    return "".join(f"{line}\n" for line in lines)


def _tables(
    experiment: Experiment,
    described: Mapping[str, Leaf],
    given: Collection[str] | None = None,
    checked: Collection[str] = frozenset(),
) -> list[str]:
    """Lines of the described keys of an experiment, table by table."""
    values, borrowed, unused = leaves(experiment), _taken_from_elsewhere(experiment), _unused(experiment)
    tables: dict[str, list[tuple[str, str]]] = {}
    headings: dict[str, Quantity] = {}
    lines: list[str] = []
    for key, leaf in described.items():
        table, _, name = key.rpartition(".")
        value = values[key]
        if Mark.PARTS in leaf.marks:
            headings |= {f"{key}.{part.table()}": part.quantity for part in experiment.metrics}
            tables |= {heading: [] for heading in headings}
            lines += [] if value else [f"# {key} = []  # {_comment(leaf)}"]
            continue
        entry = f"{name} = {toml_value(value)}"
        if value is None:
            entry = f"# {name} = {toml_value(borrowed[key]) if key in borrowed else ''}".rstrip()
        mark = f"{CHECKED}: " if key in checked else ""
        if given is not None and key not in given and key not in unused:
            papers = "aper" in leaf.quantity.source or "Table" in leaf.quantity.source
            mark = "PAPER: " if papers else "DEFAULT: "
        tables.setdefault(table, []).append((entry, mark + _comment(leaf)))
    for table, entries in tables.items():
        width = min(max((len(entry) for entry, _ in entries), default=0), WIDEST)
        heading = f"[{table}]  # {_description(headings[table])}" if table in headings else f"[{table}]"
        lines += ["", heading, *(f"{entry:<{width}}  # {comment}" for entry, comment in entries)]
    return lines


def _taken_from_elsewhere(experiment: Experiment) -> dict[str, Any]:
    vehicle = experiment.plant.vehicle
    return {
        "controller.nominal.mass": vehicle.mass + vehicle.added_mass,
        "controller.nominal.drag_coefficient": vehicle.drag_coefficient,
        "controller.nominal.friction_coefficient": vehicle.friction_coefficient,
        "reference.jerk_limit": math.inf,
        "reference.speed": cruise_speed(experiment.reference),
        "simulation.duration": experiment.duration,
    }


def _unused(experiment: Experiment) -> set[str]:
    """Keys of the paper's motions that have no effect with the user's own motion."""
    kind = experiment.reference.kind
    if kind in {"uniform", "profile"}:
        return set()
    foreign_names = {name for other, names in KEYS_OF_KIND.items() for name in names if other != kind}
    of_all = {"speed", "acceleration", "jerk_limit"} if kind == "file" else set[str]()
    return {"simulation.duration", *(f"reference.{name}" for name in foreign_names | of_all)}


def _comment(leaf: Leaf) -> str:
    allowed = f"; {leaf.allowed}" if leaf.allowed else ""
    return _description(leaf.quantity, allowed)


def _description(quantity: Quantity, allowed: str = "") -> str:
    unit = "" if quantity.unit in {"", "1"} else f"[{quantity.unit}] "
    source = f" ({quantity.source})" if quantity.source else ""
    return one_line(f"{unit}{quantity.meaning}{allowed}{source}")
