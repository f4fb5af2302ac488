"""A motion that makes numbers visible, as a prompt and a notebook show it."""

import numpy as np
from matplotlib.figure import Figure

from dualwinch.identification.excitation.designed import Designed
from dualwinch.identification.excitation.figure import excited_figure
from dualwinch.model.quantities.quantity import behind_number
from dualwinch.model.quantities.tables import markdown, page, table
from dualwinch.simulation.plots.page import GivenAxes


class Excited(Designed):
    """A motion that makes numbers visible; fields are those of `Designed`."""

    def __repr__(self) -> str:
        return "\n".join([f"Excited: {self.headline}", "", markdown(*expectations_table(self)), "", self.motion])

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        return page("Excited", f"{self.headline}. {self.motion}", table(*expectations_table(self)))

    def plot(self, *, ax: GivenAxes = None) -> Figure:
        """Draw the motion, and the deviations to expect beside those of the motion there was.

        Args:
            ax: two axes to draw into; default: a figure of its own.
        """
        return excited_figure(self, ax=ax)


def expectations_table(designed: Designed) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: the standard deviations to expect of the motion there was, and of this one."""
    rows = []
    for unknown, before, after in zip(designed.unknowns, designed.present_deviations, designed.deviations, strict=True):
        known = np.isfinite(before)
        share = f"{after / abs(unknown.start):.2%}" if after < abs(unknown.start) else ""
        rows.append([
            unknown.key,
            f"{unknown.start:.6g}",
            f"{before:.2g}" if known else "",
            f"{after:.2g}",
            share,
            f"{before / after:.3g}" if known else "",
            behind_number(unknown.unit).strip(),
        ])  # fmt: skip
    return ["", "believed", "± 1 s.d. so far", "± 1 s.d. now", "", "times smaller", ""], rows
