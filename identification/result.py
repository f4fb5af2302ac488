"""What logs say of a machine, as a prompt and a notebook show it."""

from matplotlib.figure import Figure

from dualwinch.identification.found import Found
from dualwinch.identification.summary import headline, notes, tables
from dualwinch.model.quantities.tables import markdown, page, table
from dualwinch.simulation.plots.page import GivenAxes


class Identified(Found):
    """What logs say of a machine; fields are those of `Found`."""

    def __repr__(self) -> str:
        parts = [f"Identified: {headline(self)}", *(markdown(*each) for each in tables(self)), "\n".join(notes(self))]
        return "\n\n".join(parts).rstrip()

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        words = ". ".join([headline(self), *notes(self)])
        return page("Identified", words, "".join(table(*each) for each in tables(self)))

    def plot(self, *, ax: GivenAxes = None) -> Figure:
        """Draw estimates with their intervals, and how surprising the readings were over time.

        Args:
            ax: two axes to draw into; default: a figure of its own.
        """
        from dualwinch.identification.figure import identified_figure

        return identified_figure(self, ax=ax)
