# The public names, each with the module it lives in: `dualwinch/__init__.py` reads them from here.

from .codegen.block import Block as Block
from .codegen.errors import DualwinchError as DualwinchError
from .codegen.native import compile as compile  # noqa: A004
from .commands.tuning_setup import tuning_problem as tuning_problem
from .config.ensemble_file import load_ensemble as load_ensemble
from .config.experiment_file import load as load
from .config.experiment_file import to_toml as to_toml
from .config.settings import override as override
from .controllers.controller import Controller as Controller
from .controllers.controller import controller_function as controller_function
from .model.disturbance import Disturbance as Disturbance
from .model.errors import ConfigurationError as ConfigurationError
from .model.linear.linearisation import linearise as linearise
from .model.linear.modes import modes as modes
from .model.linear.operating_point import operating_point as operating_point
from .model.linear.system import LinearSystem as LinearSystem
from .model.plant import Plant as Plant
from .model.plant import plant as plant
from .model.reference import Reference as Reference
from .model.signals.signal import Signal as Signal
from .simulation.analysis.certificate import Certificate as Certificate
from .simulation.analysis.certificate import certify as certify
from .simulation.analysis.describing_function import AmplitudePoint as AmplitudePoint
from .simulation.analysis.describing_function import amplitude_sweep as amplitude_sweep
from .simulation.analysis.linear_loop import linear_broken_loop as linear_broken_loop
from .simulation.analysis.linear_loop import linear_closed_loop as linear_closed_loop
from .simulation.analysis.margins import Margins as Margins
from .simulation.analysis.margins import margins as margins
from .simulation.analysis.nearby_gains import NearbyGains as NearbyGains
from .simulation.analysis.nearby_gains import nearby_gains as nearby_gains
from .simulation.batch.rollout import BatchResult as BatchResult
from .simulation.batch.rollout import rollout as rollout
from .simulation.batch.sensitivities import Sensitivities as Sensitivities
from .simulation.batch.sensitivities import sensitivities as sensitivities
from .simulation.ensembles.ensemble import Ensemble as Ensemble
from .simulation.ensembles.ensemble import Scenario as Scenario
from .simulation.ensembles.paired import Comparison as Comparison
from .simulation.ensembles.paired_run import compare as compare
from .simulation.ensembles.paired_run import paper_controller as paper_controller
from .simulation.ensembles.result import EnsembleResult as EnsembleResult
from .simulation.ensembles.run import run_ensemble as run_ensemble
from .simulation.ensembles.storage import save_ensemble as save_ensemble
from .simulation.exogenous.sensors import Sensors as Sensors
from .simulation.experiment import Experiment as Experiment
from .simulation.experiment import Simulation as Simulation
from .simulation.loop.blocks import block as block
from .simulation.loop.metrics import Metrics as Metrics
from .simulation.paper import case as case
from .simulation.result import Result as Result
from .simulation.simulate import simulate as simulate
from .simulation.storage import save as save
from .tuning.tune import Tuned as Tuned
from .tuning.tune import tune as tune

__version__: str
