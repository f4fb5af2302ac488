"""Figures of runs: the paper's Figures 5 to 21, an overview of one run, the fan chart of an ensemble.

Every function returns a new `matplotlib.figure.Figure`, without using pyplot or changing global settings; or it draws
into `ax`, axes for its panels, in the order of its documentation. With fewer axes, only the first panels are drawn.

Results of runs are given as one result, as several, which are labelled by their position laws, or by label. All
functions raise `ConfigurationError` where there is nothing to draw.
"""

from dualwinch.simulation.plots.ensembles import comparison, fan_chart
from dualwinch.simulation.plots.page import encode, save
from dualwinch.simulation.plots.runs import commands, error, overview, steady_state_bars, tensions, trajectory

__all__ = [
    "commands",
    "comparison",
    "encode",
    "error",
    "fan_chart",
    "overview",
    "save",
    "steady_state_bars",
    "tensions",
    "trajectory",
]
