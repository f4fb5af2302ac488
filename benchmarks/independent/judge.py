"""Builds exported controllers into the machine of machine.c, and runs them."""

import subprocess
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.block import Block
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.codegen.source.operations import Precision
from dualwinch.simulation.batch.workers import cores
from dualwinch.simulation.blocks import block
from dualwinch.simulation.experiment import Experiment

SOURCE = Path(__file__).with_name("machine.c")

SENSED = {
    "x": "x",
    "v": "v",
    "F1": "F[0]",
    "F2": "F[1]",
    "theta_1": "theta[0]",
    "theta_2": "theta[1]",
    "omega_1": "omega[0]",
    "omega_2": "omega[1]",
    "x_ref": "reference[0]",
    "v_ref": "reference[1]",
    "a_ref": "reference[2]",
}
"""Input of a controller → where the machine has it."""

DRAWN = (
    "plant.vehicle.mass",
    "plant.vehicle.drag_coefficient",
    "plant.vehicle.friction_coefficient",
    "plant.rope_1.modulus",
    "plant.rope_2.modulus",
)
"""What a log begins with."""

LOGGED = ("t", "x", "v", "F1", "F2", "theta_1", "theta_2", "tau_1", "tau_2")
"""Columns of a log."""

Settings: TypeAlias = Callable[[int], Mapping[str, float]]


def nothing(_seed: int) -> Mapping[str, float]:
    """No effects, and the controller as it is."""
    return {}


SAMPLES = 50_000
"""Of a whole run: Case 4's, at a sample time of 1 ms."""


@dataclass(frozen=True)
class Conditions:
    """What the machine is put through; as in machine.c.

    Attributes:
        spread: size of what the sea varies from machine to machine, over that of the ensembles; 0: nominal.
        imperfect: size of the rig's imperfections likewise; 0: as in the sea.
        noisy: whether sea and sensors make noise.
        delay: samples by which torques are late.
        missing: whether a silent position sensor says so (NaN), or repeats its last reading.
        outage_length, outage_period: of the position sensor in s; 0: none.
    """

    spread: float = 1.0
    imperfect: float = 1.0
    noisy: bool = True
    delay: int = 1
    missing: bool = False
    outage_length: float = 0.2
    outage_period: float = 10.0

    @property
    def arguments(self) -> list[str]:
        """For the command line of machine.c."""
        return [str(float(getattr(self, field.name))) for field in fields(self)]


@dataclass(frozen=True)
class Runs:
    """What runs came to, each (runs,): counts of samples, errors in m² and m, tensions, chatter and force in N.

    `least_gear` is the smallest torque between the teeth of gearboxes that give, in N m at the drum; else 0.
    """

    samples: NDArray[np.float64]
    refused: NDArray[np.float64]
    mse: NDArray[np.float64]
    largest_error: NDArray[np.float64]
    peak_tension: NDArray[np.float64]
    min_tension: NDArray[np.float64]
    chatter: NDArray[np.float64]
    slack: NDArray[np.float64]
    needed: NDArray[np.float64]
    least_gear: NDArray[np.float64]

    @property
    def completed(self) -> NDArray[np.bool_]:
        """Which ran to their end."""
        return self.samples == SAMPLES

    @property
    def clean(self) -> NDArray[np.bool_]:
        """Which did so without a slack rope, and without a reading that the controller refused."""
        return self.completed & (self.slack == 0) & (self.refused == 0)


class Judge:
    """An exported controller in the machine."""

    def __init__(self, experiment: Experiment, folder: Path, precision: Precision = "double") -> None:
        """Export and build.

        Args:
            experiment: has the controller, and the plant it was designed for.
            folder: empty; what is built comes here.
            precision: of the exported code.

        Raises:
            ValueError: the controller takes what the machine does not have.
            RuntimeError: the compiler refuses the code.
        """
        law = block("controller", experiment)
        package = c_package(law, "dualwinch_controller", Provenance("dualwinch", "judged", "today"), precision)
        for file, text in {**package, "sensed.h": _header(law)}.items():
            (folder / file).write_text(text)
        self._program, self._preload = folder / "machine", experiment.controller.limits.preload
        command = [
            *find_compiler().command,
            "-std=c99",
            "-O2",
            "-I",
            str(folder),
            "-I",
            str(SOURCE.parent),
            str(SOURCE),
        ]
        command += [str(folder / "dualwinch_controller.c"), "-o", str(self._program), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(done.stderr[:2000])

    def run(self, conditions: Conditions, seeds: Sequence[int], settings: Settings = nothing) -> Runs:
        """A run for each seed, that of its machine and noise, on all cores.

        Args:
            conditions: what all machines are put through.
            seeds: of the runs.
            settings: seed → effects (effects.h), and parameters of the controller by their names in C.

        Raises:
            ValueError: there is no such effect or parameter.
        """

        def one(seed: int) -> list[float]:
            return [float(word) for word in self._run(conditions, seed, settings(seed)).stdout.split()]

        with ThreadPoolExecutor(cores()) as pool:
            rows = list(pool.map(one, seeds))
        return Runs(*np.array(rows).T)

    def log(
        self, conditions: Conditions, seed: int, given: Mapping[str, float], every: int = 1
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What was drawn of the five `DRAWN`, and (rows, `LOGGED`) a log of the run, every so many samples.

        Raises:
            ValueError: there is no such effect or parameter.
        """
        drawn, *rows = self._run(conditions, seed, {**given, "log": float(every)}).stderr.splitlines()
        return np.array(drawn.split(","), float), np.array([row.split(",") for row in rows], float)

    def _run(self, conditions: Conditions, seed: int, given: Mapping[str, float]) -> subprocess.CompletedProcess[str]:
        preload = given.get("controller_coordination_preload", self._preload)
        command = [str(self._program), str(seed), "1", str(preload), *conditions.arguments]
        command += [f"{name}={value!r}" for name, value in given.items()]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ValueError(done.stderr.strip())
        return done


def _header(law: Block) -> str:
    """What the controller takes of what the machine senses."""
    inputs: Mapping[str, str] = {variable.name: SENSED.get(variable.name, "") for variable in law.inputs}
    for name, where in inputs.items():
        if not where:
            raise ValueError(f"the controller takes {name}; the machine has {', '.join(SENSED)}")
    given = "\n".join(
        f"  input->{name} = (dualwinch_controller_real)sensed->{where};" for name, where in inputs.items()
    )
    names = [variable.name.replace(".", "_") for variable in law.parameters]
    known = ",\n".join(f'    {{"{name}", offsetof(dualwinch_controller_parameters, {name})}}' for name in names)
    return f"""#include <stddef.h>
#include <string.h>

#include "dualwinch_controller.h"

struct sensed {{
  double x, v, F[2], theta[2], omega[2], reference[3];
}};

static void give(dualwinch_controller_input *input, const struct sensed *sensed) {{
{given}
}}

static int set_parameter(dualwinch_controller_parameters *parameters, const char *name, size_t length, double value) {{
  static const struct {{
    const char *name;
    size_t offset;
  }} known[] = {{
{known}}};
  for (size_t k = 0; k < sizeof known / sizeof *known; k++) {{
    if (strlen(known[k].name) != length || strncmp(known[k].name, name, length) != 0) continue;
    *(dualwinch_controller_real *)((char *)parameters + known[k].offset) = (dualwinch_controller_real)value;
    return 1;
  }}
  return 0;
}}
"""
