"""Control laws, one a file: pure symbolic updates ``(state, measurement, reference, gains) -> (state, output)``."""

from dualwinch.controllers.controller import Controller, controller_function

__all__ = ["Controller", "controller_function"]
