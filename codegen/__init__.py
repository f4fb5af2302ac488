"""From a CasADi function to compiled code: C source, compiler discovery, library cache, rollout driver."""

from dualwinch.codegen.cache import cache_folder
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.rollout import Rollout, compile_rollout, rollout_source
from dualwinch.codegen.errors import CodegenError, CompileError, CompilerNotFoundError, DualwinchError

__all__ = [
    "CodegenError",
    "CompileError",
    "Compiler",
    "CompilerNotFoundError",
    "DualwinchError",
    "Rollout",
    "cache_folder",
    "compile_rollout",
    "find_compiler",
    "rollout_source",
]
