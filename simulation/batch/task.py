"""A task for a worker of an executor: a function with its arguments, and checks that its environment is the same.

A worker may be a process on another machine. To compute the same bits, it must run the same dualwinch, CasADi and
NumPy, and users' parts must be the same: those of a file (``--plugin FILE``) are sent as source text, those of
installed modules are compared by digest. Any difference is a one-line error.
"""

import hashlib
import importlib
import io
import pickle
import socket
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib.abc import InspectLoader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, Self

from dualwinch.codegen.compiler import EXACT, exactly
from dualwinch.codegen.errors import CacheError, CompileError, CompilerNotFoundError, DualwinchError
from dualwinch.codegen.text import one_line
from dualwinch.model.quantities.part import (
    PACKAGE,
    PLUGIN,
    Part,
    built_in,
    digest,
    modules_of,
    named,
    registries,
    text_of,
)


class WorkerError(DualwinchError):
    """A worker cannot compute a task: it has another version, cannot compile, or was lost repeatedly."""


class WorkerCompileError(WorkerError):
    """A worker cannot compile.

    Attributes:
        worker: its address, where the executor knows it.
    """

    worker = ""


@dataclass(frozen=True)
class ModuleSource:
    """The source of a module that a worker may not have."""

    name: str
    file: str
    text: str


@dataclass(frozen=True)
class WorkerTask:
    """A function with its arguments, as sent to a worker.

    Attributes:
        versions: library → version, which must be the same on the worker.
        sources: modules of files that define users' parts.
        digests: (module, class, digest) of users' parts in installed modules.
        exact: whether to compile with `Compiler.exact`.
        payload: function and arguments, pickled.
    """

    versions: dict[str, str]
    sources: tuple[ModuleSource, ...]
    digests: tuple[tuple[str, str, str], ...]
    exact: bool
    payload: bytes

    @classmethod
    def of(cls, work: Callable[..., Any], *arguments: Any) -> Self:
        """The task of a call.

        Raises:
            WorkerError: an argument cannot be pickled, such as a part defined inside a function.
        """
        stream = io.BytesIO()
        pickler = _Pickler(stream)
        try:
            pickler.dump((work, arguments))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise WorkerError(
                f"workers: {one_line(error)}; a part of your own that other processes use must be defined in a file"
            ) from error
        from_files = {part for part in _registered() | pickler.parts if part.__module__.startswith(PLUGIN)}
        modules = {module.__name__: module for part in from_files for module in modules_of(part)}
        imported = sorted(pickler.parts - from_files, key=lambda part: (part.__module__, part.__qualname__))
        return cls(
            versions=versions(),
            sources=tuple(
                ModuleSource(name, str(modules[name].__file__), text_of(modules[name])) for name in sorted(modules)
            ),
            digests=tuple((part.__module__, part.__qualname__, digest(part)) for part in imported),
            exact=exactly(),
            payload=stream.getvalue(),
        )

    def key(self, work: Callable[..., Any], *arguments: Any) -> str:
        """A digest of the call and of the versions and parts that compute it, the same in every process.

        The parts are those in the arguments, and those whose kind is written in them.
        """
        stream = io.BytesIO()
        pickler = _CanonicalPickler(stream)
        pickler.fast = True
        pickler.dump((work, arguments))
        call = stream.getvalue()
        parts = pickler.parts | {part for part in _registered() if part.kind.encode() in call}
        modules = {module.__name__ for part in parts for module in modules_of(part)}
        sources = [(source.name, source.text) for source in self.sources if source.name in modules]
        surroundings = pickle.dumps((self.versions, sources, self.digests, self.exact))
        return hashlib.sha256(surroundings + call).hexdigest()


def _registered() -> set[type[Part]]:
    """Parts in registries that do not belong to the product."""
    return {part for registry in registries() for part in registry.values() if not built_in(part)}


class _Pickler(pickle.Pickler):
    """Pickles, and collects the users' parts that it encounters."""

    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream, protocol=pickle.HIGHEST_PROTOCOL)
        self.parts = set[type[Part]]()

    def reducer_override(self, thing: Any) -> Any:
        """Note a user's part; pickle as usual."""
        if isinstance(thing, type) and issubclass(thing, Part) and not built_in(thing):
            self.parts.add(thing)
        return NotImplemented


class _CanonicalPickler(_Pickler):
    """Pickles equal objects alike, and with `fast` without references to earlier objects.

    A set is its elements in sorted order. A dataclass is the fields that are compared: what else it holds may depend on
    how it was used.
    """

    def persistent_id(self, thing: Any) -> Any:
        """What is pickled in the place of a set or of a dataclass; ``None``: the object itself."""
        if isinstance(thing, set | frozenset):
            return sorted(thing, key=repr)
        if is_dataclass(thing) and not isinstance(thing, type):
            return type(thing), [getattr(thing, field.name) for field in fields(thing) if field.compare]
        return None


