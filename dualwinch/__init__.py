"""dualwinch: control of rope-towed machines, from one symbolic model to compiled closed loops.

The names below are imported when first used, so that ``import dualwinch`` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from codegen.block import Block
    from codegen.errors import DualwinchError
    from codegen.native import compile  # noqa: A004
    from controllers.controller import Controller, controller_function
    from dualwinch.config import load, override, to_toml
    from dualwinch.ensembles import load_ensemble
    from dualwinch.tuning_setup import tuning_problem
    from model.disturbance import Disturbance
    from model.errors import ConfigurationError
    from model.linear_system import LinearSystem
    from model.linearisation import linearise
    from model.modes import modes
    from model.operating_point import operating_point
    from model.plant import Plant, plant
    from model.reference import Reference
    from simulation.batch import BatchResult, rollout
    from simulation.blocks import block
    from simulation.certificate import Certificate, certify
    from simulation.describing_function import AmplitudePoint, amplitude_sweep
    from simulation.ensemble import Ensemble, Scenario
    from simulation.ensemble_result import EnsembleResult
    from simulation.ensemble_run import run_ensemble
    from simulation.ensemble_storage import save_ensemble
    from simulation.experiment import Experiment, Simulation
    from simulation.linear_loop import linear_broken_loop, linear_closed_loop
    from simulation.margins import Margins, margins
    from simulation.metrics import Metrics
    from simulation.nearby_gains import NearbyGains, nearby_gains
    from simulation.paired import Comparison
    from simulation.paired_run import compare, paper_controller
    from simulation.paper import case
    from simulation.result import Result
    from simulation.sensitivities import Sensitivities, sensitivities
    from simulation.sensors import Sensors
    from simulation.simulate import simulate
    from simulation.storage import save
    from tuning.tune import Tuned, tune

__version__ = "0.1.0"

_HOME = {
    "AmplitudePoint": "simulation.describing_function",
    "BatchResult": "simulation.batch",
    "Block": "codegen.block",
    "Certificate": "simulation.certificate",
    "Comparison": "simulation.paired",
    "ConfigurationError": "model.errors",
    "Controller": "controllers.controller",
    "Disturbance": "model.disturbance",
    "DualwinchError": "codegen.errors",
    "Ensemble": "simulation.ensemble",
    "EnsembleResult": "simulation.ensemble_result",
    "Experiment": "simulation.experiment",
    "LinearSystem": "model.linear_system",
    "Margins": "simulation.margins",
    "Metrics": "simulation.metrics",
    "NearbyGains": "simulation.nearby_gains",
    "Plant": "model.plant",
    "Reference": "model.reference",
    "Result": "simulation.result",
    "Scenario": "simulation.ensemble",
    "Sensitivities": "simulation.sensitivities",
    "Sensors": "simulation.sensors",
    "Simulation": "simulation.experiment",
    "Tuned": "tuning.tune",
    "amplitude_sweep": "simulation.describing_function",
    "block": "simulation.blocks",
    "case": "simulation.paper",
    "certify": "simulation.certificate",
    "compare": "simulation.paired_run",
    "compile": "codegen.native",
    "controller_function": "controllers.controller",
    "linear_broken_loop": "simulation.linear_loop",
    "linear_closed_loop": "simulation.linear_loop",
    "linearise": "model.linearisation",
    "load": "dualwinch.config",
    "load_ensemble": "dualwinch.ensembles",
    "margins": "simulation.margins",
    "modes": "model.modes",
    "nearby_gains": "simulation.nearby_gains",
    "operating_point": "model.operating_point",
    "override": "dualwinch.config",
    "paper_controller": "simulation.paired_run",
    "plant": "model.plant",
    "rollout": "simulation.batch",
    "run_ensemble": "simulation.ensemble_run",
    "save": "simulation.storage",
    "save_ensemble": "simulation.ensemble_storage",
    "sensitivities": "simulation.sensitivities",
    "simulate": "simulation.simulate",
    "to_toml": "dualwinch.config",
    "tune": "tuning.tune",
    "tuning_problem": "dualwinch.tuning_setup",
}

__all__ = [
    "AmplitudePoint",
    "BatchResult",
    "Block",
    "Certificate",
    "Comparison",
    "ConfigurationError",
    "Controller",
    "Disturbance",
    "DualwinchError",
    "Ensemble",
    "EnsembleResult",
    "Experiment",
    "LinearSystem",
    "Margins",
    "Metrics",
    "NearbyGains",
    "Plant",
    "Reference",
    "Result",
    "Scenario",
    "Sensitivities",
    "Sensors",
    "Simulation",
    "Tuned",
    "__version__",
    "amplitude_sweep",
    "block",
    "case",
    "certify",
    "compare",
    "compile",
    "controller_function",
    "linear_broken_loop",
    "linear_closed_loop",
    "linearise",
    "load",
    "load_ensemble",
    "margins",
    "modes",
    "nearby_gains",
    "operating_point",
    "override",
    "paper_controller",
    "plant",
    "rollout",
    "run_ensemble",
    "save",
    "save_ensemble",
    "sensitivities",
    "simulate",
    "to_toml",
    "tune",
    "tuning_problem",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'dualwinch' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
