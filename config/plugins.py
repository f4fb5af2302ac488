"""Parts from outside the package: registered by users, imported from files and modules, found as entry points.

Installed packages offer parts as entry points of the group ``dualwinch.parts`` in their ``pyproject.toml``, each a
module or a class::

    [project.entry-points."dualwinch.parts"]
    mine = "my_package.laws"
    other = "my_package.observers:Other"
"""

import hashlib
import importlib
import importlib.util
import inspect
import sys
import traceback
import warnings
from collections.abc import Iterator
from functools import cache
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import TypeVar

import dualwinch.simulation.ensembles.ensemble  # noqa: F401  registries that no experiment holds
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import check_keys, every_leaf
from dualwinch.model.quantities.part import PLUGIN, Part, base_of, check_defaults, named, registries, text_of
from dualwinch.simulation.batch.task import SourceLoader
from dualwinch.simulation.experiment import Experiment

PartType = TypeVar("PartType", bound=type[Part])

GROUP = "dualwinch.parts"
"""Name of the group of entry points."""


def register(part: PartType) -> PartType:
    """Register a part of your own under its kind; also a decorator.

    It can then be used like a built-in part: ``controller.kind = "mine"`` in files, ``--set``, `dualwinch.override`
    and searches for gains. Objects of the class work in Python without it.

    Args:
        part: a frozen dataclass that subclasses `PositionLaw`, `Estimator`, `Coordination` or another base of parts.
            A second definition, such as by a notebook cell that runs again, replaces the first.

    Returns:
        The same class.

    Raises:
        ConfigurationError: the class cannot be a part, or its kind or one of its keys is taken by another.

    Example:
        >>> from dataclasses import dataclass
        >>> from typing import Annotated, ClassVar
        >>> import annotated_types as at
        >>> import dualwinch as dw
        >>> @dw.register
        ... @dataclass(frozen=True)
        ... class Spring(dw.PositionLaw):
        ...     stiffness: Annotated[float, at.Gt(0), dw.Quantity("N/m", "force per position error")] = 1e4
        ...     kind: ClassVar = "spring"
        ...     label: ClassVar = "spring"
        ...     def initial_state(self):
        ...         return dw.NoState()
        ...     def step(self, state, estimate, setpoint, context):
        ...         u = self.stiffness * (setpoint.x - estimate.x)
        ...         return state, dw.PositionOutput(u, dw.clip(u, -context.limits.force, context.limits.force))
        ...
        >>> dw.override(dw.case(2), {"controller.kind": "spring"}).controller.law
        Spring(stiffness=10000.0)
    """
    if not (isinstance(part, type) and issubclass(part, Part)):
        name = part.__name__ if isinstance(part, type) else repr(part)
        raise ConfigurationError(f"{name}: must be a class that subclasses {_bases()}")
    if part.registry is None:
        raise ConfigurationError(f"{named(part)}: must subclass {_bases()}")

    def excluded(owner: type) -> bool:
        """Whether another part has the same table, but never together with this one."""
        return not part.table() and issubclass(owner, base_of(part))

    with part.registry.adding(part):
        leaves = list(every_leaf(Experiment))
        part_leaves = {leaf.key: leaf for owner, leaf in leaves if owner is part}
        if part_leaves:
            check_defaults(part)
        check_keys(
            part, part_leaves, ((owner, leaf) for owner, leaf in leaves if owner is not part and not excluded(owner))
        )
    return part


def _bases() -> str:
    names = [base.__name__ for base in Part.__subclasses__() if base.registry is not None]
    return f"{', '.join(names[:-1])} or {names[-1]}"


def load_plugin(plugin: str) -> None:
    """Import a file or module and register the parts it defines.

    A file becomes a module with a unique name; modules beside it can be imported while it is loaded.

    Args:
        plugin: path of a Python file, or name of a module.

    Raises:
        ConfigurationError: it does not exist, cannot be imported, defines no part, or one that cannot be registered.
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
    """Every part that a module or package defines, including abstract classes with a kind, which `register` refuses."""
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


def _from_file(path: Path) -> ModuleType:
    """The module of a file, under a unique name; imported again if its text has changed."""
    path = path.resolve()
    name = f"{PLUGIN}{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:12]}"
    try:
        text = importlib.util.decode_source(path.read_bytes())
    except OSError as error:
        raise ConfigurationError(f"plugin {path}: cannot be read ({error.strerror})") from error
    except (SyntaxError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"plugin {path.name}: {_reason(error, path)}") from error
    loaded_module = sys.modules.get(name)
    if loaded_module is not None and text_of(loaded_module) == text:
        return loaded_module
    loader = SourceLoader(str(path), text)
    module = importlib.util.module_from_spec(ModuleSpec(name, loader, origin=str(path)))
    sys.modules[name] = module
    sys.path.append(str(path.parent))  # last, so that no file beside it hides an installed module
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
    """An error of a plugin's import in one line, with the line of the plugin if known."""
    if isinstance(error, SyntaxError):
        return f"line {error.lineno}: {error.msg}"
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if path and frame.filename == str(path)]
    where = f"line {frames[-1].lineno}: " if frames else ""
    text = " ".join(str(error).split())
    return f"{where}{text}" if isinstance(error, ConfigurationError) else f"{where}{type(error).__name__}: {text}"


class EntryPointWarning(UserWarning):
    """An installed package offers a part that cannot be registered."""


@cache
def load_entry_points() -> None:
    """Register the parts of installed packages, once; a package that fails is a warning, never an error."""
    for entry in entry_points(group=GROUP):
        try:
            _load(entry)
        except Exception as error:  # noqa: BLE001  a faulty package must not stop the others
            text = " ".join(str(error).split())
            reason = text if isinstance(error, ConfigurationError) else f"{type(error).__name__}: {text}"
            owner = entry.dist.name if entry.dist else "a package without a name"
            words = f"{owner}: its part '{entry.name}' ({GROUP}, {entry.value}) is left out: {reason}"
            warnings.warn(words, EntryPointWarning, stacklevel=2)


def _load(entry: EntryPoint) -> None:
    content = entry.load()
    parts = list(parts_of(content)) if isinstance(content, ModuleType) else [content]
    if not parts:
        raise ConfigurationError("defines no part")
    for part in parts:
        register(part)
