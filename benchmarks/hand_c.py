"""A hand-written C loop of the product's default method, ``hand_adaptive.c``: the limit of scalar code.

It is plain C with all constants worked out before the loop, and leaves out the effects that Case 4 switches off.
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.metrics.metrics import Accumulators, Metrics, finish

Floats = NDArray[np.float64]

SOURCE = Path(__file__).with_name("hand_adaptive.c")

GROUPS = {
    "simulation": "sample_time",
    "plant.vehicle": "mass added_mass drag_coefficient drag_area diameter water_density normal_force "
    "friction_coefficient friction_velocity",
    "plant.track": "length rope_offset",
    "plant.rope_1": "area modulus damping",
    "plant.rope_2": "area modulus damping",
    "plant.winch_1": "inertia drum_radius gear_ratio",
    "plant.winch_2": "inertia drum_radius gear_ratio",
    "disturbance": "vortex vortex_amplitude strouhal",
    "nominal.vehicle": "mass added_mass drag_coefficient friction_coefficient",
    "controller.nftsm": "beta eta k phi p q smoothing",
    "controller.observer": "l0 kf error_scale rate_scale filter_time",
    "controller.auxiliary": "gamma gamma_force k_a",
    "controller.coordination": "preload tension_min tension_max",
    "controller.winch_1": "kp ki",
    "controller.winch_2": "kp ki",
}
"""Table of keys → numbers that the loop takes, in the order of ``struct parameters``."""


class MissingCompilerError(Exception):
    """There is no gcc, or it fails."""


@cache
def _library() -> ctypes.CDLL:
    """The loop as a shared library, compiled with all optimisations for this processor."""
    compiler = shutil.which("gcc")
    if compiler is None:
        raise MissingCompilerError("gcc is not installed")
    library = Path(tempfile.mkdtemp(prefix="benchmarks-")) / "hand_adaptive.so"
    command = [compiler, "-O3", "-march=native", "-fPIC", "-shared", str(SOURCE), "-o", str(library), "-lm"]
    compilation = subprocess.run(command, capture_output=True, text=True, check=False)
    if compilation.returncode:
        raise MissingCompilerError(f"gcc failed: {next(iter(compilation.stderr.splitlines()), 'no message')}")
    return ctypes.CDLL(str(library))


def hand_adaptive(experiment: Experiment) -> Callable[[], tuple[Floats, Metrics]]:
    """One rollout as a call without arguments: positions (samples,) in m after each sample, and figures of merit.

    Raises:
        MissingCompilerError: there is no gcc.
    """
    loop = _library().hand_adaptive
    loop.restype = None
    pointer, count = ctypes.c_void_p, ctypes.c_long
    loop.argtypes = [pointer, pointer, count, count, pointer, pointer, pointer]
    numbers = parameters_of(experiment)
    keys = [f"{table}.{name}" for table, names in GROUPS.items() for name in names.split()]
    parameters = np.array([numbers[key] for key in keys])
    exogenous = closed_loop(structure_of(experiment)).exogenous
    columns = [exogenous.index(name) for name in ("reference.x", "reference.v", "reference.a", "steady")]
    reference = np.ascontiguousarray(exogenous_signals(experiment)[:, columns])
    start = np.array(list(initial_state_of(experiment).values()))[:6]
    names, substeps = list(vars(Accumulators())), experiment.simulation.substeps

    def rollout() -> tuple[Floats, Metrics]:
        positions, motion, sums = np.empty(len(reference)), start.copy(), np.empty(len(names))
        addresses = [array.ctypes.data for array in (motion, sums, positions)]
        loop(parameters.ctypes.data, reference.ctypes.data, len(reference), substeps, *addresses)
        return positions, finish(dict(zip(names, sums.tolist(), strict=True)), len(reference))

    return rollout
