"""Linear systems as files: JSON, MATLAB (for MATLAB, Octave and SciPy) and NumPy, chosen by suffix.

Every format holds the same entries: ``A, B, C, D, dt, states, inputs, outputs, units, operating_point``. A
continuous system has ``dt`` null in JSON and 0 elsewhere, so that ``ss(A, B, C, D, dt)`` is right in MATLAB and Octave.

A sweep of systems fills the same entries: matrices get one more axis over the points (the first; in MATLAB files the
last, so that ``A(:, :, k)`` is a matrix), and every number of the operating point becomes a list.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.system import LinearSystem


@dataclass(frozen=True)
class Content:
    """What a file holds: one system, or a sweep of systems whose names and sample time are those of the first."""

    first: LinearSystem
    matrices: Mapping[str, NDArray[np.float64]]
    operating_point: Mapping[str, float | list[float]]


def save(system: LinearSystem | Sequence[LinearSystem], path: Path) -> None:
    """Write a linear system, or a sweep of them, to a file; the file appears whole or not at all.

    Args:
        system: what to write; systems of a sweep have the same names.
        path: its suffix chooses the format: json, mat, npz.

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    write = writer(path)
    with atomic(path) as unfinished:
        write(unfinished, _content(system))


def _content(system: LinearSystem | Sequence[LinearSystem]) -> Content:
    if isinstance(system, LinearSystem):
        return Content(system, {name: getattr(system, name) for name in "ABCD"}, system.operating_point)
    matrices = {name: np.array([getattr(one, name) for one in system]) for name in "ABCD"}
    values = {name: [one.operating_point[name] for one in system] for name in system[0].operating_point}
    return Content(system[0], matrices, values)


def writer(path: Path) -> Callable[[Path, Content], None]:
    """What writes the format of a path's suffix.

    Raises:
        ConfigurationError: unknown suffix.
    """
    try:
        return WRITERS[path.suffix.lower()]
    except KeyError:
        allowed = ", ".join(WRITERS)
        raise ConfigurationError(f"{path.name}: unknown suffix {path.suffix!r}; must be one of {allowed}") from None


def _write_json(path: Path, content: Content) -> None:
    first = content.first
    entries = {
        **{name: matrix.tolist() for name, matrix in content.matrices.items()},
        "dt": first.dt,
        "states": list(first.states),
        "inputs": list(first.inputs),
        "outputs": list(first.outputs),
        "units": dict(first.units),
        "operating_point": dict(content.operating_point),
    }
    path.write_text(json.dumps(entries, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _write_npz(path: Path, content: Content) -> None:
    first = content.first
    arrays = {
        **content.matrices,
        "dt": np.array(first.dt or 0.0),
        "states": np.array(first.states),
        "inputs": np.array(first.inputs),
        "outputs": np.array(first.outputs),
        "units": np.array(json.dumps(dict(first.units))),
        "operating_point": np.array(json.dumps(dict(content.operating_point))),
    }
    np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]  # names are free


def _write_mat(path: Path, content: Content) -> None:
    from scipy.io import savemat

    first = content.first
    entries = {
        **{
            name: np.moveaxis(matrix, 0, -1) if matrix.ndim == 3 else matrix
            for name, matrix in content.matrices.items()
        },
        "dt": first.dt or 0.0,
        "states": _cells(first.states),
        "inputs": _cells(first.inputs),
        "outputs": _cells(first.outputs),
        "units": {_field(name): unit for name, unit in first.units.items()},
        "operating_point": {_field(name): value for name, value in content.operating_point.items()},
    }
    savemat(path, entries, long_field_names=True)


def _cells(names: Iterable[str]) -> NDArray[np.object_]:
    """A column cell array of texts."""
    return np.array([*names, ""], dtype=object)[:-1, None]


def _field(name: str) -> str:
    """A name as a field of a MATLAB structure, which has no dots."""
    return name.replace(".", "_")


WRITERS: dict[str, Callable[[Path, Content], None]] = {
    ".json": _write_json,
    ".mat": _write_mat,
    ".npz": _write_npz,
}
"""Suffix → what writes it."""
