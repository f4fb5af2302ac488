"""Many runs at once: a grid of parameters and scenarios, and the least errors that any controller can reach."""

# ruff: noqa: F401

from dualwinch.simulation.batch.authority import LeastErrors, infeasible_words, least_errors
from dualwinch.simulation.batch.rollout import BatchResult, ParameterScenarioGrid, run_grid
from dualwinch.simulation.batch.scenarios import experiment_of
