"""Compiled drivers of a sampled system: batches, single steps, and random signals."""

# ruff: noqa: F401

from dualwinch.codegen.drivers.batch import compile_batch
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.signals.signals import FILL_PARTS, NORMAL, OUTAGES, UNIFORM
from dualwinch.codegen.drivers.stepping import SteppedRuns, Stepping, compile_stepping
