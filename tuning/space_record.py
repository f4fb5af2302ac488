"""A search space as JSON-ready data, for a storage to keep and another process to read."""

from collections.abc import Sequence
from typing import Any

from dualwinch.tuning.space import Dimension, Interval, Pairs, Space


def space_to_record(space: Space) -> list[dict[str, Any]]:
    """The dimensions of a space: name, keys, unit, and bounds with scale or choices."""
    return [_record(dimension) for dimension in space.dimensions]


def space_from(records: Sequence[dict[str, Any]]) -> Space:
    """The space that `space_to_record` took apart."""
    return Space(tuple(_dimension(record) for record in records))


def _record(dimension: Dimension) -> dict[str, Any]:
    common = {"name": dimension.name, "keys": list(dimension.keys), "unit": dimension.unit}
    if isinstance(dimension, Pairs):
        return common | {"choices": list(dimension.choices)}
    return common | {"lower": dimension.lower, "upper": dimension.upper, "log": dimension.log}


def _dimension(record: dict[str, Any]) -> Dimension:
    name, keys, unit = record["name"], tuple(record["keys"]), record["unit"]
    if "choices" in record:
        return Pairs(name, (keys[0], keys[1]), tuple(record["choices"]), unit)
    return Interval(name, keys, record["lower"], record["upper"], record["log"], unit)
