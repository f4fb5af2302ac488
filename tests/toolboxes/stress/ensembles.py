"""Ensembles of a second's half, for tests of what breaks first."""

from dualwinch.config.ensemble_file import load_ensemble, loads_ensemble
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override

DRUMS = """
[ensemble]
name = "drums"
[distributions]
plant.winch_1.drum_radius = { uniform = [0.998, 1.002], of = "nominal" }
plant.winch_2.drum_radius = { uniform = [0.998, 1.002], of = "nominal" }
"""


def short(**settings: object) -> Experiment:
    """The default experiment's first half second."""
    return override(Experiment(), {"simulation.duration": 0.5, **settings})


def sea(experiment: Experiment | None = None) -> Ensemble:
    """The sea."""
    return load_ensemble("sea", experiment or short())


def rig(base: Ensemble | None = None) -> Ensemble:
    """The rig on top of the sea."""
    return load_ensemble("rig", (base or sea()).experiment)


def bare(experiment: Experiment | None = None) -> Ensemble:
    """An experiment that draws nothing."""
    return Ensemble("bare", "", experiment or short(), {})


def of(text: str, base: Ensemble) -> Ensemble:
    """An ensemble from a TOML text on top of another."""
    return loads_ensemble(text, base.experiment)
