"""From a CasADi function to compiled code: C source, compiler discovery, library cache, rollout driver."""

from codegen.cache import cache_folder
from codegen.compiler import Compiler, find_compiler
from codegen.errors import CodegenError, CompileError, CompilerNotFoundError, DualwinchError
from codegen.rollout import Rollout, compile_rollout, rollout_source

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
