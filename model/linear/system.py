"""Linear systems with named states, inputs and outputs with units, and their files.

A file is JSON, MATLAB (for MATLAB, Octave and SciPy) or NumPy, chosen by its suffix. Every format has the same entries:
``A, B, C, D, dt, states, inputs, outputs, units, operating_point``. A continuous system has ``dt`` null in JSON and 0
elsewhere, so that ``ss(A, B, C, D, dt)`` is right in MATLAB and Octave.

A sweep has the same entries: matrices have an additional axis over the points (the first; in MATLAB files the last, so
that ``A(:, :, k)`` is a matrix), and every number of the operating point becomes a list.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.files import atomic
from dualwinch.model.arguments import one_number, suffix_of
from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.model.quantities.quantity import unknown
from dualwinch.model.quantities.tables import page, readable_unit, section, table

Array = NDArray[np.float64]


LARGEST_SHOWN = 16
"""Rows and columns of the largest matrix shown; a larger system shows only its names."""

ROUND_OFF = 4 * np.finfo(float).eps
"""Tolerance of a frequency at a pole, relative to the largest pole."""


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """``dx/dt = A x + B u, y = C x + D u``, or ``x[k+1] = A x[k] + B u[k]`` with a sample time.

    x, u and y are deviations from the operating point.

    Attributes:
        A, B, C, D: matrices of shapes (n, n), (n, m), (p, n), (p, m).
        dt: sample time in s; None: continuous time.
        states, inputs, outputs: names of the n states, m inputs and p outputs.
        units: name → unit of every state, input and output ("1" for a pure number).
        operating_point: name → value at the operating point of the linearisation; may be empty.
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
                raise ConfigurationError(f"{name} has the shape {matrix.shape}: must be {shape} for these names")
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
            Array of shape (k, p, m); ``inf + nan j`` at a pole of that element.
        """
        angular = np.atleast_1d(np.asarray(omega, dtype=np.float64))
        s = 1j * angular if self.dt is None else np.exp(1j * angular * self.dt)
        poles = self.poles()
        at_pole = (np.abs(s[:, None] - poles) <= ROUND_OFF * np.abs(poles).max(initial=1.0)).any(axis=1)
        values = np.empty((len(s), *self.D.shape), np.complex128)
        regular = s[~at_pole]
        pencil = regular[:, None, None] * np.eye(len(self.states)) - self.A
        values[~at_pole] = self.C @ np.linalg.solve(pencil, np.broadcast_to(self.B, (len(regular), *self.B.shape)))
        for index in np.flatnonzero(at_pole):
            for row, column in np.ndindex(self.D.shape):
                values[index, row, column] = self._at_pole(s[index], row, column)
        return np.asarray(values + self.D, np.complex128)

    def _at_pole(self, s: complex, row: int, column: int) -> complex:
        """One element of ``C (s - A)^-1 B`` at a pole of the system, from the states between its input and output."""
        linked = np.linalg.matrix_power((self.A != 0) | np.eye(len(self.A), dtype=bool), len(self.A))
        between = (linked @ (self.B[:, column] != 0)) & ((self.C[row] != 0) @ linked)
        A, B, C = self.A[np.ix_(between, between)], self.B[between, column], self.C[row, between]
        eigenvalues = np.linalg.eigvals(A)
        if (np.abs(s - eigenvalues) <= ROUND_OFF * np.abs(eigenvalues).max(initial=1.0)).any():
            return complex(math.inf, math.nan)
        return complex(C @ np.linalg.solve(s * np.eye(len(A)) - A, B.astype(complex)))

    def between(self, inputs: Iterable[str], outputs: Iterable[str]) -> "LinearSystem":
        """The same system with only some of its inputs and outputs, in the order given.

        Raises:
            ConfigurationError: an unknown name; the message suggests the nearest one.
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
        """The sampled system with zero-order hold of its inputs.

        Args:
            dt: sample time in s.

        Raises:
            ConfigurationError: a sample time that is not positive, or a discrete system.
        """
        from scipy.linalg import expm

        if self.dt is not None:
            raise ConfigurationError(f"the system is discrete already, with a sample time of {self.dt:g} s")
        dt = one_number("dt", dt)
        if not (math.isfinite(dt) and dt > 0):
            raise ConfigurationError(f"dt = {dt:g}: must be a finite number > 0 s")
        n, m = self.B.shape
        block = np.zeros((n + m, n + m))
        block[:n, :n], block[:n, n:] = self.A, self.B
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = block * dt
            exponential = expm(scaled) if np.isfinite(scaled).all() else np.full_like(block, np.inf)
        if not np.isfinite(exponential).all():
            raise ConfigurationError(f"dt = {dt:g}: is too long a sample time: the matrices overflow")
        return replace(self, A=exponential[:n, :n], B=exponential[:n, n:], dt=dt)

    def to_control(self) -> Any:
        """The system as a `control.StateSpace` of python-control with the same names.

        Dots in names become underscores, as python-control reserves them. A continuous system has ``dt = 0``.

        Raises:
            MissingExtraError: python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise MissingExtraError("python-control", "control") from None
        names = {
            key: [name.replace(".", "_") for name in getattr(self, key)] for key in ("states", "inputs", "outputs")
        }
        return control.StateSpace(self.A, self.B, self.C, self.D, 0 if self.dt is None else self.dt, **names)

    def _repr_html_(self) -> str:
        """Names, units and, for a small system, the matrix [A B; C D] with named rows and columns."""
        kinds = {"state": self.states, "input": self.inputs, "output": self.outputs}
        words = ", ".join(f"{len(names)} {kind}s" for kind, names in kinds.items())
        time = "continuous time" if self.dt is None else f"sampled every {self.dt:g} s"
        point = ", ".join(f"{name} = {value:.4g}" for name, value in self.operating_point.items())
        rows = [[name, readable_unit(self.units[name]), kind] for kind, names in kinds.items() for name in names]
        is_small = len(self.states) + max(len(self.inputs), len(self.outputs)) <= LARGEST_SHOWN
        parts = [section("A, B; C, D", self._matrix(), is_open=True)] if is_small else []
        parts.append(section("names and units", table(["name", "unit", ""], rows)))
        return page("Linear system", f"{time}, {words}" + (f", at {point}" if point else ""), *parts)

    def _matrix(self) -> str:
        columns = (*self.states, *self.inputs)
        form = "d{}/dt" if self.dt is None else "next {}"
        causes = [*(form.format(name) for name in self.states), *self.outputs]
        matrix = np.block([[self.A, self.B], [self.C, self.D]])
        rows = [[name, *(f"{value:.4g}" for value in row)] for name, row in zip(causes, matrix, strict=True)]
        return table(["", *columns], rows, numbers=range(1, len(columns) + 1))

    def save(self, path: str | PathLike[str], figures: Mapping[str, Any] | None = None) -> None:
        """Write the system to a file: .json, .mat (MATLAB and Octave) or .npz (see `model.linear.system`).

        Args:
            path: path of the file.
            figures: results of an analysis, plain data, for the entry `figures`; as JSON text in .mat and .npz.

        Raises:
            ConfigurationError: unknown suffix.
            OSError: the file cannot be written.
        """
        _write(path, self, {}, figures)


def save_sweep(
    systems: Sequence[LinearSystem], path: str | PathLike[str], figures: Mapping[str, Any] | None = None
) -> None:
    """Write systems with the same names to one file (see `model.linear.system`); figures as in `LinearSystem.save`.

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    example = systems[0]
    matrices = {name: np.array([getattr(system, name) for system in systems]) for name in "ABCD"}
    values = {name: [system.operating_point[name] for system in systems] for name in example.operating_point}
    _write(path, example, matrices | {"operating_point": values}, figures)


