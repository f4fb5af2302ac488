"""dualwinch: control of rope-towed machines, from one symbolic model to compiled closed loops.

The names below are imported when first used, so that ``import dualwinch`` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from codegen.errors import DualwinchError
    from controllers.controller import Controller, controller_function
    from dualwinch.config import load, override, to_toml
    from dualwinch.ensembles import load_ensemble
    from model.disturbance import Disturbance
    from model.plant import Plant, plant
    from model.reference import Reference
    from simulation.batch import BatchResult, rollout
    from simulation.ensemble import Ensemble, Scenario
    from simulation.ensemble_result import EnsembleResult
    from simulation.ensemble_run import run_ensemble
    from simulation.ensemble_storage import save_ensemble
    from simulation.errors import ConfigurationError
    from simulation.experiment import Experiment, Simulation
    from simulation.metrics import Metrics
    from simulation.paired import Comparison
    from simulation.paired_run import compare, paper_controller
    from simulation.paper import case
    from simulation.result import Result
    from simulation.sensors import Sensors
    from simulation.simulate import simulate
    from simulation.storage import save

__version__ = "0.1.0"

_HOME = {
    "BatchResult": "simulation.batch",
    "Comparison": "simulation.paired",
    "ConfigurationError": "simulation.errors",
    "Controller": "controllers.controller",
    "Disturbance": "model.disturbance",
    "DualwinchError": "codegen.errors",
    "Ensemble": "simulation.ensemble",
    "EnsembleResult": "simulation.ensemble_result",
    "Experiment": "simulation.experiment",
    "Metrics": "simulation.metrics",
    "Plant": "model.plant",
    "Reference": "model.reference",
    "Result": "simulation.result",
    "Scenario": "simulation.ensemble",
    "Sensors": "simulation.sensors",
    "Simulation": "simulation.experiment",
    "case": "simulation.paper",
    "compare": "simulation.paired_run",
    "controller_function": "controllers.controller",
    "load": "dualwinch.config",
    "load_ensemble": "dualwinch.ensembles",
    "override": "dualwinch.config",
    "paper_controller": "simulation.paired_run",
    "plant": "model.plant",
    "run_ensemble": "simulation.ensemble_run",
    "save": "simulation.storage",
    "rollout": "simulation.batch",
    "save_ensemble": "simulation.ensemble_storage",
    "simulate": "simulation.simulate",
    "to_toml": "dualwinch.config",
}

__all__ = [
    "BatchResult",
    "Comparison",
    "ConfigurationError",
    "Controller",
    "Disturbance",
    "DualwinchError",
    "Ensemble",
    "EnsembleResult",
    "Experiment",
    "Metrics",
    "Plant",
    "Reference",
    "Result",
    "Scenario",
    "Sensors",
    "Simulation",
    "__version__",
    "case",
    "compare",
    "controller_function",
    "load",
    "load_ensemble",
    "override",
    "paper_controller",
    "plant",
    "rollout",
    "run_ensemble",
    "save",
    "save_ensemble",
    "simulate",
    "to_toml",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'dualwinch' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
