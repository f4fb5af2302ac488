"""Ensembles: an experiment with distributions of some of its values, from which every scenario is drawn.

A distribution is its quantile function: one uniform draw between 0 and 1 determines the value. Values that share a
draw move together, and other sampling schemes (such as a low-discrepancy sequence) need no changes here.

SciPy's frozen distributions (``scipy.stats.truncnorm(...).ppf``) give the same values up to round-off, but take a
hundred times as long for each value, and a second to import.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import Part, Registry
from dualwinch.model.quantities.quantity import Positive, Quantity, Rule, suggestion
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.exogenous.signals import DIGITS, LARGEST_WORD, named_words
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario, Value


class Distribution(Part):
    """The distribution of a value: a frozen dataclass of its parameters, in the unit of the value.

    For relative draws, these are factors on the nominal value.
    """

    @abstractmethod
    def quantile(self, share: float) -> Value:
        """The value that a `share` (0 to 1) of all draws do not exceed."""

    @property
    @abstractmethod
    def ends(self) -> tuple[Value, ...]:
        """The values to check so that every draw is allowed: both bounds, or all choices."""


class Bounded(Distribution):
    """A distribution with a least value `low` and a largest value `high`."""

    low: float
    high: float

    rules: ClassVar[tuple[Rule, ...]] = (
        Rule(
            ("low", "high"),
            lambda drawn: drawn.low < drawn.high,
            lambda drawn, _: f"must be < high = {drawn.high:g}",
        ),
    )

    @property
    def ends(self) -> tuple[float, float]:
        """Both bounds."""
        return self.low, self.high


@dataclass(frozen=True)
class Uniform(Bounded):
    """Uniform from `low` to `high`."""

    low: Annotated[float, Quantity("", "least value")]
    high: Annotated[float, Quantity("", "largest value")]

    kind: ClassVar = "uniform"

    def quantile(self, share: float) -> float:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        return self.low + share * (self.high - self.low)


@dataclass(frozen=True)
class LogUniform(Bounded):
    """Log-uniform from `low` to `high`: for values of which only the order of magnitude is known."""

    low: Annotated[Positive, Quantity("", "least value")]
    high: Annotated[Positive, Quantity("", "largest value")]

    kind: ClassVar = "log-uniform"

    def quantile(self, share: float) -> float:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        value = self.low * math.exp(share * math.log(self.high / self.low))
        return min(max(value, self.low), self.high)


@dataclass(frozen=True)
class Normal(Bounded):
    """Normal with `mean` and standard deviation `sigma`, truncated to `low` to `high`."""

    mean: Annotated[float, Quantity("", "mean before truncation")]
    sigma: Annotated[Positive, Quantity("", "standard deviation before truncation")]
    low: Annotated[float, Quantity("", "least value")]
    high: Annotated[float, Quantity("", "largest value")]

    kind: ClassVar = "normal"
    rules: ClassVar = (
        *Bounded.rules,
        Rule(
            ("mean", "low", "high"),
            lambda drawn: drawn.low <= drawn.mean <= drawn.high,
            lambda drawn, _: f"must be {drawn.low:g} to {drawn.high:g} (low to high)",
        ),
    )

    def quantile(self, share: float) -> float:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        from scipy.special import ndtr, ndtri

        below, upto = (float(ndtr((end - self.mean) / self.sigma)) for end in self.ends)
        value = self.mean + self.sigma * float(ndtri(below + share * (upto - below)))
        return min(max(value, self.low), self.high)


@dataclass(frozen=True)
class Choice(Distribution):
    """One of some values, each equally likely."""

    values: Annotated[tuple[Value, ...], Quantity("", "the values")]

    kind: ClassVar = "choice"

    def quantile(self, share: float) -> Value:
        """The value at a `share` (0 to 1) of the list."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]

    @property
    def ends(self) -> tuple[Value, ...]:
        """All of them."""
        return self.values


DISTRIBUTIONS: Registry[Distribution] = Registry("distribution", Uniform, LogUniform, Normal, Choice)
"""Every distribution by its kind."""


SEED_KEY = "simulation.seed"
"""Key of the seed of a scenario's signals, which is also drawn unless the ensemble gives it a distribution."""

VERTEX = 0.5 - 0.5 / math.sqrt(3)
"""Lower quantile of a vertex, the upper one being 1 − VERTEX: for a uniform distribution, the mean ± one standard
deviation, the nodes of the two-point Gauss-Legendre rule.

With every value at an end of its range, a scenario would lie twice as far from the middle as any draw of many values.
"""


