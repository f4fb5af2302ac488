"""Importers of co-simulation FMUs: position of the vehicle in Case 4, as each of them finds it."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.fmus import Instance

Floats = NDArray[np.float64]
STEP = 1e-3
REFERENCE = ("reference.x", "reference.v", "reference.a")
SENSED, WANTED, TORQUES = ("x", "v", "F1", "F2"), ("x_ref", "v_ref", "a_ref"), ("tau_1", "tau_2")


def fmpy_two_fmus(folder: Path, version: int, reference: Floats) -> Floats:
    """Plant and controller, connected by a loop here: plant's outputs, controller's step, plant's step."""
    plant, controller = (Instance(folder / f"{name}{version}.fmu") for name in ("plant", "controller"))
    x = np.empty(len(reference))
    for sample, wanted in enumerate(reference):
        sensed = plant.get(*SENSED)
        controller.put([*SENSED, *WANTED], [*sensed, *wanted])
        controller.step()
        plant.put(TORQUES, controller.get(*TORQUES))
        plant.step()
        x[sample] = sensed[0]
    return x


def fmpy_closed_loop(folder: Path, version: int, reference: Floats) -> Floats:
    """The closed loop as one FMU in FMPy."""
    loop = Instance(folder / f"closed-loop{version}.fmu")
    x = np.empty(len(reference))
    for sample, wanted in enumerate(reference):
        x[sample] = loop.get("x")[0]
        loop.put(REFERENCE, list(wanted))
        loop.step()
    return x


def libcosim(folder: Path, version: int, reference: Floats) -> Floats:
    """The closed loop in libcosim, which reads FMUs with Modelon's FMI Library as PyFMI does."""
    execution = import_module("libcosimpy.CosimExecution").CosimExecution.from_step_size(round(STEP * 1e9))
    slave = import_module("libcosimpy.CosimSlave").CosimLocalSlave(str(folder / f"closed-loop{version}.fmu"), "loop")
    if not slave.ptr():
        raise RuntimeError("unsupported FMI version")
    index = execution.add_local_slave(slave)
    manipulator = import_module("libcosimpy.CosimManipulator").CosimManipulator.create_override()
    observer = import_module("libcosimpy.CosimObserver").CosimObserver.create_last_value()
    execution.add_manipulator(manipulator)
    execution.add_observer(observer)
    references = {variable.name.decode(): variable.reference for variable in execution.slave_variables(index)}
    x = np.zeros(len(reference))
    for sample, wanted in enumerate(reference[:-1]):
        manipulator.slave_real_values(index, [references[name] for name in REFERENCE], list(wanted))
        if not execution.step():
            raise RuntimeError(f"stopped at sample {sample}")
        x[sample + 1] = observer.last_real_values(index, [references["x"]])[0]
    return x


def ecos(folder: Path, version: int, reference: Floats) -> Floats:
    """The closed loop in Ecos, which reads FMUs with fmi4c."""
    structure = import_module("ecospy.EcosSimulationStructure").EcosSimulationStructure()
    structure.add_model("loop", str(folder / f"closed-loop{version}.fmu"))
    simulation = import_module("ecospy.EcosSimulation").EcosSimulation(structure=structure, step_size=STEP)
    simulation.init()
    x = np.zeros(len(reference))
    for sample, wanted in enumerate(reference[:-1]):
        for name, value in zip(REFERENCE, wanted, strict=True):
            simulation.set_real(f"loop::{name}", float(value))
        simulation.step()
        x[sample + 1] = simulation.get_real("loop::x")
    return x


IMPORTERS: dict[str, Callable[[Path, int, Floats], Floats]] = {
    "FMPy, plant + controller": fmpy_two_fmus,
    "FMPy, closed loop": fmpy_closed_loop,
    "libcosim, closed loop": libcosim,
    "Ecos, closed loop": ecos,
}
"""Every importer by its name."""


def error(name: str, folder: Path, version: int, reference: Floats, expected: Floats) -> float:
    """Largest difference of an importer's position from the expected one in m."""
    return float(np.abs(IMPORTERS[name](folder, version, reference) - expected).max())
