"""What a stress test has found, as a prompt and a notebook show it."""

from matplotlib.figure import Figure

from dualwinch.model.quantities.tables import markdown, page, table
from dualwinch.simulation.plots.page import GivenAxes
from dualwinch.tuning.robustness.found import RobustnessFindings
from dualwinch.tuning.robustness.summary import heading, notes, stress_table


class RobustnessResult(RobustnessFindings):
    """Which imperfections gains break at; fields are those of `RobustnessFindings`."""

    def __repr__(self) -> str:
        return "\n".join([f"Stress: {heading(self)}", "", markdown(*stress_table(self)), "", *notes(self)])

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        return page("RobustnessResult", ". ".join([heading(self), *notes(self)]), table(*stress_table(self)))

    def plot(self, *, ax: GivenAxes = None) -> Figure:
        """Draw the sizes at which gains break, a row an imperfection.

        Args:
            ax: axes to draw into; default: a figure of its own.
        """
        from dualwinch.tuning.robustness.figures import stress_figure

        return stress_figure(self, ax=ax)