@dataclass(frozen=True)
class Drawn:
    """The sampling rule of one value.

    Attributes:
        distribution: distribution of the draws.
        relative: whether the draw is a factor on the nominal value.
        together: name of a group, whose members get the same quantile of their distributions, so that they rise and
            fall together. ``None``: drawn independently.
    """

    distribution: Distribution
    relative: bool = False
    together: str | None = None

    def value(self, share: float, nominal: Value) -> Value:
        """The value at a quantile; `nominal` is the nominal value for relative draws."""
        quantile = self.distribution.quantile(share)
        return _scaled(quantile, nominal) if self.relative else quantile

    def ends(self, nominal: Value) -> tuple[Value, ...]:
        """The values to check so that every draw is allowed."""
        return tuple(_scaled(end, nominal) if self.relative else end for end in self.distribution.ends)


def _scaled(factor: Value, nominal: Value) -> float:
    return float(factor) * float(nominal)


@dataclass(frozen=True)
class Ensemble:
    """An experiment and the distributions of some of its values.

    Attributes:
        name: name of the ensemble.
        description: description in one line.
        experiment: the nominal values; its plant is the controller's nominal plant in every scenario.
        distributions: dotted key of a value → how it is drawn.
    """

    name: str
    description: str
    experiment: Experiment
    distributions: Mapping[str, Drawn]

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` if a drawn key is no value of the experiment, or has no distribution."""
        nominal = leaves(self.experiment)
        for key, distribution in self.distributions.items():
            if not isinstance(distribution, Drawn):
                raise ConfigurationError(f"{key}: must be Drawn(distribution), not {type(distribution).__name__}")
            if key not in nominal:
                raise ConfigurationError(f"{key}: is drawn, and no key of this experiment; {suggestion(key, nominal)}")
            if distribution.relative and not isinstance(nominal[key], (int, float)):
                raise ConfigurationError(f"{key}: has no nominal value of its own that a draw could be a factor on")

    @property
    def drawn_keys(self) -> tuple[str, ...]:
        """Keys of all drawn values; the seed of the scenario's signals is last."""
        return (*(key for key in self.distributions if key != SEED_KEY), SEED_KEY)

    def scenario(self, index: int, seed: int, *, vertex: bool = False) -> Scenario:
        """Draw one scenario; arguments as in `chosen`."""
        return self.chosen([index], seed, vertex=vertex)[0]

    def chosen(self, indices: Sequence[int], seed: int | Sequence[int], *, vertex: bool = False) -> list[Scenario]:
        """Draw some scenarios.

        Every value has its own random stream, identified by seed, index and key (or group). So a scenario does not
        depend on the number of scenarios, and a further distribution does not change the draws of the others.

        Args:
            indices: numbers of the scenarios, from 0.
            seed: the ensemble's seed, a whole number from 0 to 2^64 - 1, or one for each scenario.
            vertex: whether every value is drawn from only two quantiles (`VERTEX`): a vertex of the box of standard
                deviations, where all values deviate at once.

        Raises:
            ConfigurationError: an index or a seed is too large.
        """
        if max(indices, default=0) > LARGEST_WORD:
            raise ConfigurationError(f"scenario {max(indices)}: must be a whole number from 0 to {LARGEST_WORD}")
        distributions = self._drawn
        names = [
            key if of is None or of.together is None else f"together: {of.together}"
            for key, (of, _) in distributions.items()
        ]
        words = named_words(seed, indices, names).T.tolist()
        plant = self.experiment.plant
        return [
            Scenario(index, self.experiment, plant, self._values(row, vertex=vertex), vertex)
            for index, row in zip(indices, words, strict=True)
        ]

    @cached_property
    def _drawn(self) -> dict[str, tuple[Drawn | None, Value]]:
        """Key → its sampling rule, None for a seed, and nominal value."""
        nominal = leaves(self.experiment)
        return {key: (self.distributions.get(key), nominal[key]) for key in self.drawn_keys}

    def _values(self, words: Sequence[int], *, vertex: bool) -> dict[str, Value]:
        """The values for random words, whole numbers of `DIGITS` bits."""
        draws: dict[str, Value] = {}
        for (key, (distribution, nominal)), word in zip(self._drawn.items(), words, strict=True):
            if distribution is None:
                draws[key] = word
            else:
                share = word * 2.0**-DIGITS
                if vertex:
                    share = VERTEX if share < 0.5 else 1 - VERTEX
                draws[key] = distribution.value(share, nominal)
        return draws

    def controlled_as(self, experiment: Experiment) -> "Ensemble":
        """The ensemble with the controller of an experiment, and with its metrics if it has any."""
        metrics = experiment.metrics or self.experiment.metrics
        changed = replace(self.experiment, controller=experiment.controller, metrics=metrics)
        return replace(self, experiment=changed)

    def scenarios(self, count: int, seed: int) -> Iterator[Scenario]:
        """Draw the first `count` scenarios."""
        return iter(self.chosen(range(count), seed))
