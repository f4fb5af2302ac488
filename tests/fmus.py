"""FMUs as an importer runs them, by FMPy; alike for FMI 2 and FMI 3."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import fmpy
from fmpy import fmi2, fmi3
from fmpy.model_description import read_model_description

Exported = Callable[[str, int], Path]
"""``exported(what, version)``: the fixture that makes an FMU."""

STEP = 1e-3


class Instance:
    """One instance of an FMU, by default initialised; variables by name."""

    def __init__(self, path: Path, *, exchange: bool = False, initialise: bool = True) -> None:
        folder = fmpy.extract(str(path))
        description = read_model_description(str(folder))
        self.version = int(str(description.fmiVersion)[0])
        module = fmi2 if self.version == 2 else fmi3
        interface = description.modelExchange if exchange else description.coSimulation
        kind = getattr(module, f"FMU{self.version}{'Model' if exchange else 'Slave'}")
        assert interface is not None
        self.fmu: Any = kind(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=interface.modelIdentifier,
            instanceName="tested",
        )
        self.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.time = 0.0
        self.fmu.instantiate()
        if initialise:
            self.enter()
            self.fmu.exitInitializationMode()

    def enter(self) -> None:
        """Into initialisation mode."""
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)

    def get(self, *names: str) -> list[float]:
        """Values of variables."""
        wanted = [self.references[name] for name in names]
        return list(self.fmu.getReal(wanted) if self.version == 2 else self.fmu.getFloat64(wanted))

    def set(self, **values: float) -> None:
        """Set variables; a double underscore stands for a dot."""
        named = {name.replace("__", "."): value for name, value in values.items()}
        self.put(list(named), list(named.values()))

    def put(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set variables."""
        given = [self.references[name] for name in names]
        (self.fmu.setReal if self.version == 2 else self.fmu.setFloat64)(given, list(values))

    def step(self, samples: int = 1) -> None:
        """One communication step."""
        self.fmu.doStep(self.time, samples * STEP)
        self.time += samples * STEP

    def directional(self, of: Sequence[str], by: Sequence[str], seed: Sequence[float]) -> list[float]:
        """Directional derivative."""
        unknown, known = ([self.references[name] for name in names] for names in (of, by))
        return list(self.fmu.getDirectionalDerivative(unknown, known, list(seed)))
