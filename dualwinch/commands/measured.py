"""How tables show what was measured, and what was not."""

import math


def measured(value: float, form: str = ".4g") -> str:
    """A figure of merit in a format, or a dash where there was nothing to measure."""
    return "–" if math.isnan(value) else f"{value:{form}}"
