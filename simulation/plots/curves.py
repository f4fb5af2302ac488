"""How runs are told apart: each has a label, a colour and a line style, the same in every panel of a figure."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.typing import LineStyleType

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.style import (
    BLUE,
    DASHES,
    GOLD,
    GREEN,
    GREY,
    PURPLE,
    SKY,
    VERMILION,
    WINE,
    law_colour,
    law_dashes,
    law_kind,
    law_label,
    plain,
)
from dualwinch.simulation.plots.thin import Floats, thin
from dualwinch.simulation.results.result import Result

Runs: TypeAlias = Mapping[Any, Result] | Iterable[Result] | Result
"""Label → run, runs that are labelled by their position laws, or one run."""

Look: TypeAlias = tuple[str, LineStyleType]
"""Colour and line style."""

PALETTE = (GOLD, WINE, GREY, PURPLE, SKY, GREEN, VERMILION, BLUE)
"""Colours of runs whose law's own is taken; those that no law has come first."""


@dataclass(frozen=True)
class Curve:
    """A run as every panel draws it.

    Attributes:
        label: its name.
        result: the run.
        colour, dashes: of its lines.
    """

    label: str
    result: Result
    colour: str
    dashes: LineStyleType

    @property
    def experiment(self) -> Experiment:
        """What was run."""
        return self.result.experiment

    @property
    def handle(self) -> Line2D:
        """Its entry in a legend, with the run's end where it ended early."""
        return Line2D([], [], color=self.colour, linestyle=self.dashes, label=f"{self.label}{ending(self.result)}")

    def draw(self, axes: Axes, t: Floats, values: Floats, **style: Any) -> None:
        """Draw a line of the run: times and values (rows,)."""
        axes.plot(*thin(t, values), **{"color": self.colour, "linestyle": self.dashes, "label": self.label} | style)


def curves(runs: Runs) -> list[Curve]:
    """Runs as a figure draws them, in the order given; none is left out.

    A run has its position law's own colour and line style, where no run before it has them; else others. A label that
    is the name of the run's law in configurations stands for that law's name in figures.

    Args:
        runs: label → run, runs, or one run.

    Raises:
        ConfigurationError: there is none, or one keeps no rows.
    """
    labelled = _labelled(runs)
    if not labelled:
        raise ConfigurationError("a figure needs at least one result")
    for label, result in labelled:
        if not isinstance(result, Result):
            raise ConfigurationError(f"{label}: a figure draws results of simulate, not {type(result).__name__}")
        if not len(result["t"]):
            raise ConfigurationError(f"the result of {label} keeps no rows: simulate with stride >= 1")
    looks = _looks([result.experiment for _, result in labelled])
    return [
        Curve(_named(label, result), result, colour, dashes)
        for (label, result), (colour, dashes) in zip(labelled, looks, strict=True)
    ]


def ending(result: Result) -> str:
    """How a run ended, in brackets; nothing for one that was completed."""
    if result.outcome == "completed":
        return ""
    return f" ({result.outcome.replace('_', ' ')} at {result.end_time:.3g} s)"


def longest(drawn: Iterable[Curve]) -> Experiment:
    """The experiment that lasts longest: a time axis has room for it."""
    return max((curve.experiment for curve in drawn), key=lambda experiment: experiment.duration)


def _labelled(runs: Runs) -> list[tuple[str, Result]]:
    if isinstance(runs, Result):
        return [(law_label(runs.experiment), runs)]
    if isinstance(runs, Mapping):
        return [(str(label), result) for label, result in runs.items()]
    given = list(runs)
    names = [law_label(result.experiment) if isinstance(result, Result) else "results" for result in given]
    count, seen = Counter(names), Counter[str]()
    labels: list[str] = []
    for name in names:
        seen[name] += 1
        labels.append(f"{name} ({seen[name]})" if count[name] > 1 else name)
    return list(zip(labels, given, strict=True))


def _named(label: str, result: Result) -> str:
    return plain(law_label(result.experiment) if label == law_kind(result.experiment) else label)


def _looks(experiments: list[Experiment]) -> list[Look]:
    """Colour and line style of every run: its law's own, or else the first that no other has."""
    own: list[Look] = [(law_colour(experiment), law_dashes(experiment)) for experiment in experiments]
    taken = list(dict.fromkeys(own))
    looks: list[Look] = []
    for look in own:
        chosen = look if look not in looks else _free(taken)
        taken.append(chosen)
        looks.append(chosen)
    return looks


def _free(taken: list[Look]) -> Look:
    """A look of a colour that is not taken, while there is one, and of the line style that fewest have."""
    colours = {colour for colour, _ in taken}
    rare = sorted(DASHES, key=[dashes for _, dashes in taken].count)
    looks = [look for look in product(PALETTE, rare) if look not in taken] or list(product(PALETTE, rare))
    return next((look for look in looks if look[0] not in colours), looks[0])
