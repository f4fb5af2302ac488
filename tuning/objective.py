"""What is minimised."""

from collections.abc import Sequence

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.result import Statistic, statistic_from
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.tuning.margin_statistic import margin_statistic

DEFAULT_OBJECTIVES = ("mean.mse",)


def objectives_from(texts: Sequence[str], own: Sequence[Metric] = ()) -> tuple[Statistic, ...]:
    """The statistics to minimise, e.g. ``["mean.mse", "mean.chatter"]``; more than one makes a Pareto front.

    Args:
        texts: their names.
        own: the experiment's own metrics.

    Raises:
        ConfigurationError: an unknown name, one named twice, or one whose small values are the bad ones.
    """
    for text in texts:
        if margin := margin_statistic(text, own):
            raise ConfigurationError(f"--objective {margin.name}: make it a constraint, {margin.name}>=...")
    found = tuple(statistic_from(text, own) for text in texts)
    for index, statistic in enumerate(found):
        if statistic in found[:index]:
            raise ConfigurationError(f"--objective {statistic.name}: is named twice")
        if statistic.small_is_bad:
            raise ConfigurationError(
                f"--objective {statistic.name}: small is bad; make it a constraint, {statistic.name}>=..."
            )
    return found
