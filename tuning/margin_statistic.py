"""Stability margins as statistics of a candidate: ``worst.delay_margin``, ``worst.disk_margin`` and their like.

They are no figures of merit of runs: what is the worst is taken over machines, points of the track and cuts of the
linearised loop (`simulation.analysis.worst_margins`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.analysis.worst_margins import WorstMargin
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.tuning.scoring.measured import UNMEASURED

MARGINS = {
    "gain_margin": ("gain", Quantity("1", "largest factor on the loop gain")),
    "phase_margin": ("phase", Quantity("deg", "largest extra phase lag")),
    "delay_margin": ("delay", Quantity("s", "largest extra delay")),
    "disk_margin": ("disk", Quantity("1", "largest disk of simultaneous gain and phase changes, 0 to 2")),
}
"""Name of a margin → its kind (`simulation.analysis.least_margins.KINDS`), unit and meaning."""


@dataclass(frozen=True)
class MarginStatistic:
    """The least of a margin.

    Attributes:
        metric: one of `MARGINS`.
    """

    metric: str

    kind = "worst"
    small_is_bad = True

    @property
    def margin(self) -> str:
        """Which margin, of `simulation.analysis.least_margins.KINDS`."""
        return MARGINS[self.metric][0]

    @property
    def name(self) -> str:
        """Such as ``worst.delay_margin``."""
        return f"{self.kind}.{self.metric}"

    @property
    def quantity(self) -> Quantity:
        """Unit and meaning."""
        return MARGINS[self.metric][1]

    @property
    def unit(self) -> str:
        """Unit of the margin."""
        return self.quantity.unit

    def of(self, worst: dict[str, WorstMargin]) -> float:
        """Its value, finite: a loop that bears anything has a very large one."""
        return min(worst[self.margin].value, UNMEASURED)


def margin_statistic(text: str, own: Sequence[Metric] = ()) -> MarginStatistic | None:
    """The statistic of a name; ``None`` where it is not about a margin.

    Args:
        text: the name.
        own: the experiment's own metrics, which may be called as they like.

    Raises:
        ConfigurationError: a margin other than the worst, or one that there is not.
    """
    kind, _, metric = text.strip().rpartition(".")
    if metric in {part.table() for part in own}:
        return None
    if metric in MARGINS:
        if kind != MarginStatistic.kind:
            raise ConfigurationError(f"'{text.strip()}': a margin is the worst one, {MarginStatistic(metric).name}")
        return MarginStatistic(metric)
    if metric.endswith("_margin"):
        raise ConfigurationError(f"'{text.strip()}': unknown margin '{metric}'; must be {', '.join(MARGINS)}")
    return None
