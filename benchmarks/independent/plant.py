"""The plant of plant.h as a library, driven without a controller: for the checks against textbooks and MoorDyn."""

import ctypes
import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.compiler import find_compiler

SOURCE = Path(__file__).with_name("plant.c")

RATIO, DRUM = 36.0, 0.8
STIFFNESS = 80e9 * 4.52e-4
"""Gear ratio, drum radius in m and E A in N of Table 1."""


def library(folder: Path) -> ctypes.CDLL:
    """Build the library in a folder and load it."""
    target = folder / "plant.so"
    command = [*find_compiler().command, "-std=c99", "-O2", "-fPIC", "-shared", str(SOURCE), "-o", str(target), "-lm"]
    subprocess.run(command, check=True, capture_output=True)
    loaded = ctypes.CDLL(str(target))
    loaded.plant_energy.restype = ctypes.c_double
    loaded.plant_size.restype = ctypes.c_size_t
    return loaded


class Plant:
    """A machine at rest, whose state is an array that may be read and set by names.

    Attributes:
        state: as in plant.h; `place` says where.
        t: time in s.
        torque: held motor torques in N m.
    """

    def __init__(
        self, loaded: ctypes.CDLL, effects: Mapping[str, float], x: float = 25.0, tension: float = 1000.0
    ) -> None:
        """Start at rest.

        Args:
            loaded: of `library`.
            effects: by their names in effects.h; also mass, drag, friction (of the vehicle) and damping (of the ropes).
            x: position of the vehicle in m.
            tension: of both ropes in N.

        Raises:
            KeyError: there is no such effect.
        """
        self._library, self._machine = loaded, ctypes.create_string_buffer(loaded.plant_size())
        loaded.plant_nominal(self._machine)
        for name, value in effects.items():
            if not loaded.plant_set(self._machine, name.encode(), ctypes.c_double(value)):
                raise KeyError(name)
        self.state, self.t = np.zeros(loaded.plant_states()), 0.0
        self.torque = np.full(2, tension * DRUM / RATIO)
        loaded.plant_rest(
            self._machine,
            ctypes.c_double(x),
            _pointer(np.full(2, tension)),
            _pointer(self.torque),
            _pointer(self.state),
        )

    def place(self, name: str, side: int = 0) -> int:
        """Where in the state a quantity of the first (0) or second (1) side stands."""
        place = self._library.plant_place(name.encode())
        if place < 0:
            raise KeyError(name)
        return place + side

    def __getitem__(self, name: str) -> float:
        """A quantity of the first side."""
        return float(self.state[self.place(name)])

    def __setitem__(self, name: str, value: float) -> None:
        """Set a quantity of the first side."""
        self.state[self.place(name)] = value

    def move(self, duration: float) -> None:
        """Go on for a duration in s, in the sub-steps of the effects."""
        double = ctypes.c_double
        self._library.plant_move(
            self._machine, double(self.t), double(duration), _pointer(self.torque), _pointer(self.state)
        )
        self.t += duration

    def forces(self) -> NDArray[np.float64]:
        """Tensions at the drums, at the vehicle, torques in the gearboxes, and what resists the vehicle."""
        out = np.zeros(7)
        self._library.plant_forces(self._machine, ctypes.c_double(self.t), _pointer(self.state), _pointer(out))
        return out

    def energy(self) -> float:
        """Of motion, stretch, twist and height, less what the held torques have done, in J."""
        found = self._library.plant_energy(self._machine, ctypes.c_double(self.t), _pointer(self.state))
        geared = self.state[self.place("spin")] != 0.0 or self.state[self.place("turn")] != 0.0
        shaft = self.place("turn" if geared else "theta")
        return float(found) - RATIO * float(self.torque @ self.state[shaft : shaft + 2])


def _pointer(array: NDArray[np.float64]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
