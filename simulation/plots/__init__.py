"""Figures of runs: the paper's Figures 5 to 21, an overview of one run, the fan chart of an ensemble, and V(t).

Every function returns a `matplotlib.figure.Figure` of its own; nothing here touches pyplot or global settings.
"""

from dualwinch.simulation.plots.bars import steady_state_bars
from dualwinch.simulation.plots.certificate import lyapunov
from dualwinch.simulation.plots.comparison import comparison
from dualwinch.simulation.plots.ensemble import fan_chart
from dualwinch.simulation.plots.files import encode, save
from dualwinch.simulation.plots.loop import amplitude_margins, closed_loop_poles, loop_bode
from dualwinch.simulation.plots.modes import modal_frequencies, pole_map
from dualwinch.simulation.plots.motion import error, trajectory
from dualwinch.simulation.plots.overview import overview
from dualwinch.simulation.plots.preloads import preloads
from dualwinch.simulation.plots.ropes import commands, tensions

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
    "tensions",
    "trajectory",
]
