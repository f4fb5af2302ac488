"""Compiled drivers of a sampled system: batches, single steps, real time, prediction and its random signals."""

from dualwinch.codegen.drivers.batch import compile_batch
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.prediction import (
    FilterCovariances,
    FilterData,
    FilterPass,
    FixedGainPrediction,
    Predictor,
    compile_predictor,
)
from dualwinch.codegen.drivers.realtime import PacedRun, Pacing
from dualwinch.codegen.drivers.signals.signals import FILL_PARTS, NORMAL, OUTAGES, UNIFORM
from dualwinch.codegen.drivers.stepping import SteppedRuns, compile_stepping

__all__ = [
    "FILL_PARTS",
    "NORMAL",
    "OUTAGES",
    "UNIFORM",
    "FilterCovariances",
    "FilterData",
    "FilterPass",
    "FixedGainPrediction",
    "Outcome",
    "PacedRun",
    "Pacing",
    "Predictor",
    "SteppedRuns",
    "compile_batch",
    "compile_predictor",
    "compile_stepping",
]
