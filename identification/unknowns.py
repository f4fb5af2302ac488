"""What is to be found: keys of an experiment, the ranges they may lie in, and what is known of them beforehand."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from dualwinch.identification.predictor import GROUPS, machine_of, parameter_names
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import nearest
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment

FACTOR = 10.0
"""How far from where the search begins a number may lie, within its annotation's bounds: so many times its scale (of
what is known beforehand: its deviation), and else down to that share of a positive one."""

PREFIXES = tuple(f"{group}." for group in GROUPS)

NOT_FITTED = (
    "sensors.position_noise", "sensors.speed_noise", "sensors.tension_noise", "sensors.position_resolution",
    "sensors.encoder_counts", "sensors.position_drift",
)  # fmt: skip
"""Numbers of noise and steps: they are estimated from what is left, or cannot be seen."""


@dataclass(frozen=True)
class Prior:
    """What is known of a number beforehand, as a normal distribution."""

    mean: float
    deviation: float


@dataclass(frozen=True)
class Unknown:
    """A number to be found.

    Attributes:
        key: of the experiment.
        unit: its unit.
        start: where the search begins.
        lower, upper: its range.
        scale: what counts as a large change of it.
        prior: what is known beforehand; None: nothing.
    """

    key: str
    unit: str
    start: float
    lower: float
    upper: float
    scale: float
    prior: Prior | None = None

    @property
    def cyclic(self) -> bool:
        """Whether a whole turn more is the same."""
        return self.key.endswith("_angle")


def keys_of(patterns: Sequence[str], experiment: Experiment) -> tuple[str, ...]:
    """Keys that patterns such as ``plant.rope_*.modulus`` stand for, each once.

    Raises:
        ConfigurationError: a pattern that stands for nothing that can be fitted.
    """
    known = [
        key for key in parameter_names(machine_of(experiment)) if key.startswith(PREFIXES) and key not in NOT_FITTED
    ]
    found: dict[str, None] = {}
    for pattern in (part.strip() for text in patterns for part in text.split(",")):
        matching = [key for key in known if fnmatchcase(key, pattern)]
        if not matching:
            hint = nearest(pattern, known)
            raise ConfigurationError(f"--fit {pattern}: no number that a log can tell; did you mean '{hint}'?")
        found |= dict.fromkeys(matching)
    return tuple(found)


def unknowns_of(keys: Sequence[str], experiment: Experiment, priors: Mapping[str, Prior]) -> tuple[Unknown, ...]:
    """The unknowns of some keys.

    Raises:
        ConfigurationError: a prior of a key that is not fitted, or outside of its range.
    """
    for key in priors:
        if key not in keys:
            raise ConfigurationError(f"--prior {key}: is not fitted; add it to --fit")
    values, described = leaves(experiment), describe_parts(experiment)
    found = []
    for key in keys:
        leaf, prior = described[key], priors.get(key)
        lower, upper = leaf.bounds
        if prior and not lower <= prior.mean <= upper:
            raise ConfigurationError(f"--prior {key}={prior.mean:g}: must be {leaf.wanted}")
        start = prior.mean if prior else float(values[key])
        scale = prior.deviation if prior else abs(start) or _some_scale(key)
        least = start / FACTOR if lower >= 0 < start and not prior else start - FACTOR * scale
        ends = max(lower, least), min(upper, start + FACTOR * scale)
        found.append(Unknown(key, leaf.quantity.unit, start, *ends, scale, prior))
    return tuple(found)


TYPICAL = {
    "sensors.encoder_zero": 1e-3,
    "sensors.load_cell_zero": 30.0,
    "sensors.load_cell_error": 0.01,
    "sensors.position_bias": 1e-3,
    "radius_error": 2e-3,
    "torque_error": 0.02,
    "torque_ripple": 0.01,
    "elongation": 5e-4,
    "layer_thickness": 1e-3,
    "eccentricity": 1e-4,
}
"""Sizes of what is zero unless it is known: parts of keys → size."""


def _some_scale(key: str) -> float:
    return next((size for part, size in TYPICAL.items() if part in key), 1.0)
