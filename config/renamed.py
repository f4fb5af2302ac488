"""Keys that had another name: files and commands that say the old one are understood."""

RENAMED = {"controller.calibration.spread": "controller.calibration.deviation", "disturbance.seed": "simulation.seed"}
"""Old key → what it is called now."""


def current(key: str) -> str:
    """What a key is called now."""
    return RENAMED.get(key, key)
