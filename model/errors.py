"""Errors caused by user input, beside those of code generation: the whole family."""

from dualwinch.codegen.errors import (
    CacheError,
    CodegenError,
    CompilerNotFoundError,
    DualwinchError,
    installing,
)

__all__ = [
    "CacheError",
    "CodegenError",
    "CompilerNotFoundError",
    "ConfigurationError",
    "DualwinchError",
    "MissingExtraError",
    "UnknownNameError",
    "installing",
]


class ConfigurationError(DualwinchError):
    """An invalid value or combination of values; the message names the key and the allowed range."""


class MissingExtraError(DualwinchError):
    """An optional library is not installed; the arguments are the library and the extra that installs it."""

    def __str__(self) -> str:
        library, extra = self.args
        return f"{library} is not installed; install it with: {installing(extra)}"


class UnknownNameError(DualwinchError, KeyError):
    """An unknown name; the message suggests the nearest one. A `KeyError` whose message is printed without quotes."""

    def __str__(self) -> str:
        return str(self.args[0])
