"""Build of an FMU: its C source, binaries for each platform, and the archive."""

import hashlib
import io
import math
import platform
import sys
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from itertools import accumulate

from dualwinch.toolbox import code_cache, compilers, errors, language, texts
from dualwinch.toolboxes.fmu.description import About, build_description, model_description
from dualwinch.toolboxes.fmu.model import FmuModel, FmuVariable

PORTABLE = ("-fno-finite-math-only", "-ftrapping-math", "-s")
"""Additional flags: an FMU must detect values that are not finite."""


@dataclass(frozen=True)
class Platform:
    """One platform.

    Attributes:
        name: its folder in an FMU of FMI 2, and its name in options.
        tuple_: its folder in an FMU of FMI 3.
        suffix: suffix of a shared library.
        target: target of zig, with the oldest supported system libraries.
        machine: baseline processor, for gcc and clang.
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
    """The platform of a name in FMI 2 or FMI 3; None if unknown."""
    return next((entry for entry in PLATFORMS.values() if name in {entry.name, entry.tuple_}), None)


def host_platform() -> Platform:
    """The platform of this machine.

    Raises:
        CodegenError: it is no platform of an FMU.
    """
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    platform_here = find_platform(f"{machine}-{platform.system().lower()}")
    if platform_here is None:
        raise errors.CodegenError(f"{platform.system()} on {machine} is no platform of an FMU; name the platforms")
    return platform_here


def compiler_for(wanted: Platform) -> tuple[compilers.Compiler, tuple[str, ...]]:
    """Compiler and flags for a platform: zig if installed, else the machine's compiler for its own platform.

    Raises:
        CompilerNotFoundError: zig is not installed and the platform is not this one, or there is no compiler.
    """
    try:
        zig = compilers.find_compiler("zig")
    except errors.CompilerNotFoundError:
        if wanted is not host_platform():
            raise errors.CompilerNotFoundError(
                f"no compiler for {wanted.name}: it needs zig; run: {errors.installing('zig')}"
            ) from None
        return compilers.find_compiler(), (*PORTABLE, f"-march={wanted.machine}")
    return replace(zig, command=(*zig.command, "-target", wanted.target)), PORTABLE


ROLES = ("input", "parameter", "output", "state", "derivative")
"""Vectors in an instance's memory, in this order."""

WRAPPERS = {2: ("core.c", "fmi2.c"), 3: ("core.c", "fmi3.c", "fmi3_lacking.c")}
"""C files around the generated functions, by version of FMI."""


def fmu_source(model: FmuModel) -> tuple[str, str]:
    """The C source of an FMU and its token, which the model description repeats."""
    functions = model.functions
    tangents = [tangent for tangent in (functions.start_tangent, functions.now_tangent) if tangent is not None]
    body = [
        *_definitions(model),
        language.c_source(
            [functions.derive, functions.rules, functions.start, functions.now, functions.step, *tangents]
        ),
        *((files("dualwinch.toolboxes.fmu") / name).read_text(encoding="utf-8") for name in WRAPPERS[model.version]),
    ]
    digest = hashlib.sha256("\n".join(body).encode()).hexdigest()
    token = f"{{{'-'.join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32]))}}}"
    what = f"{model.block.name}: {model.block.description}; functional mock-up unit, FMI {model.version}.0"
    heading = f"/* {texts.c_comment(what)} */"
    return "\n".join([heading, f'#define TOKEN "{token}"', *body]), token


def _definitions(model: FmuModel) -> list[str]:
    """Sizes as macros; names, start values and ranges of all variables; outputs with direct feedthrough."""
    counts, signals = {role: len(model.of(role)) for role in ROLES}, model.signals
    input_use = [int(row.any()) for row in model.functions.on_input[counts["derivative"] :]]
    macros: dict[str, object] = {}
    for (role, count), offset in zip(counts.items(), accumulate(counts.values(), initial=0), strict=False):
        macros |= {f"{role.upper()}S": count, f"FIRST_{role.upper()}": offset}
    macros |= {
        "DERIVED": model.functions.derive.numel_out("derived"),
        "RULES": len(model.block.ruled),
        "TIME": len(signals) - 1,
        "VARIABLES": len(signals),
        "HAS_DERIVATIVES": int(counts["derivative"] > 0),
        "HAS_HELD": int(any(input_use)),
        "SAMPLE_TIME": repr(model.block.sample_time),
        "MODEL_IDENTIFIER": model.block.name,
        "OFFERS_MODEL_EXCHANGE": int(model.flows),
        "OFFERS_CO_SIMULATION": int(model.steps),
    }
    by_name = {signal.variable.name: signal.reference for signal in model.of("parameter")}
    nominals = [_number(state.nominal) for state in model.block.continuous]
    return [
        *(f"#define {name} {value}" for name, value in macros.items()),
        _table("const char *const name", "VARIABLES", [f'"{signal.name}"' for signal in signals]),
        _table("double start_value", "VARIABLES", [_number(signal.variable.start) for signal in signals]),
        _table("double lower", "VARIABLES", [_number(_limits(signal)[0]) for signal in signals]),
        _table("double upper", "VARIABLES", [_number(_limits(signal)[1]) for signal in signals]),
        *([_table("double nominal", "DERIVATIVES", nominals)] if model.flows else []),
        *(
            [_table("int ruled", "RULES", [str(by_name[rule]) for rule in model.block.ruled])]
            if model.block.ruled
            else []
        ),
        _table("int held", "OUTPUTS", [str(each) for each in input_use]),
    ]


def _limits(signal: FmuVariable) -> tuple[float, float]:
    """Range within which a variable can be set; states are unlimited."""
    largest = sys.float_info.max
    if signal.role not in {"input", "parameter"}:
        return -largest, largest
    lower = max(signal.variable.lower, -largest)
    if signal.variable.exclusive:
        lower = math.nextafter(lower, largest)
    return lower, min(signal.variable.upper, largest)


def _number(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else "0.0"


def _table(what: str, size: str, entries: list[str]) -> str:
    constant = what if what.startswith("const") else f"const {what}"
    lines = [", ".join(entries[reference : reference + 6]) for reference in range(0, len(entries), 6)]
    return f"static {constant}[{size}] = {{\n  " + ",\n  ".join(lines) + "};"


EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time stamp of every file in the archive."""


def build_fmu(
    model: FmuModel, platforms: Sequence[Platform], about: About, progress: Callable[[str], None] | None = None
) -> dict[str, bytes]:
    """Generate and compile the files of an FMU; known binaries come from the cache.

    Args:
        model: the model.
        platforms: platforms of the binaries; the sources are always included.
        about: further data of the model description.
        progress: called with the name of each platform before its compilation.

    Returns:
        Path in the archive → content.

    Raises:
        CompilerNotFoundError: no compiler for a platform.
        CompileError: the compiler fails.
        CacheError: the cache folder cannot be used.
    """
    compilers = {platform: compiler_for(platform) for platform in platforms}
    source, token = fmu_source(model)
    name = model.block.name
    content = {"modelDescription.xml": model_description(model, token, about), f"sources/{name}.c": source.encode()}
    if model.version == 3:
        content["sources/buildDescription.xml"] = build_description(model)
    for target, (compiler, flags) in compilers.items():
        if progress:
            progress(target.name)
        folder = target.name if model.version == 2 else target.tuple_
        content[f"binaries/{folder}/{name}{target.suffix}"] = code_cache.library(source, compiler, flags).read_bytes()
    return content


def archive(files: Mapping[str, bytes]) -> bytes:
    """The FMU: a reproducible archive of the files."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            zipped.writestr(entry, content)
    return buffer.getvalue()
