"""Finds a C compiler: ``DUALWINCH_CC``, ``CC``, gcc, clang, cc, then the `ziglang` package."""

import hashlib
import importlib.util
import os
import platform
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cache, wraps
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from dualwinch.codegen.errors import CompileError, CompilerNotFoundError, installing

Arguments = ParamSpec("Arguments")

Built = TypeVar("Built")

OPTIMISE = (
    "-std=c99",
    "-O3",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffinite-math-only",  # without it fmin and fmax are library calls; the driver tests for non-finite by bits
    "-fno-signed-zeros",
    "-ffp-contract=off",  # the same bits from every compiler; drivers of rollouts override it
)
"""Flags of every build; none of them lets a compiler reorder sums or contract products."""

INEXACT = ("-ffp-contract=fast", "-freciprocal-math")
"""Flags of drivers that change the last bits, differently by compiler and processor."""

NON_FINITE = ("-fno-finite-math-only",)
"""A single function takes any values: infinities and NaN give the same results as in the interpreter."""

EXACT: ContextVar[bool | None] = ContextVar("exact", default=None)
"""Whether compilers are `Compiler.exact` in the present context; None: if ``DUALWINCH_EXACT`` is 1."""


def exactly() -> bool:
    """Whether compilers are `Compiler.exact` in the present context."""
    exact = EXACT.get()
    return os.environ.get("DUALWINCH_EXACT") == "1" if exact is None else exact


SCHEDULED = ("-fschedule-insns", "-fsched-pressure")
"""Flags of gcc for long straight-line code: scheduling before register allocation, limited by register pressure."""

SHARED = ("-shared", "-fPIC", "-fvisibility=hidden")

NO_COMPILER = (
    f"no C compiler found; either install gcc or clang (e.g. the system package 'gcc'), or run: {installing('zig')}"
)


@dataclass(frozen=True)
class Compiler:
    """A C compiler on this machine.

    Attributes:
        name: ``gcc``, ``clang``, ``zig`` or the name of the given command.
        command: command line.
        version: first line of its version information.
        exact: whether contraction of products and divisions by reciprocals are off, so that all compilers and
            processors give the same bits.
    """

    name: str
    command: tuple[str, ...]
    version: str
    exact: bool = False

    @property
    def is_clang(self) -> bool:
        """Whether it is clang, under any name."""
        return self.name == "zig" or "clang" in self.version

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of a shared library for this machine's processor, or the one named in the command."""
        named = any(word.startswith(("-march=", "-mcpu=")) for word in self.command)
        takes_native = platform.machine().lower() in {"x86_64", "amd64", "aarch64", "arm64"}
        native = () if named or self.name == "zig" or not takes_native else ("-march=native",)
        finite = ("-fno-finite-math-only",) if self.is_clang else ()  # else NaN <= x, a missing reading, is true
        return OPTIMISE + finite + native + SHARED

    @property
    def pairs(self) -> bool:
        """Whether code in lanes processes two vectors at a time, to hide the latency of instructions.

        Twice the values need the 32 registers of AVX-512 and AArch64. With the 16 of AVX2 half the code is as fast,
        and compiles in half the time. clang interleaves by itself.
        """
        return not self.is_clang and not {"__AVX512F__", "__aarch64__"}.isdisjoint(_macros(self.command, self.flags))

    @property
    def identity(self) -> str:
        """Everything besides the source that affects a build: compiler, version, flags, processor."""
        words = ("exact",) if self.exact else ()
        return "\n".join((*self.command, self.version, *self.flags, *words, processor()))

    def build(self, source: str, target: Path, extra_flags: tuple[str, ...] = ()) -> None:
        """Compile C source to a shared library.

        Args:
            source: one translation unit.
            target: file to write.
            extra_flags: appended to `flags`.

        Raises:
            CompileError: the compiler cannot be started or fails; the message has its first error.
        """
        allowed = [flag for flag in extra_flags if not self.exact or flag not in INEXACT]
        self.run(source, target, (*self.flags, *allowed))

    def run(self, source: str, target: Path, flags: Sequence[str]) -> None:
        """Compile C source with only these flags; otherwise as `build`."""
        with tempfile.TemporaryDirectory(dir=target.parent, prefix="build-") as folder:
            (Path(folder) / "unit.c").write_text(source, encoding="utf-8")
            command = [*self.command, *flags, "unit.c", "-o", f"unit{target.suffix}", "-lm"]
            try:
                process = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            except OSError as error:
                raise CompileError(f"cannot run the C compiler {self.command[0]}: {error.strerror}") from error
            if process.returncode == 0:
                if not (Path(folder) / f"unit{target.suffix}").exists():
                    raise CompileError(
                        f"{' '.join(self.command)} made no library: it is no C compiler (DUALWINCH_CC or CC)"
                    )
                (Path(folder) / f"unit{target.suffix}").replace(target)  # by-products are deleted with the folder
        if process.returncode != 0:
            complaint = next(
                (line for line in process.stderr.splitlines() if "error" in line), process.stderr.strip()[:200]
            )
            raise CompileError(f"{' '.join(self.command)} failed with exit code {process.returncode}: {complaint}")


