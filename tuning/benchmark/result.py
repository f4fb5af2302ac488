"""What a race has found, as a prompt and a notebook show it."""

from matplotlib.figure import Figure

from dualwinch.model.quantities.tables import markdown, page, table
from dualwinch.simulation.plots.page import GivenAxes
from dualwinch.tuning.benchmark.found import BenchmarkFindings
from dualwinch.tuning.benchmark.summary import heading, notes, race_table


class BenchmarkResult(BenchmarkFindings):
    """Who tracks how well with the best gains that one budget finds; fields are those of `BenchmarkFindings`."""

    def __repr__(self) -> str:
        return "\n".join([f"Race: {heading(self)}", "", markdown(*race_table(self)), "", *notes(self)])

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        return page("BenchmarkResult", " ".join([f"{heading(self)}.", *notes(self)]), table(*race_table(self)))

    def plot(self, *, ax: GivenAxes = None) -> Figure:
        """Draw errors over those of the paper's gains, with intervals, the best first.

        Args:
            ax: axes to draw into; default: a figure of its own.
        """
        from dualwinch.tuning.benchmark.figures import race_figure

        return race_figure(self, ax=ax)

    def plot_fronts(self, *, ax: GivenAxes = None) -> Figure:
        """Draw what less chatter and less load cost in error, and the least error there is.

        Args:
            ax: axes for chatter and load; default: a figure of its own.
        """
        from dualwinch.tuning.benchmark.figures import fronts_figure

        return fronts_figure(self, ax=ax)
