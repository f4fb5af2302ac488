"""Errors of a run's set-up (see `model.errors`)."""

from model.errors import ConfigurationError

__all__ = ["ConfigurationError"]
