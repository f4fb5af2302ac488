"""Linear systems as files: JSON, MATLAB (for MATLAB, Octave and SciPy) and NumPy, chosen by suffix.

Every format holds the same entries: ``A, B, C, D, dt, states, inputs, outputs, units, operating_point``. A
continuous system has ``dt`` null in JSON and 0 elsewhere, so that ``ss(A, B, C, D, dt)`` is right in MATLAB and Octave.

A sweep of systems fills the same entries: matrices get one more axis over the points (the first; in MATLAB files the
last, so that ``A(:, :, k)`` is a matrix), and every number of the operating point becomes a list.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError


@dataclass(frozen=True)
class Content:
    """What a file holds: one system, or a sweep of systems, whose names and sample time are those of the content.

    Attributes:
        matrices: ``A``, ``B``, ``C``, ``D`` → the matrix, or those of a sweep with the points as their first axis.
        dt: sample time in s; None: continuous time.
        states, inputs, outputs: names.
        units: name → unit.
        operating_point: name → value, or values of a sweep.
    """

    matrices: Mapping[str, NDArray[np.float64]]
    dt: float | None
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    operating_point: Mapping[str, float | list[float]]


def write(content: Content, path: str | PathLike[str]) -> None:
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


def writer(path: str | PathLike[str]) -> Callable[[Path, Content], None]:
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


def _write_json(path: Path, content: Content) -> None:
    entries = {
        **{name: matrix.tolist() for name, matrix in content.matrices.items()},
        "dt": content.dt,
        "states": list(content.states),
        "inputs": list(content.inputs),
        "outputs": list(content.outputs),
        "units": dict(content.units),
        "operating_point": dict(content.operating_point),
    }
    path.write_text(json.dumps(entries, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _write_npz(path: Path, content: Content) -> None:
    arrays = {
        **content.matrices,
        "dt": np.array(content.dt or 0.0),
        "states": np.array(content.states),
        "inputs": np.array(content.inputs),
        "outputs": np.array(content.outputs),
        "units": np.array(json.dumps(dict(content.units))),
        "operating_point": np.array(json.dumps(dict(content.operating_point))),
    }
    np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]  # names are free


def _write_mat(path: Path, content: Content) -> None:
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
