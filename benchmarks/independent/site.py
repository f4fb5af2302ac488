"""Machines as they are built: the effects that ropes without mass and Table 1's drums leave out, each with its size.

Every machine has a seed, and with it the same share of every effect whichever others are on. Sizes marked (t) are
typical values from experience; the others come from the source beside them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

Draw: TypeAlias = Callable[[np.random.Generator], Mapping[str, float]]

RATIO = 36.0
ARC_MINUTE = np.pi / 180 / 60

ROTOR, DRUM = 0.02, 120.0
"""Inertias in kg m²: of a rotor at its shaft (t); of a drum, from a shell of 10 mm × 0.4 m (101) up."""

ROPE = 2.36
"""kg/m of a 24 mm rope, 6x36 IWRC: 0.409 d² (EN 12385-4)."""

SPARE = 10.0
"""m of rope that stay on a drum (t: a few turns)."""


def both(name: str, draw: Callable[[], float]) -> dict[str, float]:
    """A draw for each side."""
    return {f"{name}_1": float(draw()), f"{name}_2": float(draw())}


def rope_mass(_: np.random.Generator) -> Mapping[str, float]:
    """Longitudinal waves in steel ropes, and the water's friction on them (0.01: t)."""
    return {"rope_mass": ROPE, "skin_friction": 0.01}


def rope_damping(rng: np.random.Generator) -> Mapping[str, float]:
    """100 to 1 000 N s/m, each octave as likely, or a loss factor of 0.02 (t); Table 1 has 1 000."""
    lossy = rng.uniform() < 0.5
    values = both("damping_factor", lambda: 10 ** rng.uniform(-1, 0))
    return {"damping_factor": 0.0, "loss_factor": 0.02} if lossy else values


def modulus(rng: np.random.Generator) -> Mapping[str, float]:
    """EA from 0.7 to 1.3 of Table 1's with the ± 10 % of the sea: constructions range from 23 to 56 MN."""
    return both("modulus_factor", lambda: rng.uniform(0.7 / 0.9, 1.3 / 1.1))


def sag(rng: np.random.Generator) -> Mapping[str, float]:
    """Rollers every 0.5 to 2 m (t), 20.2 N/m in water, 2.96 kg/m across with added water, drag 1.2; friction 0.05."""
    return {
        "submerged_weight": 20.2,
        "roller_spacing": rng.uniform(0.5, 2.0),
        "transverse_mass": 2.96,
        "transverse_drag": 1.2,
        "roller_friction": 0.05,
        "slack_below": 20.0,
    }


def winch(rng: np.random.Generator) -> Mapping[str, float]:
    """A rotor, a drum and the rope on it, ± 20 % each; Table 1's inertia counts as neither."""
    return {
        "inertia_factor": 0.0,
        **both("drum_inertia", lambda: DRUM * rng.uniform(0.8, 1.2)),
        **both("rotor_inertia", lambda: ROTOR * rng.uniform(0.8, 1.2)),
        "wound": 1.0,
        "spare_length": SPARE,
    }


def gearbox(rng: np.random.Generator) -> Mapping[str, float]:
    """Stiffness 0.5 to 3e6 N m/rad at the drum, each octave as likely; damping 2 % of critical (t)."""
    found = both("gear_stiffness", lambda: 10 ** rng.uniform(np.log10(0.5e6), np.log10(3e6)))
    inertia = 1 / (1 / (ROTOR * RATIO**2) + 1 / DRUM)
    damping = {
        name.replace("stiffness", "damping"): 2 * 0.02 * float(np.sqrt(value * inertia))
        for name, value in found.items()
    }
    return found | damping


def teeth(rng: np.random.Generator) -> Mapping[str, float]:
    """Backlash up to 3′, transmission error up to ± 0.5′ at 6 and 36 waves a turn, efficiency 0.95 to 0.98 (all t)."""
    return {
        **both("backlash", lambda: rng.uniform(0, 3) * ARC_MINUTE),
        **both("transmission_error", lambda: rng.uniform(0, 0.5) * ARC_MINUTE),
        **both("transmission_angle", lambda: rng.uniform(-np.pi, np.pi)),
        **both("gear_efficiency", lambda: rng.uniform(0.95, 0.98)),
    }


def speed_wheel(rng: np.random.Generator) -> Mapping[str, float]:
    """A wheel ± 0.2 % off (t: wear and pressure)."""
    return {"wheel_error": rng.uniform(-2e-3, 2e-3)}


def electronics(rng: np.random.Generator) -> Mapping[str, float]:
    """Load cells of 50 to 500 Hz (t); torques in steps of 0.1 % of 130 N m (CiA 402); speeds of 7e-4 rad/s."""
    return {"cell_bandwidth": 10 ** rng.uniform(np.log10(50), np.log10(500)), "torque_step": 0.13, "speed_noise": 2e-4}


def rail(rng: np.random.Generator) -> Mapping[str, float]:
    """Stribeck's ratio 1 to 1.5 with LuGre's bristles, 0.1 mm long (t); tilt ± 1 mrad, waves up to 1 mrad over 10 m."""
    return {
        "break_away": rng.uniform(1.0, 1.5),
        "stribeck_speed": 0.01,
        "bristle_stiffness": 5e6,
        "bristle_damping": 1e5,
        "rail_tilt": rng.uniform(-1e-3, 1e-3),
        "rail_wave": rng.uniform(0, 1e-3),
    }


def hysteresis(rng: np.random.Generator) -> Mapping[str, float]:
    """Dahl's force up to 14 N over 4e-6 of strain: a loss factor up to 0.03 at ± 0.2 mm and 50 m."""
    return both("dahl_force", lambda: rng.uniform(0, 14.0))


EFFECTS: Mapping[str, Draw] = {
    "rope mass": rope_mass,
    "rope damping": rope_damping,
    "modulus": modulus,
    "sag": sag,
    "winch": winch,
    "gearbox": gearbox,
    "teeth": teeth,
    "speed wheel": speed_wheel,
    "electronics": electronics,
    "rail": rail,
    "hysteresis": hysteresis,
}
"""Every effect by its name, in the order in which they are drawn."""


@dataclass(frozen=True)
class Site:
    """Effects of `EFFECTS` that are on, as settings of `Judge.run`; none named: all."""

    names: tuple[str, ...] = tuple(EFFECTS)

    def __call__(self, seed: int) -> Mapping[str, float]:
        """The effects of a machine."""
        return draw(seed, self.names)


def draw(seed: int, names: tuple[str, ...]) -> dict[str, float]:
    """Effects of the machine of a seed: those of the names, and the same whichever others there are."""
    found: dict[str, float] = {}
    for number, (name, of) in enumerate(EFFECTS.items()):
        if name in names:
            found |= of(np.random.default_rng([seed, number, 43]))
    return found
