"""The figures of merit of users' own that files and command lines know."""

from dualwinch.model.quantities.part import Registry
from dualwinch.simulation.metrics.metric import Metric

METRICS: Registry[Metric] = Registry("metric")
Metric.registry = METRICS
"""Every figure of merit that is a part, by its kind; the built-in ones are always there (`Metrics`)."""
