"""NumPy: an array for each column, beside them units, what the columns are and every fact, as texts."""

import json
from pathlib import Path

import numpy as np

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.results.content import Content, about


def write(content: Content, path: Path) -> None:
    """Write a file.

    Raises:
        ConfigurationError: a column has the name of another entry.
    """
    described = {name: about(quantity) for name, quantity in content.quantities.items()}
    facts = {"units": content.units, "columns": described, **content.facts}
    texts = {key: np.array(value if isinstance(value, str) else json.dumps(value)) for key, value in facts.items()}
    for name in sorted(texts.keys() & content.columns.keys()):
        raise ConfigurationError(f"column '{name}': .npz files have another entry of this name; save as .parquet")
    with atomic(path) as unfinished:
        np.savez_compressed(unfinished, **content.columns, **texts)  # pyright: ignore[reportArgumentType]  # any name


def read(path: Path) -> Content:
    """Read a file of numbers."""
    with path.open("rb") as file, np.load(file) as arrays:
        described = json.loads(str(arrays["columns"]))
        return Content(
            columns={name: arrays[name] for name in described},
            quantities={name: Quantity(**texts) for name, texts in described.items()},
            facts={name: str(arrays[name]) for name in arrays.files if name not in described},
        )
