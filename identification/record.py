"""What logs say of a machine as data that JSON holds."""

from dataclasses import asdict
from typing import Any

import numpy as np

from dualwinch.identification.found import Found
from dualwinch.identification.summary import notes


def to_record(found: Found) -> dict[str, Any]:
    """Everything that was found."""
    return {
        "logs": list(found.logs),
        "duration": found.duration,
        "settled": found.settled,
        "passes": found.passes,
        "seconds": found.seconds,
        "numbers": [
            {
                "key": unknown.key,
                "unit": unknown.unit,
                "believed": unknown.start,
                "known_beforehand": asdict(unknown.prior) if unknown.prior else None,
                "estimate": float(value),
                "deviation": float(deviation),
                "interval": list(found.interval(unknown.key)),
            }
            for unknown, value, deviation in zip(found.unknowns, found.values, found.deviations, strict=True)
        ],
        "correlation": found.correlation.tolist(),
        "cannot_tell": [
            {"keys": list(each.keys), "deviation": each.deviation if np.isfinite(each.deviation) else None}
            for each in found.blind
        ],
        "noise": found.noise,
        "unrecorded": {name: asdict(each) for name, each in found.scatter.items()},
        "left": [asdict(test) | {"white": test.white} for test in found.tests],
        "held_out": [asdict(test) | {"white": test.white} for test in found.held_out],
        "optima": [asdict(each) for each in found.optima],
        "profiles": [
            {
                "key": each.key,
                "values": each.values.tolist(),
                "rise": each.rise.tolist(),
                "interval": [end if np.isfinite(end) else None for end in each.interval],
            }
            for each in found.profiles
        ],
        "notes": notes(found),
    }