@cache
def versions() -> dict[str, str]:
    """Versions that determine the bits of a result, dualwinch's own with a digest of its sources."""
    files = {
        f"{folder.name}/{file.relative_to(folder.resolve())}": file
        for folder in Path(str(sys.modules[PACKAGE].__file__)).parent.iterdir()
        if folder.is_dir()
        for file in folder.resolve().rglob("*")
        if file.suffix in {".py", ".c", ".h"}
    }
    sources = hashlib.sha256()
    for name in sorted(files):
        sources.update(name.encode() + files[name].read_bytes())
    libraries = {name: version(name) for name in ("casadi", "numpy", "scipy")}
    return {PACKAGE: f"{version(PACKAGE)} (sources {sources.hexdigest()[:12]})", **libraries}


def run_task(task: WorkerTask) -> Any:
    """Compute a task, on a worker.

    Raises:
        WorkerError: the worker has another version or another part, or is out of memory.
        WorkerCompileError: it cannot compile.
        DualwinchError: as raised by the function.
    """
    where = f"worker on {socket.gethostname()}"
    for name, required in task.versions.items():
        if (here := versions().get(name)) != required:
            raise WorkerError(f"{where}: has {name} {here}, must be {required}; install the same on all machines")
    _import_missing(where, task.sources)
    _compare(where, task.digests)
    try:
        work, arguments = pickle.loads(task.payload)  # noqa: S301  from the client whose worker this is
    except (ImportError, AttributeError) as error:
        raise WorkerError(
            f"{where}: {one_line(error)}; a part of your own must be defined in a file, --plugin FILE, or be installed"
        ) from error
    before = EXACT.set(task.exact)
    try:
        return work(*arguments)
    except (CompilerNotFoundError, CompileError, CacheError) as error:
        raise WorkerCompileError(f"{where}: {error}") from error
    except MemoryError as error:
        raise WorkerError(f"{where}: out of memory") from error
    finally:
        EXACT.reset(before)


def _import_missing(where: str, sources: Sequence[ModuleSource]) -> None:
    """Import missing modules from their sources, and register the parts they define.

    Raises:
        WorkerError: another version of a module is already imported.
    """
    if not sources:
        return
    finder = _Finder({source.name: source for source in sources})
    sys.meta_path.append(finder)  # last, so that installed modules take precedence
    try:
        for source in sources:
            module = importlib.import_module(source.name)
            if text_of(module) != source.text:
                raise WorkerError(f"{where}: has another version of {Path(source.file).name}; restart the workers")
            for part in vars(module).values():
                if isinstance(part, type) and issubclass(part, Part) and part.__module__ == source.name:
                    _register(part)
    finally:
        sys.meta_path.remove(finder)


def _register(part: type[Part]) -> None:
    """Register a part; the client has already checked it."""
    if part.registry is not None and isinstance(getattr(part, "kind", None), str):
        with part.registry.adding(part):
            pass


def _compare(where: str, digests: Sequence[tuple[str, str, str]]) -> None:
    for name, qualified, required in digests:
        try:
            part: Any = importlib.import_module(name)
            for attribute in qualified.split("."):
                part = getattr(part, attribute)
        except (ImportError, AttributeError) as error:
            raise WorkerError(f"{where}: has no {name}.{qualified}: {one_line(error)}; install it there") from error
        if digest(part) != required:
            raise WorkerError(f"{where}: has another version of {named(part)}; install the same on all machines")


class _Finder(MetaPathFinder):
    """Finds modules whose sources came with a task."""

    def __init__(self, sources: dict[str, ModuleSource]) -> None:
        self._sources = sources

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:  # noqa: ARG002
        """The specification of a module that came with a task."""
        source = self._sources.get(fullname)
        return ModuleSpec(fullname, SourceLoader(source.file, source.text), origin=source.file) if source else None


class SourceLoader(InspectLoader):
    """Loads a module from the text of a file, and keeps the text (`model.quantities.part.text_of`)."""

    def __init__(self, file: str, text: str) -> None:
        self._file, self._text = file, text

    def get_source(self, fullname: str) -> str:  # noqa: ARG002
        """The text."""
        return self._text

    def exec_module(self, module: ModuleType) -> None:
        """Execute the module under the name of its original file."""
        module.__file__ = self._file
        exec(compile(self._text, self._file, "exec"), vars(module))  # noqa: S102
