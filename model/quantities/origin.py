"""Where a part comes from: the file or module that defines it, and a digest of that source."""

import hashlib
import inspect
import site
import sys
import sysconfig
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

PACKAGE = __name__.partition(".")[0]

PLUGIN = "_plugin_of_dualwinch_"
"""What the names of modules begin with that were imported from a file that somebody named."""


def built_in(part: type) -> bool:
    """Whether a part comes with the product."""
    return part.__module__.partition(".")[0] == PACKAGE


def source_of(part: type) -> str:
    """Where a part is defined: the path of a file for one from a script or a named file, else the name of a module."""
    module = sys.modules.get(part.__module__)
    path = _path(module) if module else None
    if path and (part.__module__ == "__main__" or part.__module__.startswith(PLUGIN)):
        return str(path)
    return part.__module__


def origin(part: type) -> tuple[str, str]:
    """What is the same for a part that is defined again, such as by a notebook's cell: its file, else module, and name.

    One file may be known under several modules' names.
    """
    module = sys.modules.get(part.__module__)
    path = _path(module) if module else None
    return str(path or part.__module__), part.__qualname__


def named(part: type) -> str:
    """A part as errors name it: its class, and where it is defined."""
    source, name = source_of(part), part.__qualname__.rpartition("<locals>.")[2]
    return f"{name} of {Path(source).name}" if source.endswith(".py") else f"{source}.{name}"


def digest(part: type) -> str:
    """SHA-256 of the sources that define a part; empty where they cannot be read, as of what was typed at a prompt.

    These are the modules of its class and of the classes it is made from, and what these take from files beside them or
    from their own package. Libraries do not count.
    """
    texts = [_text(module) or _text_of(part) for module in _modules(part)]
    if part.__module__ not in sys.modules or not all(texts):
        return ""
    digests = sorted(hashlib.sha256(text.encode()).hexdigest() for text in texts)
    return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()


def _text(module: ModuleType) -> str:
    """The source of a module as it was imported, where its loader keeps that, else as it is now."""
    read = getattr(getattr(module.__spec__, "loader", None), "get_source", None)
    try:
        return (read(module.__spec__.name) if read and module.__spec__ else inspect.getsource(module)) or ""
    except (OSError, TypeError, ImportError):
        return ""


def _text_of(part: type) -> str:
    """The source of a class, which a notebook's cell has; a notebook itself has none."""
    try:
        return inspect.getsource(part)
    except (OSError, TypeError):
        return ""


def _modules(part: type) -> list[ModuleType]:
    """The modules that define a part, without the product's own."""
    waiting = [sys.modules[base.__module__] for base in part.__mro__ if _counts(base.__module__)]
    found: dict[str, ModuleType] = {}
    while waiting:
        module = waiting.pop()
        if module.__name__ not in found:
            found[module.__name__] = module
            waiting += _companions(module)
    return list(found.values())


def _counts(name: str) -> bool:
    top = name.partition(".")[0]
    return name in sys.modules and top != PACKAGE and top not in sys.stdlib_module_names


def _companions(module: ModuleType) -> Iterator[ModuleType]:
    """Modules beside a module, in its folder or package, that its names come from."""
    for value in list(vars(module).values()):
        name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
        other = sys.modules.get(name) if isinstance(name, str) else None
        if other and other is not module and _counts(other.__name__) and _beside(other, module):
            yield other


def _beside(other: ModuleType, module: ModuleType) -> bool:
    top = module.__name__.partition(".")[0]
    if other.__name__.partition(".")[0] == top:
        return True
    theirs, ours = _path(other), _path(module)
    return theirs is not None and ours is not None and theirs.parent == ours.parent not in _libraries()


def _path(module: ModuleType) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file).resolve() if file and Path(file).is_file() else None


@cache
def _libraries() -> frozenset[Path]:
    """Folders of installed modules, which have nothing to do with each other."""
    folders = [*sysconfig.get_paths().values(), *site.getsitepackages(), site.getusersitepackages()]
    return frozenset(Path(folder).resolve() for folder in folders)
