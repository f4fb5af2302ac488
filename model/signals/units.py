"""Units that columns of numbers may come in, and the SI unit that each is converted to."""

import math

from dualwinch.model.errors import ConfigurationError

UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1 / 3.6, "kn": 1852 / 3600},
    "m/s^2": {"m/s^2": 1.0, "mm/s^2": 1e-3, "cm/s^2": 1e-2},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "MN": 1e6},
    "N m": {"N m": 1.0, "Nm": 1.0, "mN m": 1e-3, "kN m": 1e3},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "Hz": 2 * math.pi},
}
"""SI unit → units it may be given in, each with its factor."""


def factor(unit: str, si: str) -> float:
    """What a number in a unit is multiplied by to be in an SI unit.

    Raises:
        ConfigurationError: the unit is not one of that quantity; the message lists those that are.
    """
    if unit not in UNITS[si]:
        listed = ", ".join(UNITS[si])
        alike = [known for known in UNITS[si] if known.lower() == unit.lower()]
        hint = f"; did you mean '{alike[0]}'?" if alike else ""
        raise ConfigurationError(f'unit "{unit}": must be one of {listed}{hint}')
    return UNITS[si][unit]
