"""A linear system whose states, inputs and outputs have names and units."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.model.linear.files import Content, write
from dualwinch.model.linear.view import html
from dualwinch.model.quantities.quantity import nearest

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """``dx/dt = A x + B u, y = C x + D u``, or ``x[k+1] = A x[k] + B u[k]`` where it has a sample time.

    x, u and y are deviations from the operating point.

    Attributes:
        A, B, C, D: matrices of shapes (n, n), (n, m), (p, n), (p, m).
        dt: sample time in s; None: continuous time.
        states, inputs, outputs: names of the n states, m inputs and p outputs.
        units: name → unit of every state, input and output ("1" for a pure number).
        operating_point: name → value of where the linearisation was taken; empty where there is none.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    dt: float | None
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    operating_point: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n, m, p = len(self.states), len(self.inputs), len(self.outputs)
        for name, shape in {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}.items():
            matrix = np.asarray(getattr(self, name), dtype=np.float64)
            if matrix.shape != shape:
                raise ConfigurationError(f"{name} has the shape {matrix.shape}: the names ask for {shape}")
            object.__setattr__(self, name, matrix)
        for name in (*self.states, *self.inputs, *self.outputs):
            if name not in self.units:
                raise ConfigurationError(f"no unit for '{name}'")

    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A (n), in 1/s in continuous time and without unit in discrete time."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Frequency response ``y/u``.

        Args:
            omega: angular frequencies in rad/s (k).

        Returns:
            Array of shape (k, p, m).
        """
        angular = np.atleast_1d(np.asarray(omega, dtype=np.float64))
        s = 1j * angular if self.dt is None else np.exp(1j * angular * self.dt)
        pencil = s[:, None, None] * np.eye(len(self.states)) - self.A
        return self.C @ np.linalg.solve(pencil, np.broadcast_to(self.B, (len(s), *self.B.shape))) + self.D

    def between(self, inputs: Iterable[str], outputs: Iterable[str]) -> "LinearSystem":
        """The same system with only some of its inputs and outputs, in the order given.

        Raises:
            ConfigurationError: an unknown name; the message says which is nearest.
        """
        chosen_in, chosen_out = tuple(inputs), tuple(outputs)
        columns = [_index(name, self.inputs, "input") for name in chosen_in]
        rows = [_index(name, self.outputs, "output") for name in chosen_out]
        return replace(
            self,
            B=self.B[:, columns],
            C=self.C[rows],
            D=self.D[np.ix_(rows, columns)],
            inputs=chosen_in,
            outputs=chosen_out,
        )

    def discretised(self, dt: float) -> "LinearSystem":
        """The same system seen at sampling instants, its inputs held in between (zero-order hold).

        Args:
            dt: sample time in s.

        Raises:
            ConfigurationError: a sample time that is not positive, or a system that is discrete already.
        """
        from scipy.linalg import expm

        if self.dt is not None:
            raise ConfigurationError(f"the system is discrete already, with a sample time of {self.dt:g} s")
        if not (math.isfinite(dt) and dt > 0):
            raise ConfigurationError(f"dt = {dt:g}: must be a finite number > 0 s")
        n, m = self.B.shape
        block = np.zeros((n + m, n + m))
        block[:n, :n], block[:n, n:] = self.A, self.B
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = block * dt
            exponential = expm(scaled) if np.isfinite(scaled).all() else np.full_like(block, np.inf)
        if not np.isfinite(exponential).all():
            raise ConfigurationError(f"dt = {dt:g}: is too long a sample time, the matrices overflow")
        return replace(self, A=exponential[:n, :n], B=exponential[:n, n:], dt=dt)

    def to_control(self) -> Any:
        """The system as a `control.StateSpace` of python-control with the same names.

        A dot in a name becomes an underscore, as python-control reserves it. A continuous system has ``dt = 0``.

        Raises:
            MissingExtraError: python-control is not installed.
        """
        try:
            import control
        except ImportError:
            message = "python-control is not installed; install it with: pip install 'dualwinch[control]'"
            raise MissingExtraError(message) from None
        names = {
            key: [name.replace(".", "_") for name in getattr(self, key)] for key in ("states", "inputs", "outputs")
        }
        return control.StateSpace(self.A, self.B, self.C, self.D, 0 if self.dt is None else self.dt, **names)

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        return html(self._content)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the system to a file: .json, .mat (MATLAB and Octave) or .npz (see `model.linear.files`).

        Raises:
            ConfigurationError: unknown suffix.
            OSError: the file cannot be written.
        """
        write(self._content, path)

    @property
    def _content(self) -> Content:
        return _content(self, {name: getattr(self, name) for name in "ABCD"}, self.operating_point)


def save_sweep(systems: Sequence[LinearSystem], path: str | PathLike[str]) -> None:
    """Write systems of the same names to one file (see `model.linear.files`).

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    first = systems[0]
    matrices = {name: np.array([getattr(system, name) for system in systems]) for name in "ABCD"}
    values = {name: [system.operating_point[name] for system in systems] for name in first.operating_point}
    write(_content(first, matrices, values), path)


def _content(
    first: LinearSystem, matrices: Mapping[str, Array], operating_point: Mapping[str, float] | Mapping[str, list[float]]
) -> Content:
    return Content(
        matrices=matrices,
        dt=first.dt,
        states=first.states,
        inputs=first.inputs,
        outputs=first.outputs,
        units=first.units,
        operating_point=operating_point,
    )


def _index(name: str, names: tuple[str, ...], kind: str) -> int:
    if name not in names:
        raise ConfigurationError(f"unknown {kind} '{name}'; did you mean '{nearest(name, names)}'?")
    return names.index(name)