@cache
def _macros(command: tuple[str, ...], flags: tuple[str, ...]) -> frozenset[str]:
    """Names of the macros that a compiler defines with some flags."""
    words = [*command, *flags, "-dM", "-E", "-x", "c", os.devnull]
    try:
        answer = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return frozenset()
    return frozenset(re.findall(r"^#define (\w+)", answer.stdout, re.MULTILINE))


@cache
def _cpuinfo() -> dict[str, str]:
    file = Path("/proc/cpuinfo")
    text = file.read_text(errors="replace") if file.exists() else ""
    return dict(re.findall(r"^(model name|flags|Features|CPU part)\s*:\s*(.*)$", text, re.MULTILINE))


def processor_name() -> str:
    """Model of this machine's processor, if known."""
    return _cpuinfo().get("model name") or platform.processor() or platform.machine()


def processor() -> str:
    """Model and instruction sets of this machine's processor."""
    return " ".join((platform.system(), platform.machine(), processor_name(), *sorted(_cpuinfo().values())))


def vector_features() -> tuple[str, ...]:
    """The vector instruction sets of this machine's processor, widest first."""
    words = set(processor().split())
    return tuple(name for name in ("avx512f", "avx2", "fma", "sse4_2", "asimd", "neon") if name in words)


def _ask_version(command: tuple[str, ...]) -> str | None:
    try:
        answer = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=30, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout.splitlines()[0].strip() if answer.returncode == 0 and answer.stdout else None


def _zig() -> Compiler | None:
    spec = importlib.util.find_spec("ziglang")
    if spec is None or not spec.submodule_search_locations:
        return None
    zig = Path(spec.submodule_search_locations[0]) / ("zig.exe" if os.name == "nt" else "zig")
    try:
        return Compiler("zig", (str(zig), "cc"), f"ziglang {version('ziglang')}")
    except PackageNotFoundError:
        return None


def find_compiler(command: str | None = None) -> Compiler:
    """The C compiler to use.

    Args:
        command: of a compiler, or ``zig``; by default the environment's ``DUALWINCH_CC`` or ``CC``, else the first of
            gcc, clang, cc and zig.

    Raises:
        CompilerNotFoundError: there is none, or `command` is no C compiler.
    """
    command = command or os.environ.get("DUALWINCH_CC") or os.environ.get("CC")
    compiler = _find(command, os.environ.get("PATH", ""))
    return replace(compiler, exact=True) if exactly() else compiler


def with_compiler(build: Callable[Concatenate[Compiler, Arguments], Built]) -> Callable[Arguments, Built]:
    """Decorator: the first argument is `find_compiler()` at each call, so that it is in the key of caches."""

    @wraps(build)
    def built(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Built:
        return build(find_compiler(), *args, **kwargs)

    return built


@cache
def _find(wanted: str | None, path: str) -> Compiler:
    if wanted:
        try:
            command = tuple(shlex.split(wanted))
        except ValueError as error:  # an unclosed quotation mark
            message = str(error).lower()
            raise CompilerNotFoundError(f"{wanted!r} is no command (DUALWINCH_CC or CC): {message}") from error
        version_line = None if wanted == "zig" else _ask_version(command)
        named = Compiler(Path(command[0]).stem, command, version_line) if version_line else None
        candidate = _zig() if wanted == "zig" else named
        if candidate is None:
            raise CompilerNotFoundError(f"{wanted!r} is no working C compiler (DUALWINCH_CC or CC); {NO_COMPILER}")
        return candidate
    for name in ("gcc", "clang", "cc"):
        where = shutil.which(name, path=path)
        version_line = _ask_version((where,)) if where else None
        if where and version_line:
            return Compiler(name, (where,), version_line)
    zig = _zig()
    if zig is None:
        raise CompilerNotFoundError(NO_COMPILER)
    return zig


def fingerprint(*parts: str) -> str:
    """Hexadecimal digest of some texts."""
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]
