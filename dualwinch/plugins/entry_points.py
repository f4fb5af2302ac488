"""Parts that installed packages offer, as entry points of the group ``dualwinch.parts``.

A package names them in its ``pyproject.toml``, each a module or a class::

    [project.entry-points."dualwinch.parts"]
    mine = "my_package.laws"
    other = "my_package.observers:Other"
"""

import warnings
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType

from dualwinch.model.errors import ConfigurationError
from dualwinch.plugins.files import parts_of
from dualwinch.plugins.register import register

GROUP = "dualwinch.parts"
"""Name of the group."""


class EntryPointWarning(UserWarning):
    """An installed package offers a part that cannot be had."""


@cache
def load_entry_points() -> None:
    """Register what installed packages offer, once; a package that fails is a warning, never an error."""
    for entry in entry_points(group=GROUP):
        try:
            _load(entry)
        except Exception as error:  # noqa: BLE001  another's package must not stop anything here
            text = " ".join(str(error).split())
            reason = text if isinstance(error, ConfigurationError) else f"{type(error).__name__}: {text}"
            owner = entry.dist.name if entry.dist else "a package without a name"
            told = f"{owner}: its part '{entry.name}' ({GROUP}, {entry.value}) is left out: {reason}"
            warnings.warn(told, EntryPointWarning, stacklevel=2)


def _load(entry: EntryPoint) -> None:
    found = entry.load()
    parts = list(parts_of(found)) if isinstance(found, ModuleType) else [found]
    if not parts:
        raise ConfigurationError("defines no part")
    for part in parts:
        register(part)
