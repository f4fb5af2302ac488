"""dualwinch: control of rope-towed machines, from one symbolic model to compiled closed loops.

The names below are imported when first used, so that ``import dualwinch`` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dualwinch.codegen.block import Block
    from dualwinch.codegen.errors import DualwinchError
    from dualwinch.codegen.native import compile  # noqa: A004
    from dualwinch.commands.tuning_setup import tuning_problem
    from dualwinch.config.ensemble_file import load_ensemble
    from dualwinch.config.experiment_file import load, to_toml
    from dualwinch.config.settings import override
    from dualwinch.controllers.controller import Controller, controller_function
    from dualwinch.model.disturbance import Disturbance
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.linear.linearisation import linearise
    from dualwinch.model.linear.modes import modes
    from dualwinch.model.linear.operating_point import operating_point
    from dualwinch.model.linear.system import LinearSystem
    from dualwinch.model.plant import Plant, plant
    from dualwinch.model.reference import Reference
    from dualwinch.simulation.analysis.certificate import Certificate, certify
    from dualwinch.simulation.analysis.describing_function import AmplitudePoint, amplitude_sweep
    from dualwinch.simulation.analysis.linear_loop import linear_broken_loop, linear_closed_loop
    from dualwinch.simulation.analysis.margins import Margins, margins
    from dualwinch.simulation.analysis.nearby_gains import NearbyGains, nearby_gains
    from dualwinch.simulation.batch.rollout import BatchResult, rollout
    from dualwinch.simulation.batch.sensitivities import Sensitivities, sensitivities
    from dualwinch.simulation.ensembles.ensemble import Ensemble, Scenario
    from dualwinch.simulation.ensembles.paired import Comparison
    from dualwinch.simulation.ensembles.paired_run import compare, paper_controller
    from dualwinch.simulation.ensembles.result import EnsembleResult
    from dualwinch.simulation.ensembles.run import run_ensemble
    from dualwinch.simulation.ensembles.storage import save_ensemble
    from dualwinch.simulation.exogenous.sensors import Sensors
    from dualwinch.simulation.experiment import Experiment, Simulation
    from dualwinch.simulation.loop.blocks import block
    from dualwinch.simulation.loop.metrics import Metrics
    from dualwinch.simulation.paper import case
    from dualwinch.simulation.result import Result
    from dualwinch.simulation.simulate import simulate
    from dualwinch.simulation.storage import save
    from dualwinch.tuning.tune import Tuned, tune

__version__ = "0.1.0"

_HOME = {
    "AmplitudePoint": "dualwinch.simulation.analysis.describing_function",
    "BatchResult": "dualwinch.simulation.batch.rollout",
    "Block": "dualwinch.codegen.block",
    "Certificate": "dualwinch.simulation.analysis.certificate",
    "Comparison": "dualwinch.simulation.ensembles.paired",
    "ConfigurationError": "dualwinch.model.errors",
    "Controller": "dualwinch.controllers.controller",
    "Disturbance": "dualwinch.model.disturbance",
    "DualwinchError": "dualwinch.codegen.errors",
    "Ensemble": "dualwinch.simulation.ensembles.ensemble",
    "EnsembleResult": "dualwinch.simulation.ensembles.result",
    "Experiment": "dualwinch.simulation.experiment",
    "LinearSystem": "dualwinch.model.linear.system",
    "Margins": "dualwinch.simulation.analysis.margins",
    "Metrics": "dualwinch.simulation.loop.metrics",
    "NearbyGains": "dualwinch.simulation.analysis.nearby_gains",
    "Plant": "dualwinch.model.plant",
    "Reference": "dualwinch.model.reference",
    "Result": "dualwinch.simulation.result",
    "Scenario": "dualwinch.simulation.ensembles.ensemble",
    "Sensitivities": "dualwinch.simulation.batch.sensitivities",
    "Sensors": "dualwinch.simulation.exogenous.sensors",
    "Simulation": "dualwinch.simulation.experiment",
    "Tuned": "dualwinch.tuning.tune",
    "amplitude_sweep": "dualwinch.simulation.analysis.describing_function",
    "block": "dualwinch.simulation.loop.blocks",
    "case": "dualwinch.simulation.paper",
    "certify": "dualwinch.simulation.analysis.certificate",
    "compare": "dualwinch.simulation.ensembles.paired_run",
    "compile": "dualwinch.codegen.native",
    "controller_function": "dualwinch.controllers.controller",
    "linear_broken_loop": "dualwinch.simulation.analysis.linear_loop",
    "linear_closed_loop": "dualwinch.simulation.analysis.linear_loop",
    "linearise": "dualwinch.model.linear.linearisation",
    "load": "dualwinch.config.experiment_file",
    "load_ensemble": "dualwinch.config.ensemble_file",
    "margins": "dualwinch.simulation.analysis.margins",
    "modes": "dualwinch.model.linear.modes",
    "nearby_gains": "dualwinch.simulation.analysis.nearby_gains",
    "operating_point": "dualwinch.model.linear.operating_point",
    "override": "dualwinch.config.settings",
    "paper_controller": "dualwinch.simulation.ensembles.paired_run",
    "plant": "dualwinch.model.plant",
    "rollout": "dualwinch.simulation.batch.rollout",
    "run_ensemble": "dualwinch.simulation.ensembles.run",
    "save": "dualwinch.simulation.storage",
    "save_ensemble": "dualwinch.simulation.ensembles.storage",
    "sensitivities": "dualwinch.simulation.batch.sensitivities",
    "simulate": "dualwinch.simulation.simulate",
    "to_toml": "dualwinch.config.experiment_file",
    "tune": "dualwinch.tuning.tune",
    "tuning_problem": "dualwinch.commands.tuning_setup",
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
