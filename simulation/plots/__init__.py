"""Figures of runs: the paper's Figures 5 to 21, an overview of one run, the fan chart of an ensemble, and V(t).

Every function returns a `matplotlib.figure.Figure` of its own; nothing here touches pyplot or global settings.
"""

from simulation.plots.bars import steady_state_bars
from simulation.plots.certificate import lyapunov
from simulation.plots.comparison import comparison
from simulation.plots.ensemble import fan_chart
from simulation.plots.files import encode, save
from simulation.plots.motion import error, trajectory
from simulation.plots.overview import overview
from simulation.plots.ropes import commands, tensions

__all__ = [
    "commands",
    "comparison",
    "encode",
    "error",
    "fan_chart",
    "lyapunov",
    "overview",
    "save",
    "steady_state_bars",
    "tensions",
    "trajectory",
]
