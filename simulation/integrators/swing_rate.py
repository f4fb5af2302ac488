"""How fast ropes and their drums swing: what sub-steps must keep up with."""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from dualwinch.model.ropes import Rope, RopeLaw, Track, stiffness
from dualwinch.model.winch import Winch, base_radius


def swing_rate(rope: Rope, winch: Winch, track: Track) -> Any:
    """How fast in rad/s a Kelvin–Voigt rope and its drum swing, or settle, where the rope is shortest.

    An array where numbers of rope or winch are.
    """
    mobility = base_radius(winch) ** 2 / winch.inertia
    return np.maximum(np.sqrt(mobility * stiffness(track.rope_offset, rope)), mobility * rope.damping / 2)


@lru_cache(maxsize=1024)
def fastest_rate(rope: RopeLaw, winch: Winch, track: Track, tensions: tuple[float, ...]) -> float:
    """Largest rate in rad/s at which a rope of any law and its drum swing or settle, on the track under some tensions.

    The largest modulus of an eigenvalue of s'' = −mobility (spring s + damping s'), with the rope at its longest and at
    its shortest; NaN where the law does not reach a tension, or has no spring rate there.

    Args:
        rope: the rope.
        winch: its winch.
        track: says how long the rope is.
        tensions: in N.
    """
    mobility, fastest = base_radius(winch) ** 2 / winch.inertia, 0.0
    for length in (track.rope_offset, track.length + track.rope_offset):
        for tension in tensions:
            reached = rope.tension(rope.resting_stretch(tension, length), 0.0, length)
            spring, damping = rope.tangent(tension, length)
            if not math.isclose(reached, tension, rel_tol=1e-6) or not (
                math.isfinite(spring) and math.isfinite(damping) and spring > 0
            ):
                return math.nan
            square, decay = mobility * spring, mobility * abs(damping) / 2
            fastest = max(fastest, math.sqrt(square), decay + math.sqrt(max(decay**2 - square, 0.0)))
    return fastest
