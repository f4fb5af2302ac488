"""Plausibility of a described machine: values in a wrong unit, by similarity to other machines.

1. `SIMILARITIES` are products of powers of values that are about equal on machines of any size: ratios of lengths, of
   forces and of inertias, strains, densities.
2. Of each, the logarithm of its distance from the range of two machines is computed: the paper's, and that of the
   ensemble `site`, which has ropes with mass and gearboxes.
3. Each value has a factor by which it would have to be divided for its similarities: the median of the factors of all
   its similarities, of two the one nearer to 1. An unusual machine is off in one of them, a wrong unit in all.
4. Matching pursuit: the value whose factor explains most of all distances is corrected, and the next one is looked for
   (Mallat and Zhang, IEEE Trans. Signal Processing 41 (1993) 3397).
5. A factor counts where it is nearer to a prefix of the SI, 1000 or its inverse, than to 1.
"""

import math
from collections.abc import Collection, Mapping
from functools import cache
from statistics import median_high, median_low

from dualwinch.analysis.margins import comparable
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.experiment_file import CHECKED
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment

HALF_A_PREFIX = math.log(1000) / 2
"""Logarithm of the factor midway between 1 and a prefix of the SI."""

OF_THE_VEHICLE: dict[str, dict[str, float]] = {
    "track over vehicle": {"track.length": 1, "vehicle.diameter": -1},
    "offset over track": {"track.rope_offset": 1, "track.length": -1},
    "height over diameter": {"vehicle.height": 1, "vehicle.diameter": -1},
    "density of the vehicle": {"vehicle.mass": 1, "vehicle.diameter": -2, "vehicle.height": -1},
    "added mass over mass": {"vehicle.added_mass": 1, "vehicle.mass": -1},
    "drag area over height times diameter": {"vehicle.drag_area": 1, "vehicle.diameter": -1, "vehicle.height": -1},
    "rail load over mass": {"vehicle.normal_force": 1, "vehicle.mass": -1},
    "largest tension over mass": {"tension_max": 1, "vehicle.mass": -1},
    "preload over largest tension": {"preload": 1, "tension_max": -1},
    "least over largest tension": {"tension_min": 1, "tension_max": -1},
}
"""Similarity of vehicle, track and tensions → key and its power."""

OF_A_SIDE: dict[str, dict[str, float]] = {
    "turns of drum {i} over the track": {"track.length": 1, "winch_{i}.drum_radius": -1},
    "drum {i} over rope": {"winch_{i}.drum_radius": 1, "rope_{i}.diameter": -1},
    "area over circle of rope {i}": {"rope_{i}.area": 1, "rope_{i}.diameter": -2},
    "strain of rope {i}": {"tension_max": 1, "rope_{i}.area": -1, "rope_{i}.modulus": -1},
    "density of rope {i}": {"rope_{i}.mass_per_length": 1, "rope_{i}.diameter": -2},
    "weight over mass of rope {i}": {"rope_{i}.submerged_weight": 1, "rope_{i}.mass_per_length": -1},
    "spare rope {i} over track": {"rope_{i}.spare_length": 1, "track.length": -1},
    "damping ratio of the vehicle on rope {i}": {
        "rope_{i}.damping": 1,
        "track.length": 0.5,
        "rope_{i}.area": -0.5,
        "rope_{i}.modulus": -0.5,
        "vehicle.mass": -0.5,
    },
    "inertia of winch {i} over the vehicle's": {
        "winch_{i}.inertia": 1,
        "vehicle.mass": -1,
        "winch_{i}.drum_radius": -2,
    },
    "inertia of rotor {i} over the vehicle's": {
        "winch_{i}.rotor_inertia": 1,
        "winch_{i}.gear_ratio": 2,
        "vehicle.mass": -1,
        "winch_{i}.drum_radius": -2,
    },
    "friction of winch {i} over largest tension": {
        "winch_{i}.coulomb_friction": 1,
        "tension_max": -1,
        "winch_{i}.drum_radius": -1,
    },
    "stiffness of gearbox {i} over rope": {
        "winch_{i}.gear_stiffness": 1,
        "winch_{i}.drum_radius": -2,
        "track.length": 1,
        "rope_{i}.area": -1,
        "rope_{i}.modulus": -1,
    },
}
"""The same for rope and winch of each side."""


