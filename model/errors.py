"""Errors of what a user asks for."""

from dualwinch.codegen.errors import DualwinchError, installing


class ConfigurationError(DualwinchError):
    """A value, or a combination of values, that makes no experiment; the message names the key and what is allowed."""


class MissingExtraError(DualwinchError):
    """An optional library is not installed; its arguments are the library and the extra that brings it."""

    def __str__(self) -> str:
        library, extra = self.args
        return f"{library} is not installed; install it with: {installing(extra)}"


class UnknownNameError(DualwinchError, KeyError):
    """A name that is not among those there are; the message names the nearest. A `KeyError`, but for its quotes."""

    def __str__(self) -> str:
        return str(self.args[0])
