"""What is minimised."""

from collections.abc import Sequence

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.scoring.statistic import Statistic, statistic_from

DEFAULT_OBJECTIVES = ("mean.mse",)


def objectives_from(texts: Sequence[str]) -> tuple[Statistic, ...]:
    """The statistics to minimise, e.g. ``["mean.mse", "mean.chatter"]``; more than one makes a Pareto front.

    Raises:
        ConfigurationError: an unknown name, one named twice, or one whose small values are the bad ones.
    """
    found = tuple(map(statistic_from, texts))
    for place, one in enumerate(found):
        if one in found[:place]:
            raise ConfigurationError(f"--objective {one.name}: is named twice")
        if one.small_is_bad:
            raise ConfigurationError(f"--objective {one.name}: small is bad; make it a constraint, {one.name}>=...")
    return found