def _key(name: str) -> str:
    return f"plant.{name}" if "." in name else f"controller.coordination.{name}"


SIMILARITIES: dict[str, dict[str, float]] = {
    words.format(i=side): {_key(name.format(i=side)): power for name, power in powers.items()}
    for group, sides in ((OF_THE_VEHICLE, (0,)), (OF_A_SIDE, (1, 2)))
    for side in sides
    for words, powers in group.items()
}
"""Similarity → key and its power."""


def unlikely_units(experiment: Experiment, own: Collection[str] = (), checked: Collection[str] = ()) -> list[str]:
    """Remarks on values of a machine that are likely in another unit than the SI's, such as mm, t or GPa.

    Args:
        experiment: with the machine.
        own: keys that its user has given; only these may be wrong. Default: any.
        checked: keys whose values the user has confirmed.

    Example:
        >>> import dualwinch as dw
        >>> from dualwinch.analysis.plausibility import unlikely_units
        >>> unlikely_units(dw.override(dw.case(4), {"plant.rope_1.modulus": 80.0}))[0].partition(":")[0]
        'plant.rope_1.modulus = 80 Pa is 1e-09 times what the rest of the machine suggests'
    """
    values, described = leaves(experiment), describe_parts(experiment)
    keys = dict.fromkeys(key for powers in SIMILARITIES.values() for key in powers)
    factors = _factors(values, [key for key in keys if key in values and (not own or key in own)])
    remarks = []
    for key, factor in factors.items():
        if key not in checked:
            times = float(f"{factor:.1g}")
            remarks.append(
                f"{key} = {values[key]:g} {described[key].quantity.unit} is {times:g} times what the rest of the "
                f"machine suggests: check its unit; if it is right, write # {CHECKED} behind it"
            )
    return remarks


def _similarity(name: str, values: Mapping[str, float]) -> float:
    """Logarithm of a similarity of a machine; NaN where one of its values is zero or absent."""
    numbers = [(values.get(key, 0.0), power) for key, power in SIMILARITIES[name].items()]
    return math.nan if min(numbers)[0] <= 0 else sum(power * math.log(number) for number, power in numbers)


@cache
def _usual_ranges() -> dict[str, tuple[float, float]]:
    """Similarity → least and largest logarithm of two machines."""
    machines = [leaves(each) for each in (Experiment(), load_ensemble("site").experiment)]
    ranges = {}
    for name in SIMILARITIES:
        logarithms = [_similarity(name, values) for values in machines]
        if defined := [logarithm for logarithm in logarithms if math.isfinite(logarithm)]:
            ranges[name] = min(defined), max(defined)
    return ranges


def _distances(names: Collection[str], values: Mapping[str, float]) -> dict[str, float]:
    """Similarity → logarithm of its ratio to the nearer end of the usual range; 0 within it."""
    distances = {}
    for name in names:
        low, high = _usual_ranges()[name]
        logarithm = _similarity(name, values)
        distances[name] = logarithm - min(max(logarithm, low), high)
    return distances


def _factors(values: dict[str, float], suspects: Collection[str]) -> dict[str, float]:
    """Key → factor by which its value is likely wrong, by matching pursuit."""
    names = [name for name in _usual_ranges() if math.isfinite(_similarity(name, values))]
    factors = dict[str, float]()
    while True:
        best, explained = "", 0.0
        distances, trials = _distances(names, values), dict[str, float]()
        for key in suspects:
            of_key = [name for name in names if key in SIMILARITIES[name]]
            factor = _nearer_median([distances[name] / SIMILARITIES[name][key] for name in of_key])
            if key in factors or abs(factor) < HALF_A_PREFIX:
                continue
            trials[key] = values[key] * math.exp(-factor)
            corrected = _distances(of_key, values | {key: trials[key]})
            share = sum(abs(distances[name]) - abs(corrected[name]) for name in of_key)
            if comparable(share) > comparable(explained):
                best, explained = key, share
        if not best:
            return factors
        factors[best], values = values[best] / trials[best], values | {best: trials[best]}


def _nearer_median(numbers: list[float]) -> float:
    """Median, of an even count the middle number nearer to 0; 0 for middle numbers of both signs, and for none."""
    low, high = (median_low(numbers), median_high(numbers)) if numbers else (0.0, 0.0)
    return 0.0 if low * high <= 0 else min(low, high, key=abs)
