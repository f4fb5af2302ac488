"""Errors of a run's set-up."""

from codegen.errors import DualwinchError


class ConfigurationError(DualwinchError):
    """A value, or a combination of values, that makes no experiment; the message names the key and what is allowed."""
