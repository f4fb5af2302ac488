"""Plugins: Python files and modules that define parts, imported and registered."""

import hashlib
import importlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Iterator
from importlib.abc import InspectLoader
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.origin import PLUGIN
from dualwinch.model.quantities.part import Part
from dualwinch.plugins.register import register, registries


def load_plugin(plugin: str) -> None:
    """Import a file or module and register the parts it defines.

    A file becomes a module of a name of its own, so that it never meets another; modules beside it are found while it
    is imported.

    Args:
        plugin: path of a Python file, or name of a module.

    Raises:
        ConfigurationError: there is none, it cannot be imported, or defines no part, or one that cannot be
            registered.
    """
    before = _registered()
    module = _from_file(Path(plugin)) if plugin.endswith(".py") else _from_name(plugin)
    parts = list(parts_of(module))
    for part in parts:
        register(part)
    if not parts and _registered() == before:
        raise ConfigurationError(
            f"plugin {plugin}: defines no part; a part is a class that subclasses dw.PositionLaw, say"
        )


def parts_of(module: ModuleType) -> Iterator[type[Part]]:
    """Every part that a module, or a module of its package, defines; unfinished classes with a kind among them."""
    for value in list(vars(module).values()):
        if not (isinstance(value, type) and issubclass(value, Part)):
            continue
        defined_here = f"{value.__module__}.".startswith(f"{module.__name__}.")
        if defined_here and (not inspect.isabstract(value) or "kind" in vars(value)):
            yield value


def _registered() -> set[type]:
    return {part for registry in registries() for part in registry.values()}


def _from_name(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name and f"{name}.".startswith(f"{error.name}."):
            raise ConfigurationError(
                f"plugin {name}: no such module; must be a Python file, FILE.py, or a module that is installed"
            ) from None
        raise ConfigurationError(f"plugin {name}: {_reason(error, None)}") from error


class _Source(InspectLoader):
    """A loader that keeps the text it has read: what was imported can still be told when the file has changed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.text = path.read_bytes()

    def has_read_what(self, module: ModuleType) -> bool:
        """Whether a module was made of the same text."""
        return isinstance(module.__loader__, _Source) and module.__loader__.text == self.text

    def get_source(self, fullname: str) -> str:  # noqa: ARG002
        return importlib.util.decode_source(self.text)

    def get_code(self, fullname: str) -> Any:
        return self.source_to_code(self.get_source(fullname), str(self._path))  # pyright: ignore[reportArgumentType]


def _from_file(path: Path) -> ModuleType:
    """The module of a file, under a name that only this file has; imported again where its text has changed."""
    path = path.resolve()
    name = f"{PLUGIN}{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:12]}"
    try:
        loader = _Source(path)
    except OSError as error:
        raise ConfigurationError(f"plugin {path}: cannot be read ({error.strerror})") from error
    known = sys.modules.get(name)
    if known is not None and loader.has_read_what(known):
        return known
    module = importlib.util.module_from_spec(ModuleSpec(name, loader, origin=str(path)))
    module.__file__ = str(path)
    sys.modules[name] = module
    sys.path.append(str(path.parent))  # last, so that nothing beside the file hides what is installed
    try:
        loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if not isinstance(error, Exception):
            raise
        raise ConfigurationError(f"plugin {path.name}: {_reason(error, path)}") from error
    finally:
        sys.path.remove(str(path.parent))
    return module


def _reason(error: Exception, path: Path | None) -> str:
    """What went wrong while a plugin was imported, in one line, with the line of the plugin where that is known."""
    if isinstance(error, SyntaxError):
        return f"line {error.lineno}: {error.msg}"
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if path and frame.filename == str(path)]
    where = f"line {frames[-1].lineno}: " if frames else ""
    text = " ".join(str(error).split())
    return f"{where}{text}" if isinstance(error, ConfigurationError) else f"{where}{type(error).__name__}: {text}"
