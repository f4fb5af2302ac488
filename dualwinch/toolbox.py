"""The names of the kernel that toolboxes use: read this list first, it is the architecture.

A toolbox imports from here, from itself and from third parties, and from nowhere else:

    from dualwinch.toolbox import ConfigurationError, Experiment, physics, tables

Names with a capital letter are classes, most others modules, whose contents belong together. Each is imported when
first used, so that the list of commands loads nothing that a command needs.
"""

# ruff: noqa: F401, I001

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    # fmt: off
    # ---- errors and checks of arguments ----
    # the family of errors, each one line with the cause and a remedy
    from dualwinch.model import errors
    # an invalid value or combination of values, by key and allowed range
    from dualwinch.model.errors import ConfigurationError
    # checks of the arguments of public functions
    from dualwinch.model import arguments

    # ---- numbers: unit, bounds, meaning and source beside each field ----
    # unit, meaning and source of a number: an annotation of its field
    from dualwinch.model.quantities.quantity import Quantity
    # a property of a field: it shapes the code, is drawn ahead of a run, moves with the vehicle
    from dualwinch.model.quantities.quantity import Mark
    # a number of an experiment with its key, quantity, bounds and default
    from dualwinch.model.quantities.quantity import Leaf
    # bounds as annotations, numbers of a group, nearest spellings
    from dualwinch.model.quantities import quantity as quantities
    # dotted key → value of every number in a tree of dataclasses
    from dualwinch.model.quantities.tree import leaves
    # the same tree with other values
    from dualwinch.model.quantities.tree import with_leaves
    # numbers alone, their validation, and values as texts
    from dualwinch.model.quantities import tree
    # dotted key → `Leaf`: of a class, or of an experiment with the parts that it has
    from dualwinch.model.quantities import description
    # registries of parts by kind
    from dualwinch.model.quantities import part as parts
    # known units, and which of them are the same
    from dualwinch.model import units as physical_units

    # ---- the machine ----
    # arithmetic over floats and CasADi symbols alike
    from dualwinch.model import scalar
    # the equations of drives, winches, ropes, vehicle and disturbance
    from dualwinch.model import physics
    # position, speed and acceleration to be followed over time
    from dualwinch.model import reference as references
    # moves between positions within limits, and the preview of a motion
    from dualwinch.model import motions
    # a time series that is an input
    from dualwinch.model.signals import Signal
    # load cells and encoders: noise, bias, lag, resolution and silence
    from dualwinch.simulation import sensors as sensing

    # ---- controllers ----
    # position law, estimator and coordination with their gains
    from dualwinch.controllers.controller import Controller
    # the step of a controller as a CasADi function
    from dualwinch.controllers.controller import controller_function
    # position laws, estimators and coordinations by kind
    from dualwinch.controllers import registry as registries
    # the plant that a controller assumes
    from dualwinch.controllers import nominal as nominal_model
    # controllers with the paper's gains
    from dualwinch.controllers import paper_controller as paper_gains

    # ---- experiments and ensembles, also as files ----
    # plant, controller, reference, disturbance, sensors and simulation
    from dualwinch.simulation.experiment import Experiment
    # an experiment with other values by key; the present name of a key
    from dualwinch.simulation import settings
    # the paper's cases
    from dualwinch.simulation import paper
    # an experiment as TOML
    from dualwinch.config import experiment_file
    # an experiment and the distributions of some of its values
    from dualwinch.simulation.ensembles.ensemble import Ensemble
    # how a value of an ensemble is drawn
    from dualwinch.simulation.ensembles import ensemble as ensembles
    # an ensemble as TOML, by name or path
    from dualwinch.config import ensemble_file
    # the values that one run of an ensemble has
    from dualwinch.simulation.scenario import Scenario
    # simplifications of a model, and by how much a machine exceeds them
    from dualwinch.analysis import idealisations

    # ---- the closed loop as equations ----
    # parts, integrator, sub-steps and delays of a loop
    from dualwinch.simulation.loop import structure as structures
    # the sampled closed loop as functions
    from dualwinch.simulation.loop import closed_loop as loops
    # exogenous signals of a run, and their random streams
    from dualwinch.simulation.exogenous import signals as exogenous_signals
    # commands from outside in place of the controller's
    from dualwinch.simulation import external_commands
    # an experiment with its automatic values filled in; memory that a run needs
    from dualwinch.simulation import prepare as preparation

    # ---- runs and results ----
    # a run, and its result from what a driver leaves
    from dualwinch.simulation import simulate as runs
    # columns, figures of merit and outcome of a run
    from dualwinch.simulation.results.result import Result
    # figures of several runs: the paper's Figures 5 to 21
    from dualwinch.simulation.results import figures as run_figures
    # results as files
    from dualwinch.simulation.results import file_formats
    # how runs end
    from dualwinch.simulation.results import outcomes as run_outcomes
    # columns of results, with unit and meaning
    from dualwinch.simulation import rows as run_columns
    # figures of merit, with unit, name and formula
    from dualwinch.simulation.metrics import metrics as merits
    # statistics of figures of merit over scenarios
    from dualwinch.simulation.ensembles import result as merit_statistics
    # confidence intervals of ratios over paired scenarios
    from dualwinch.simulation.ensembles import comparison as intervals
    # many parameters in many scenarios at once
    from dualwinch.simulation.batch import batches
    # runs side by side that advance sample by sample
    from dualwinch.simulation import stepped_lanes as lanes
    # threads of this machine or a cluster that share work
    from dualwinch.simulation.batch import workers as executors
    # progress of a long computation and of its parts
    from dualwinch.simulation import progress as progresses

    # ---- figures, tables and texts ----
    # page, colours, axes and files of a figure
    from dualwinch.simulation.plots import drawing
    # a result's table as text, Markdown and HTML
    from dualwinch.model.quantities import tables
    # tables of named numbers with units, for terminal and files alike
    from dualwinch.model.quantities import figures as figure_tables
    # self-contained HTML reports
    from dualwinch.reports import page as report_page
    # texts in one line, for comments, Markdown and XML
    from dualwinch.codegen import text as texts

    # ---- code ----
    # a block for other tools: states, inputs, parameters, outputs and equations
    from dualwinch.codegen import block as blocks
    # the controller, plant or closed loop of an experiment as a block
    from dualwinch.simulation.blocks import block
    # provenance and files of an export
    from dualwinch import export
    # what a package in C shares with one in another language: prepared functions, structures, templates
    from dualwinch.codegen.export import package
    # CasADi functions and products with their Jacobians in C, or in a language of one's own
    from dualwinch.codegen import language
    # drivers of a sampled system: batches and single steps
    from dualwinch.codegen.drivers import compiled
    # the C source of a driver
    from dualwinch.codegen.drivers import unit as translation_unit
    # sampled systems, from which drivers are compiled
    from dualwinch.codegen import sampled
    # C compilers of this machine
    from dualwinch.codegen import compiler as compilers
    # the folder of compiled code
    from dualwinch.codegen import cache as code_cache

    # ---- tuning ----
    # experiment or ensemble, space, objectives and constraints of a search
    from dualwinch.tuning.problem import TuningProblem
    # bounds on figures of merit and on stability margins
    from dualwinch.tuning import constraints as tuning_constraints
    # searches of gains with one budget, and the scores of their candidates
    from dualwinch.tuning import searching

    # ---- files ----
    # files that appear whole or not at all
    from dualwinch.codegen import files as whole_files
    # folders for results
    from dualwinch.config import folders
    # tables in CSV files of many origins
    from dualwinch.model import csv_files
    # columns in Parquet files
    from dualwinch.model import recordings

    # ---- the command line ----
    # options that commands share, and their help
    from dualwinch.cli import options
    # notes on files and ensembles that may be oversights
    from dualwinch.cli import notes
    # the terminal, JSON, and files that were written
    from dualwinch.cli import output
    # the engine that was asked for, or the interpreter where there is no compiler
    from dualwinch.cli.simulate import engine_here
    # progress on the terminal
    from dualwinch.cli.progress import ProgressLine
    # what toolboxes offer to each other, by entry points
    from dualwinch import extensions
    # fmt: on


def _sources() -> dict[str, tuple[str, str]]:
    """Name in this module → the module that has it and its name there, from the imports above."""
    statements = ast.parse(Path(__file__).read_text(encoding="utf-8")).body
    guarded = next(node for node in statements if isinstance(node, ast.If))
    imports = [node for node in guarded.body if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name: (node.module or "", alias.name) for node in imports for alias in node.names}


SOURCES = _sources()


def __getattr__(name: str) -> Any:
    """A name of the list, imported when first used.

    Raises:
        AttributeError: no such name.
    """
    if name not in SOURCES:
        raise AttributeError(f"{name}: is no name of the kernel that toolboxes use ({__name__})")
    module, inner = SOURCES[name]
    parent = import_module(module)
    value = getattr(parent, inner) if hasattr(parent, inner) else import_module(f"{module}.{inner}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(SOURCES)
