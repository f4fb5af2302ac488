"""Linear systems whose states, inputs and outputs have names and units, and their files.

A file is JSON, MATLAB (for MATLAB, Octave and SciPy) or NumPy, chosen by its suffix. Every format has the same entries:
``A, B, C, D, dt, states, inputs, outputs, units, operating_point``. A continuous system has ``dt`` null in JSON and 0
elsewhere, so that ``ss(A, B, C, D, dt)`` is right in MATLAB and Octave.

A sweep of systems fills the same entries: matrices get one more axis over the points (the first; in MATLAB files the
last, so that ``A(:, :, k)`` is a matrix), and every number of the operating point becomes a list.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.model.quantities.quantity import nearest
from dualwinch.model.quantities.tables import page, readable_unit, section, table


@dataclass(frozen=True)
class SystemContent:
    """What a file holds: one system, or a sweep of systems, whose names and sample time are those of the content.

    Attributes:
        matrices: ``A``, ``B``, ``C``, ``D`` → the matrix, or those of a sweep with the points as their first axis.
        dt: sample time in s; None: continuous time.
        states, inputs, outputs: names.
        units: name → unit.
        operating_point: name → value, or values of a sweep.
        figures: what was found of the systems, plain data with names and units; empty: nothing.
    """

    matrices: Mapping[str, NDArray[np.float64]]
    dt: float | None
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    operating_point: Mapping[str, float | list[float]]
    figures: Mapping[str, Any] = field(default_factory=dict)


def write(content: SystemContent, path: str | PathLike[str]) -> None:
    """Write linear systems to a file, which appears whole or not at all.

    Args:
        content: what to write.
        path: its suffix chooses the format: json, mat, npz.

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    write_format = writer(path)
    with atomic(path) as unfinished:
        write_format(unfinished, content)


def writer(path: str | PathLike[str]) -> Callable[[Path, SystemContent], None]:
    """What writes the format of a path's suffix.

    Raises:
        ConfigurationError: unknown suffix.
    """
    path = Path(path)
    try:
        return WRITERS[path.suffix.lower()]
    except KeyError:
        allowed = ", ".join(WRITERS)
        raise ConfigurationError(f"{path.name}: unknown suffix {path.suffix!r}; must be one of {allowed}") from None


def _write_json(path: Path, content: SystemContent) -> None:
    entries = {
        **{name: matrix.tolist() for name, matrix in content.matrices.items()},
        "dt": content.dt,
        "states": list(content.states),
        "inputs": list(content.inputs),
        "outputs": list(content.outputs),
        "units": dict(content.units),
        "operating_point": dict(content.operating_point),
        **({"figures": dict(content.figures)} if content.figures else {}),
    }
    path.write_text(json.dumps(entries, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _write_npz(path: Path, content: SystemContent) -> None:
    arrays = {
        **content.matrices,
        "dt": np.array(content.dt or 0.0),
        "states": np.array(content.states),
        "inputs": np.array(content.inputs),
        "outputs": np.array(content.outputs),
        "units": np.array(json.dumps(dict(content.units))),
        "operating_point": np.array(json.dumps(dict(content.operating_point))),
        **({"figures": np.array(json.dumps(dict(content.figures)))} if content.figures else {}),
    }
    np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]  # names are free


def _write_mat(path: Path, content: SystemContent) -> None:
    from scipy.io import savemat

    entries = {
        **{
            name: np.moveaxis(matrix, 0, -1) if matrix.ndim == 3 else matrix
            for name, matrix in content.matrices.items()
        },
        "dt": content.dt or 0.0,
        "states": _cells(content.states),
        "inputs": _cells(content.inputs),
        "outputs": _cells(content.outputs),
        "units": {_field(name): unit for name, unit in content.units.items()},
        "operating_point": {_field(name): value for name, value in content.operating_point.items()},
        **({"figures": json.dumps(dict(content.figures))} if content.figures else {}),
    }
    savemat(path, entries, long_field_names=True)


def _cells(names: Iterable[str]) -> NDArray[np.object_]:
    """A column cell array of texts."""
    return np.array([*names, ""], dtype=object)[:-1, None]


def _field(name: str) -> str:
    """A name as a field of a MATLAB structure, which has no dots."""
    return name.replace(".", "_")


WRITERS: dict[str, Callable[[Path, SystemContent], None]] = {
    ".json": _write_json,
    ".mat": _write_mat,
    ".npz": _write_npz,
}
"""Suffix → what writes it."""


LARGEST = 16
"""Rows and columns of the largest matrix that is shown; of a larger system only the names are."""


def html(system: SystemContent) -> str:
    """Names, units and, of a small system, the matrix [A B; C D] with its rows and columns named."""
    sizes = len(system.states), len(system.inputs), len(system.outputs)
    words = "{} states, {} inputs, {} outputs".format(*sizes)
    time = "continuous time" if system.dt is None else f"sampled every {system.dt:g} s"
    point = ", ".join(f"{name} = {value:.4g}" for name, value in system.operating_point.items())
    kinds = {"state": system.states, "input": system.inputs, "output": system.outputs}
    rows = [[name, readable_unit(system.units[name]), kind] for kind, names in kinds.items() for name in names]
    names = section("names and units", table(["name", "unit", ""], rows))
    parts = [section("A, B; C, D", _matrix(system), is_open=True)] if _is_small(system) else []
    if point:
        words += f", at {point}"
    return page("Linear system", f"{time}, {words}", *parts, names)


def _is_small(system: SystemContent) -> bool:
    states, inputs, outputs = len(system.states), len(system.inputs), len(system.outputs)
    return max(states + inputs, states + outputs) <= LARGEST


def _matrix(system: SystemContent) -> str:
    numbers = np.block([[system.matrices["A"], system.matrices["B"]], [system.matrices["C"], system.matrices["D"]]])
    columns = (*system.states, *system.inputs)
    form = "d{}/dt" if system.dt is None else "next {}"
    causes = [*(form.format(name) for name in system.states), *system.outputs]
    rows = [[name, *(f"{value:.4g}" for value in row)] for name, row in zip(causes, numbers, strict=True)]
    return table(["", *columns], rows, numbers=range(1, len(columns) + 1))


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

    def save(self, path: str | PathLike[str], figures: Mapping[str, Any] | None = None) -> None:
        """Write the system to a file: .json, .mat (MATLAB and Octave) or .npz (see `model.linear.system`).

        Args:
            path: of the file.
            figures: what was found of the system, plain data; the entry `figures`, as JSON text in .mat and .npz.

        Raises:
            ConfigurationError: unknown suffix.
            OSError: the file cannot be written.
        """
        write(replace(self._content, figures=figures or {}), path)

    @property
    def _content(self) -> SystemContent:
        return _content(self, {name: getattr(self, name) for name in "ABCD"}, self.operating_point)


def save_sweep(
    systems: Sequence[LinearSystem], path: str | PathLike[str], figures: Mapping[str, Any] | None = None
) -> None:
    """Write systems of the same names to one file (see `model.linear.system`), with figures as `LinearSystem.save`.

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    first = systems[0]
    matrices = {name: np.array([getattr(system, name) for system in systems]) for name in "ABCD"}
    values = {name: [system.operating_point[name] for system in systems] for name in first.operating_point}
    write(replace(_content(first, matrices, values), figures=figures or {}), path)


def _content(
    first: LinearSystem, matrices: Mapping[str, Array], operating_point: Mapping[str, float] | Mapping[str, list[float]]
) -> SystemContent:
    return SystemContent(
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
