"""The last bit, played by data: numbers moved by a relative 1e-14, about what another BLAS kernel or compiler changes.

``pytest.mark.parametrize("seed", SEEDS)`` or ``for seed in SEEDS`` goes through ten such computers. On each of them a
result makes the same decisions, and its numbers agree within a tolerance that follows from a condition number.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves, with_leaves

SEEDS = range(10)
"""Ten computers."""

LAST_BIT = 1e-14
"""Largest relative change of a number."""

PHYSICAL = ("plant.", "controller.", "disturbance.", "sensors.")
"""Prefixes of the keys of an experiment whose values are moved: the times of samples stay."""

COMPUTERS = pytest.mark.parametrize("seeds", [SEEDS[:2], pytest.param(SEEDS[2:], marks=pytest.mark.slow)])
"""Mark of a test that takes long on each computer, with an argument ``seeds``: two of them are quick."""

Value = TypeVar("Value")


def perturbed(value: Value, seed: int) -> Value:
    """A value in which every floating-point number is moved: arrays, mappings, sequences and dataclasses.

    Of an experiment the values of plant, controller, disturbance and sensors are moved. Zeros and whole numbers of
    Python (``int``) stay as they are, and so does a number on the bound of its range.
    """
    return _moved(value, np.random.default_rng(seed))


def _moved(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind in "fc"):
        return value * (1 + LAST_BIT * rng.uniform(-1, 1, np.shape(value) or None))
    if isinstance(value, Mapping):
        return {key: _moved(each, rng) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(_moved(each, rng) for each in value)
    if is_dataclass(value) and not isinstance(value, type):
        if hasattr(value, "simulation"):
            return _moved_experiment(value, rng)
        return replace(value, **{field.name: _moved(getattr(value, field.name), rng) for field in fields(value)})
    return value


def _moved_experiment(experiment: Any, rng: np.random.Generator) -> Any:
    for key, value in leaves(experiment).items():
        if isinstance(value, float) and value and key.startswith(PHYSICAL):
            try:
                experiment = with_leaves(experiment, {key: _moved(value, rng)})
            except ConfigurationError:
                continue  # on the bound of its range
    return experiment
