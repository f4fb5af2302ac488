"""Builds modules: C source to WebAssembly, kept in the cache folder."""

import subprocess
import tempfile
from pathlib import Path

from dualwinch.codegen.cache import cache_folder
from dualwinch.codegen.compiler import Compiler, find_compiler, fingerprint
from dualwinch.codegen.errors import CompileError, CompilerNotFoundError
from dualwinch.codegen.files import atomic
from dualwinch.lab.wasm.settings import Settings
from dualwinch.lab.wasm.source import module_source

FLAGS = (
    *("--target=wasm32-wasi", "-mexec-model=reactor", "-std=c99", "-Oz"),
    *("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-ffp-contract=off"),
    *("-Wl,--strip-all", "-Wl,--export=__heap_base", "-Wl,-z,stack-size=262144"),
)
"""Of a module: no entry, no imports, room for a page's rows behind its own memory."""


def wasm_compiler() -> Compiler:
    """The compiler of modules.

    Raises:
        CompilerNotFoundError: zig is not installed.
    """
    try:
        return find_compiler("zig")
    except CompilerNotFoundError:
        raise CompilerNotFoundError("the lab needs zig, a compiler for WebAssembly; run: pip install ziglang") from None


def module(settings: Settings) -> bytes:
    """The WebAssembly module of a structure, from the cache folder or newly built.

    Raises:
        CompilerNotFoundError: zig is not installed.
        CompileError: it failed.
        CacheError: the cache folder cannot be used.
    """
    source, compiler = module_source(settings), wasm_compiler()
    file = cache_folder() / f"{fingerprint(source, compiler.version, *FLAGS)}.wasm"
    if not file.exists():
        built = _compiled(source, compiler)
        with atomic(file) as unfinished:
            unfinished.write_bytes(built)
    return file.read_bytes()


def _compiled(source: str, compiler: Compiler) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "module.c").write_text(source)
        command = [*compiler.command, *FLAGS, "module.c", "-o", "module.wasm", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            complaint = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
            raise CompileError(f"{' '.join(compiler.command)} failed with exit code {done.returncode}: {complaint}")
        return (Path(folder) / "module.wasm").read_bytes()
