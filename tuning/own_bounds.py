"""The bounds that stand beside a gain (`model.quantities.quantity.Tunable`), on a given machine."""

import math
import re
from collections.abc import Mapping, Sequence

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Tunable, nearest
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment


def own_bounds(keys: Sequence[str], tunable: Tunable, experiment: Experiment) -> tuple[float, float]:
    """Lower and upper bound of a gain: in proportion to what they follow, and wide enough for the gain's own value.

    Args:
        keys: of the gain; several where gains alike are tuned as one.
        tunable: its bounds where what they follow has its default value.
        experiment: the machine, and the gain's own value.

    Raises:
        ConfigurationError: the bounds follow what is no number of the experiment, or has no default.
    """
    values, known = leaves(experiment), describe_parts(experiment)
    lower, upper = (
        bound * _scale(keys[0], followed, values, known)
        for bound, followed in zip((tunable.lower, tunable.upper), tunable.followed, strict=True)
    )
    least, most = known[keys[0]].bounds
    own = math.fsum(values[key] for key in keys) / len(keys)
    holding = min(lower, own) if own > 0 or not tunable.log else lower
    return max(holding, least), min(max(upper, own), most)


def _scale(gain: str, followed: str, values: Mapping[str, float], known: Mapping[str, Leaf]) -> float:
    """How many times its default a product of values is."""
    table = gain.rpartition(".")[0]
    scale = 1.0
    for sign, name in re.findall(r"([*/]?)([^*/]+)", followed.format(table=table.rpartition(".")[2])):
        if name == "1":
            continue
        key = name if "." in name else f"{table}.{name}"
        default = known[key].default if key in known and known[key].is_number else None
        if not default:
            numbers = [key for key, leaf in known.items() if leaf.is_number and leaf.default]
            raise ConfigurationError(
                f"space: {gain}: its bounds follow '{key}', which is no number with a default; "
                f"did you mean '{nearest(key, numbers)}'?"
            )
        share = values[key] / default
        scale = scale / share if sign == "/" else scale * share
    return scale
