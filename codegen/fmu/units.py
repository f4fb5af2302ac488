"""Units as FMI defines them: integer powers of the SI base units."""

import re
from collections import Counter

SI: dict[str, dict[str, int]] = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "K": {"K": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Hz": {"s": -1},
    "1": {},
}
"""Units by their powers of the base units."""

FACTOR = re.compile(r"(/)?\s*(?:\(([^()]*)\)|([A-Za-z]+|1))(?:\^(-?\d+))?(?=[\s/]|$)\s*")
"""One factor of a product: after a slash or not, a group or a unit, and its power."""


def base_powers(unit: str) -> dict[str, int] | None:
    """Powers of the SI base units, e.g. ``N m/rad`` → kg 1, m 2, s −2, rad −1.

    A slash divides by the one factor after it, which may be a product in parentheses.

    Returns:
        None where the unit is no integer power of them (``m^(1/2)/s``) or not known.
    """
    powers: Counter[str] = Counter()
    position = 0
    while position < len(unit):
        factor = FACTOR.match(unit, position)
        if factor is None:
            return None
        slash, group, name, power = factor.groups()
        part = base_powers(group) if group is not None else SI.get(name)
        if part is None:
            return None
        times = int(power or 1) * (-1 if slash else 1)
        for base, count in part.items():
            powers[base] += times * count
        position = factor.end()
    return {base: count for base, count in powers.items() if count}
