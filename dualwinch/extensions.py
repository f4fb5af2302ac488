"""What toolboxes add to the kernel, found by entry points: the kernel imports no toolbox.

A toolbox registers in `pyproject.toml`, in one of four groups. An installation's metadata may list toolboxes whose
folders have been removed since; these are left out.
"""

from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any

from dualwinch.model.errors import ConfigurationError

COMMANDS = "dualwinch.commands"
"""Group of the commands: name and function, or application."""

EXPORTS = "dualwinch.exports"
"""Group of the sub-commands of ``dualwinch export``: name and function."""

EXECUTORS = "dualwinch.executors"
"""Group of the executors: functions of the address of workers and of a printer of lines, which yield an executor."""

FUNCTIONS = "dualwinch.functions"
"""Group of the functions that a toolbox offers to commands of the kernel and of other toolboxes."""

TOOLBOXES = "dualwinch.toolboxes."
"""Package of the toolboxes."""


def extensions(group: str) -> Iterator[EntryPoint]:
    """The entry points of a group whose modules exist, in the order in which they are registered."""
    return (entry for entry in entry_points(group=group) if _exists(entry.module))


def extension(group: str, name: str, option: str) -> Any:
    """An object that a toolbox registers.

    Args:
        group: `COMMANDS`, `EXPORTS`, `EXECUTORS` or `FUNCTIONS`.
        name: its name there.
        option: of the command line or of a function, which needs it; the message begins with it.

    Raises:
        ConfigurationError: its toolbox is not installed.
    """
    for entry in extensions(group):
        if entry.name == name:
            return entry.load()
    places = [entry.module for entry in entry_points(group=group, name=name)]
    raise ConfigurationError(f"{option}: {absent(places[0] if places else TOOLBOXES + name)}")


def absent(module: str) -> str:
    """Say which toolbox is missing, by one of its modules."""
    return f"needs the toolbox {module.removeprefix(TOOLBOXES).partition('.')[0]}, which is not installed"


def _exists(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # one of its packages
        return False
