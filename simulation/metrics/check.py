"""Figures of merit of users' own, checked where an experiment takes them."""

from typing import Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.metrics.metrics import BUILT_IN


def checked_metrics(metrics: Any) -> tuple[Metric, ...]:
    """The metrics as a tuple.

    Raises:
        ConfigurationError: they are no list of metrics, or a name is none, is taken or is there twice.
    """
    if isinstance(metrics, Metric) or not isinstance(metrics, (list, tuple)):
        raise ConfigurationError(f"metrics: must be a list of metrics, e.g. metrics=[{_name(metrics)}()]")
    names: list[str] = []
    for index, metric in enumerate(metrics):
        if not isinstance(metric, Metric):
            wanted = f"{metric.__name__}()" if isinstance(metric, type) else "a Metric"
            raise ConfigurationError(f"metrics[{index}]: must be {wanted}, not {_name(metric)}")
        if not isinstance(getattr(metric, "quantity", None), Quantity):
            raise ConfigurationError(
                f'metric \'{metric.kind}\': has no quantity; write e.g. quantity = Quantity("s", "what it means")'
            )
        name = metric.table()
        if name in BUILT_IN:
            raise ConfigurationError(f"metric '{metric.kind}': the name is taken by a built-in figure of merit")
        if name in names:
            raise ConfigurationError(f"metric '{metric.kind}': is given twice")
        names.append(name)
    return tuple(metrics)


def _name(thing: Any) -> str:
    return thing.__name__ if isinstance(thing, type) else type(thing).__name__
