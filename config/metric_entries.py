"""Figures of merit of users' own in a file: ``metrics = ["overshoot"]``, or a table for each that has numbers."""

from collections.abc import Mapping
from typing import Any

from dualwinch.config.toml_text import toml_value
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.metrics.metric import METRICS, Metric


def with_metric_kinds(table: Mapping[str, Any], known: tuple[Metric, ...] = ()) -> Mapping[str, Any]:
    """The table of a file whose key ``metrics`` is a list of kinds, with the numbers of each below its name.

    Args:
        table: ``metrics`` in it is a kind, a list of kinds and of tables with a kind and numbers, or a table of tables,
            such as ``[metrics.overshoot]``.
        known: metrics that need not be registered.

    Raises:
        ConfigurationError: a kind that is not known, or neither a list nor a table.
    """
    if "metrics" not in table:
        return table
    kinds = {kind.replace("-", "_"): kind for kind in (*METRICS, *(metric.kind for metric in known))}
    given: dict[str, Any] = {}
    for name, numbers in _entries(table["metrics"]):
        part = name.replace("-", "_")
        if part not in kinds:
            METRICS.find(name)
        if part in given:
            raise ConfigurationError(f"metrics: '{name}' is given twice")
        given[part] = numbers
    rest = {key: value for key, value in table.items() if key != "metrics"}
    return rest | {"metrics": [kinds[part] for part in given]} | {f"metrics.{part}": given[part] for part in given}


def _entries(metrics: Any) -> list[tuple[str, Mapping[str, Any]]]:
    """Name and numbers of each."""
    if isinstance(metrics, Mapping):
        for name, numbers in metrics.items():
            if not isinstance(numbers, Mapping):
                raise ConfigurationError(f"metrics.{name} = {toml_value(numbers)}: must be a table, [metrics.{name}]")
        return list(metrics.items())
    wanted = 'must be a list such as ["overshoot"], or tables such as [metrics.overshoot]'
    if isinstance(metrics, str):
        metrics = [metrics]
    if not isinstance(metrics, list):
        raise ConfigurationError(f"metrics = {toml_value(metrics)}: {wanted}")
    found: list[tuple[str, Mapping[str, Any]]] = []
    for item in metrics:
        kind = item.get("kind") if isinstance(item, Mapping) else item
        if not isinstance(kind, str):
            raise ConfigurationError(f"metrics: {item!r}: {wanted}")
        numbers = item if isinstance(item, Mapping) else {}
        found.append((kind, {key: value for key, value in numbers.items() if key != "kind"}))
    return found