def _write(
    path: str | PathLike[str], first: LinearSystem, own: dict[str, Any], figures: Mapping[str, Any] | None
) -> None:
    """Write a file atomically: entries of a system, some of them replaced by `own`."""
    write_format = WRITERS[suffix_of(Path(path), WRITERS)]
    entries = {field.name: getattr(first, field.name) for field in fields(first)} | own
    with atomic(Path(path)) as unfinished:
        write_format(unfinished, entries | ({"figures": dict(figures)} if figures else {}))


def _write_json(path: Path, entries: dict[str, Any]) -> None:
    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else dict(value)

    path.write_text(json.dumps(entries, indent=2, allow_nan=False, default=plain) + "\n", encoding="utf-8")


def _write_npz(path: Path, entries: dict[str, Any]) -> None:
    arrays = {
        name: np.array(json.dumps(dict(value)) if isinstance(value, Mapping) else value)
        for name, value in (entries | {"dt": entries["dt"] or 0.0}).items()
    }
    np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]  # names are free


def _write_mat(path: Path, entries: dict[str, Any]) -> None:
    from scipy.io import savemat

    def form(name: str, value: Any) -> Any:
        if name == "figures":
            return json.dumps(value)
        if isinstance(value, Mapping):  # fields of a MATLAB structure have no dots
            return {field.replace(".", "_"): item for field, item in value.items()}
        if isinstance(value, tuple):  # names, as a column cell array
            return np.array([*value, ""], dtype=object)[:-1, None]
        return np.moveaxis(value, 0, -1) if np.ndim(value) == 3 else value

    fields_of_file = {name: form(name, value) for name, value in (entries | {"dt": entries["dt"] or 0.0}).items()}
    savemat(path, fields_of_file, long_field_names=True)


WRITERS: dict[str, Callable[[Path, dict[str, Any]], None]] = {
    ".json": _write_json,
    ".mat": _write_mat,
    ".npz": _write_npz,
}
"""Suffix → writer."""


def _index(name: str, names: tuple[str, ...], kind: str) -> int:
    if name not in names:
        raise ConfigurationError(unknown(kind, name, names))
    return names.index(name)
