"""From a CasADi function to compiled code: C source, compiler discovery, library cache, rollout driver."""

from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.rollout import Rollout, compile_rollout, rollout_source
from dualwinch.codegen.errors import CodegenError, CompileError, CompilerNotFoundError, DualwinchError
from dualwinch.codegen.trusted_folder import cache_folder

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
