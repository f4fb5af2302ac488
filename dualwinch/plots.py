"""Figures: the paper's Figures 5 to 21, an overview of one run, the fan chart of an ensemble, V(t), linear models.

Every function returns a new `matplotlib.figure.Figure`, without using pyplot or changing global settings; or it draws
into `ax`, axes for its panels, in the order of its documentation. With fewer axes, only the first panels are drawn.

Results of runs are given as one result, as several, which are labelled by their position laws, or by label. All
functions raise `ConfigurationError` where there is nothing to draw.
"""

from dualwinch.analysis.plots.linear import (
    amplitude_margins,
    closed_loop_poles,
    loop_bode,
    modal_frequencies,
    pole_map,
)
from dualwinch.analysis.preload import preloads_figure as preloads
from dualwinch.analysis.stability import lyapunov
from dualwinch.simulation.ensembles.comparison import comparison
from dualwinch.simulation.ensembles.result import fan_chart
from dualwinch.simulation.plots.page import encode, save
from dualwinch.simulation.results.figures import commands, error, steady_state_bars, tensions, trajectory
from dualwinch.simulation.results.result import overview
from dualwinch.simulation.sweep import sweep_figure

__all__ = [
    "amplitude_margins",
    "closed_loop_poles",
    "commands",
    "comparison",
    "encode",
    "error",
    "fan_chart",
    "loop_bode",
    "lyapunov",
    "modal_frequencies",
    "overview",
    "pole_map",
    "preloads",
    "save",
    "steady_state_bars",
    "sweep_figure",
    "tensions",
    "trajectory",
]
