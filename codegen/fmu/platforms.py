"""Platforms an FMU's binary can be built for, and the compilers that build it."""

import platform
from dataclasses import dataclass, replace

from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.errors import CodegenError, CompilerNotFoundError

PORTABLE = ("-fno-finite-math-only", "-ftrapping-math", "-s")
"""After the flags of every build: an FMU must notice values that are not finite."""


@dataclass(frozen=True)
class Platform:
    """One platform.

    Attributes:
        name: its folder in an FMU of FMI 2, and how it is asked for.
        tuple_: its folder in an FMU of FMI 3.
        suffix: of a shared library.
        target: for zig; oldest system libraries the binary runs with included.
        machine: a processor every such machine has, for gcc and clang.
    """

    name: str
    tuple_: str
    suffix: str
    target: str
    machine: str


PLATFORMS = {
    supported.name: supported
    for supported in (
        Platform("linux64", "x86_64-linux", ".so", "x86_64-linux-gnu.2.17", "x86-64"),
        Platform("win64", "x86_64-windows", ".dll", "x86_64-windows-gnu", "x86-64"),
        Platform("darwin64", "x86_64-darwin", ".dylib", "x86_64-macos.11.0-none", "x86-64"),
        Platform("aarch64-linux", "aarch64-linux", ".so", "aarch64-linux-gnu.2.17", "armv8-a"),
        Platform("aarch64-darwin", "aarch64-darwin", ".dylib", "aarch64-macos.11.0-none", "armv8-a"),
    )
}
"""Every platform by its name."""


def find_platform(name: str) -> Platform | None:
    """The platform of a name, FMI 2's or FMI 3's; None where there is none."""
    return next((known for known in PLATFORMS.values() if name in {known.name, known.tuple_}), None)


def host_platform() -> Platform:
    """The platform this runs on.

    Raises:
        CodegenError: it is none of those an FMU can have.
    """
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    found = find_platform(f"{machine}-{platform.system().lower()}")
    if found is None:
        raise CodegenError(f"{platform.system()} on {machine} is no platform of an FMU; name others")
    return found


def compiler_for(wanted: Platform) -> tuple[Compiler, tuple[str, ...]]:
    """Compiler and flags that build for a platform: zig where it is installed, else the machine's own for its own.

    Raises:
        CompilerNotFoundError: zig is not installed and the platform is not this one, or there is no compiler.
    """
    try:
        zig = find_compiler("zig")
    except CompilerNotFoundError:
        if wanted is not host_platform():
            raise CompilerNotFoundError(
                f"no compiler for {wanted.name}: it needs zig; run: pip install 'dualwinch[zig]'"
            ) from None
        return find_compiler(), (*PORTABLE, f"-march={wanted.machine}")
    return replace(zig, command=(*zig.command, "-target", wanted.target)), PORTABLE
