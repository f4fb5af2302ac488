"""Errors of what a user asks for."""

from dualwinch.codegen.errors import DualwinchError


class ConfigurationError(DualwinchError):
    """A value, or a combination of values, that makes no experiment; the message names the key and what is allowed."""


class MissingExtraError(DualwinchError):
    """An optional library is not installed; the message says how to install it."""
