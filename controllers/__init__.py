"""Control laws, one a file: pure symbolic updates ``(state, measurement, reference, gains) -> (state, output)``."""

from dualwinch.controllers.controller import POSITION_LAWS, Controller, controller_function

__all__ = ["POSITION_LAWS", "Controller", "controller_function"]
