"""Units accepted for numbers in files and settings, by the SI unit of their quantity."""

import difflib
import math

from dualwinch.model.errors import ConfigurationError

UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1 / 3.6, "kn": 1852 / 3600, "m/min": 1 / 60},
    "m/s^2": {"m/s^2": 1.0, "mm/s^2": 1e-3, "cm/s^2": 1e-2},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "MN": 1e6, "daN": 10.0},
    "N m": {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3, "daN m": 10.0},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "Hz": 2 * math.pi},
}
"""SI unit → accepted units, each with its factor."""

OTHER_FORMS = {
    "1/min": "rpm", "min^-1": "rpm", "U/min": "rpm", "r/min": "rpm", "rev/min": "rpm", "rev/s": "Hz", "kph": "km/h",
    "N.m": "Nm", "N-m": "Nm", "kN.m": "kNm", "kN-m": "kNm", "sec": "s", "msec": "ms", "kt": "kn", "kts": "kn",
}  # fmt: skip
"""Other spellings of units → the spelling above."""

CHARACTERS = str.maketrans(
    {"·": "", "⋅": "", "*": "", " ": "", "\u00a0": "", "µ": "u", "μ": "u", "°": "deg", "²": "^2", "⁻": "^-", "¹": "1"}
)
"""Removes product signs and spaces, and replaces characters outside ASCII."""


def _plain(unit: str) -> str:
    text = unit.strip().translate(CHARACTERS)
    return OTHER_FORMS.get(text, text)


KNOWN_UNITS = {si: {_plain(name): value for name, value in units.items()} for si, units in UNITS.items()}
"""`UNITS` with plain spellings."""


def factor(unit: str, si: str) -> float:
    """Factor from a unit to an SI unit; ``-kN`` reverses the sign.

    Raises:
        ConfigurationError: the unit is not one of that quantity; the message lists those that are.
    """
    plain = _plain(unit)
    factor_to_si = KNOWN_UNITS[si].get(plain.removeprefix("-"))
    if factor_to_si is None:
        listed = ", ".join(UNITS[si])
        spellings = [unit_name for unit_name in UNITS[si] if _plain(unit_name).lower() == plain.lower()]
        spellings = spellings or difflib.get_close_matches(unit, UNITS[si], n=1, cutoff=0.6)
        hint = f"; did you mean '{spellings[0]}'?" if spellings else ""
        raise ConfigurationError(f'unit "{unit}": must be one of {listed}{hint}')
    return -factor_to_si if plain.startswith("-") else factor_to_si


def is_unit(text: str, si: str | None = None) -> bool:
    """Whether a text is a unit of any quantity, or of the one with the SI unit `si`."""
    return any(_plain(text) in units for name, units in KNOWN_UNITS.items() if si in {None, name})


def is_same_unit(one: str, other: str) -> bool:
    """Whether two texts are spellings of one unit."""
    return any(units.get(_plain(one), 0.0) == units.get(_plain(other)) for units in KNOWN_UNITS.values())
