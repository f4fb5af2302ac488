"""An FMU as a file: model description, sources and binaries in a zip archive."""

import io
import zipfile
from collections.abc import Callable, Mapping, Sequence

from dualwinch.codegen.block import Block
from dualwinch.codegen.cache import library
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.fmu import fmi2, fmi3
from dualwinch.codegen.fmu.description import About
from dualwinch.codegen.fmu.model import KINDS, VERSIONS, FmuModel
from dualwinch.codegen.fmu.platforms import Platform, compiler_for
from dualwinch.codegen.fmu.source import fmu_source

EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time stamp of every file in the archive."""


def fmu_model(block: Block, version: int = 2, kind: str | None = None) -> FmuModel:
    """A block seen through FMI.

    Args:
        block: what to export.
        version: of FMI, 2 or 3.
        kind: ``co-simulation``, ``model-exchange`` or ``both``; default: all the block can be.

    Raises:
        CodegenError: an unknown version or kind, or model exchange of a block that is sampled by nature.
    """
    if version not in VERSIONS:
        raise CodegenError(f"FMI version {version}: must be 2 or 3")
    kind = kind or ("both" if block.derivative is not None else "co-simulation")
    if kind not in KINDS:
        raise CodegenError(f"unknown kind of FMU '{kind}': must be {', '.join(KINDS)}")
    if kind != "co-simulation" and block.derivative is None:
        raise CodegenError(f"{block.name} has no time derivative: the kind of its FMU must be co-simulation")
    return FmuModel(block, kind, version)  # pyright: ignore[reportArgumentType]


def build_fmu(
    model: FmuModel, platforms: Sequence[Platform], about: About, progress: Callable[[str], None] | None = None
) -> dict[str, bytes]:
    """Generate and compile everything an FMU holds; binaries come from the cache where they are known.

    Args:
        model: what to export.
        platforms: what to compile for; the sources are always included.
        about: what the model description says beside the block.
        progress: called with the name of each platform before it is compiled for.

    Returns:
        Path in the archive → content.

    Raises:
        CompilerNotFoundError: no compiler for a platform.
        CompileError: the compiler fails.
        CacheError: the cache folder cannot be used.
    """
    compilers = {platform: compiler_for(platform) for platform in platforms}
    source, token = fmu_source(model)
    describe = fmi2.model_description if model.version == 2 else fmi3.model_description
    name = model.block.name
    content = {"modelDescription.xml": describe(model, token, about), f"sources/{name}.c": source.encode()}
    if model.version == 3:
        content["sources/buildDescription.xml"] = fmi3.build_description(model)
    for platform, (compiler, flags) in compilers.items():
        if progress:
            progress(platform.name)
        folder = platform.name if model.version == 2 else platform.tuple_
        content[f"binaries/{folder}/{name}{platform.suffix}"] = library(source, compiler, flags).read_bytes()
    return content


def archive(files: Mapping[str, bytes]) -> bytes:
    """The archive of some files, which is the FMU; the same files give the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            zipped.writestr(entry, content)
    return buffer.getvalue()
