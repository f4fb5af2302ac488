"""Linear systems as files: JSON, MATLAB (for MATLAB, Octave and SciPy) and NumPy, chosen by suffix.

Every format holds the same entries: ``A, B, C, D, dt, states, inputs, outputs, units, operating_point``. A
continuous system has ``dt`` null in JSON and 0 elsewhere, so that ``ss(A, B, C, D, dt)`` is right in MATLAB and Octave.
"""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.files import atomic
from model.errors import ConfigurationError
from model.linear_system import LinearSystem


def save(system: LinearSystem, path: Path) -> None:
    """Write a linear system to a file; the file appears whole or not at all.

    Args:
        system: what to write.
        path: its suffix chooses the format: json, mat, npz.

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    write = writer(path)
    with atomic(path) as unfinished:
        write(unfinished, system)


def writer(path: Path) -> Callable[[Path, LinearSystem], None]:
    """What writes the format of a path's suffix.

    Raises:
        ConfigurationError: unknown suffix.
    """
    try:
        return WRITERS[path.suffix.lower()]
    except KeyError:
        allowed = ", ".join(WRITERS)
        raise ConfigurationError(f"{path.name}: unknown suffix {path.suffix!r}; must be one of {allowed}") from None


def as_json(system: LinearSystem) -> dict[str, Any]:
    """The entries of the JSON file: matrices as lists of rows."""
    return {
        **{name: matrix.tolist() for name, matrix in _matrices(system).items()},
        "dt": system.dt,
        "states": list(system.states),
        "inputs": list(system.inputs),
        "outputs": list(system.outputs),
        "units": dict(system.units),
        "operating_point": dict(system.operating_point),
    }


def _matrices(system: LinearSystem) -> dict[str, NDArray[np.float64]]:
    return {"A": system.A, "B": system.B, "C": system.C, "D": system.D}


def _write_json(path: Path, system: LinearSystem) -> None:
    path.write_text(json.dumps(as_json(system), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _write_npz(path: Path, system: LinearSystem) -> None:
    np.savez_compressed(
        path,
        **_matrices(system),
        dt=np.array(system.dt or 0.0),
        states=np.array(system.states),
        inputs=np.array(system.inputs),
        outputs=np.array(system.outputs),
        units=np.array(json.dumps(dict(system.units))),
        operating_point=np.array(json.dumps(dict(system.operating_point))),
    )


def _write_mat(path: Path, system: LinearSystem) -> None:
    from scipy.io import savemat

    entries = {
        **_matrices(system),
        "dt": system.dt or 0.0,
        "states": _cells(system.states),
        "inputs": _cells(system.inputs),
        "outputs": _cells(system.outputs),
        "units": {_field(name): unit for name, unit in system.units.items()},
        "operating_point": {_field(name): value for name, value in system.operating_point.items()},
    }
    savemat(path, entries, long_field_names=True)


def _cells(names: Iterable[str]) -> NDArray[np.object_]:
    """A column cell array of texts."""
    return np.array([*names, ""], dtype=object)[:-1, None]


def _field(name: str) -> str:
    """A name as a field of a MATLAB structure, which has no dots."""
    return name.replace(".", "_")


WRITERS: dict[str, Callable[[Path, LinearSystem], None]] = {
    ".json": _write_json,
    ".mat": _write_mat,
    ".npz": _write_npz,
}
"""Suffix → what writes it."""
