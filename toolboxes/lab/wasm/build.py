"""Build of modules from C source to WebAssembly, with zig."""

import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from dualwinch.toolbox import compilers, errors
from dualwinch.toolboxes.lab.wasm.settings import Settings
from dualwinch.toolboxes.lab.wasm.source import module_source

WASM_FLAGS = (
    *("--target=wasm32-wasi", "-mexec-model=reactor", "-std=c99", "-Oz"),
    *("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-ffp-contract=off"),
    *("-Wl,--strip-all", "-Wl,--export=__heap_base"),
)
"""Flags of a module without entry or imports, and with room for a page's columns behind its own memory.

The generated code is already straight and inlined: -O3 makes it a tenth larger and no faster.
"""


def wasm_compiler() -> compilers.Compiler:
    """The compiler of modules, zig.

    Raises:
        CompilerNotFoundError: zig is not installed.
    """
    try:
        return compilers.find_compiler("zig")
    except errors.CompilerNotFoundError:
        raise errors.CompilerNotFoundError(
            f"no compiler for WebAssembly: it needs zig; run: {errors.installing('zig')}"
        ) from None


def modules(settings: Iterable[Settings]) -> Iterator[bytes]:
    """Compile the WebAssembly module of each structure, in order.

    The source of the next one is generated while the compiler runs.

    Raises:
        CompilerNotFoundError: zig is not installed.
        CompileError: zig failed.
    """
    compiler = wasm_compiler()
    with ThreadPoolExecutor(max_workers=2) as pool:
        running = []
        for each in settings:
            running.append(pool.submit(_compiled, module_source(each), compiler))
            if len(running) > 1:
                yield running.pop(0).result()
        for last in running:
            yield last.result()


def _compiled(source: str, compiler: compilers.Compiler) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        module = Path(folder) / "module.wasm"
        compiler.run(source, module, WASM_FLAGS)
        return module.read_bytes()
