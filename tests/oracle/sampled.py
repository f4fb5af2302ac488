"""The sampled closed loop: sense, control, hold the torques while the plant moves on."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import exp, floor
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tests.oracle.collocation import Collocation
from tests.oracle.laws import LAWS, Measured, WinchPid, tension_commands
from tests.oracle.plant import Hold, Law, Plant, Triple
from tests.oracle.values import DEFAULTS, Values

Column = NDArray[np.float64]

COLUMNS = (
    *("t", "x", "v", "theta_1", "omega_1", "theta_2", "omega_2", "x_ref", "v_ref", "a_ref", "e", "F1", "F2"),
    *("F1_cmd", "F2_cmd", "u", "u_sat", "d_hat", "L1", "Z_a", "s", "tau_1", "tau_2"),
)


class Solver(Protocol):
    """Moves the plant from one sample to the next."""

    def advance(
        self, t: float, duration: float, position: Triple, speed: Triple, hold: Hold
    ) -> tuple[Triple, Triple]: ...


def uniform(t: float) -> Triple:
    """Position, speed and acceleration of Cases 1 and 3."""
    return 1.5 * t, 1.5, 0.0


def profile(t: float) -> Triple:
    """Position, speed and acceleration of Cases 2 and 4; at a joint, of the piece before it."""
    if t <= 18:
        return 0.05 * t**2, 0.1 * t, 0.1
    if t <= 29:
        return 1.8 * t - 16.2, 1.8, 0.0
    if t <= 41:
        return -0.075 * t**2 + 6.15 * t - 79.275, -0.15 * t + 6.15, -0.15
    return 46.8, 0.0, 0.0


REFERENCES = {1: uniform, 2: profile, 3: uniform, 4: profile}


@dataclass(frozen=True)
class Scenario:
    """What a run is: controller, reference case, values that differ from the defaults, signals by sample.

    Signals, all optional, each (samples,): current (m/s), load (N), the noise added to x, v, F1, F2, and how late each
    sample is (s; one more than the others). A law is that
    of both ropes, in place of the Kelvin–Voigt rope's. A lag in s is that of both motors, behind the delay.
    """

    kind: str
    case: int
    changes: Mapping[str, float] = field(default_factory=dict)
    signals: Mapping[str, Column] = field(default_factory=dict)
    position_resolution: float = 0.0
    law: Law | None = None
    lag: float = 0.0

    @property
    def values(self) -> Values:
        return {**DEFAULTS, "disturbance.vortex": self.case in {3, 4}, **self.changes}


def quantise(value: float, step: float) -> float:
    return step * floor(value / step + 0.5) if step > 0 else value


def run(scenario: Scenario, samples: int, solver: Solver | None = None) -> dict[str, Column]:
    """Columns of a run, one row a sample at its beginning; stops early where the vehicle leaves the track."""
    values = scenario.values
    plant = Plant(values, scenario.law)
    solver = solver or Collocation(plant)
    law = LAWS[scenario.kind](values)
    winch_1, winch_2 = WinchPid(values, 1), WinchPid(values, 2)
    preload, lower, upper = (
        values[f"controller.coordination.{name}"] for name in ("preload", "tension_min", "tension_max")
    )
    Ts, filter_time = values["simulation.sample_time"], values["controller.speed_filter_time"]
    levers = [winch.drum_radius / winch.gear_ratio for winch in (plant.winch_1, plant.winch_2)]
    queue = deque([(levers[0] * preload / 2, levers[1] * preload / 2)] * int(values["simulation.delay_samples"]))
    motors = [lever * preload / 2 for lever in levers]
    bias, cells = (
        values["sensors.position_bias"],
        [(values[f"sensors.load_cell_error_{i}"], values[f"sensors.load_cell_zero_{i}"]) for i in (1, 2)],
    )
    position, speed = plant.at_rest(preload, -bias)
    filtered_v = 0.0
    rows: list[tuple[float, ...]] = []

    def signal(name: str, sample: int) -> float:
        return float(scenario.signals[name][sample]) if name in scenario.signals else 0.0

    for k in range(samples):
        late, next_late = signal("late", k), signal("late", k + 1)
        t, x, v = k * Ts + late, position[0], speed[0]
        F1, F2 = plant.tensions(position, speed, t)
        x_ref, v_ref, a_ref = REFERENCES[scenario.case](k * Ts)
        filtered_v += Ts / (filter_time + Ts) * (v + signal("v", k) - filtered_v)
        seen = Measured(
            x=quantise(x + bias + signal("x", k), scenario.position_resolution),
            v=filtered_v if filter_time else v + signal("v", k),
            F1=F1 + cells[0][0] * F1 + cells[0][1] + signal("F1", k),
            F2=F2 + cells[1][0] * F2 + cells[1][1] + signal("F2", k),
            x_ref=x_ref,
            v_ref=v_ref,
            a_ref=a_ref,
        )
        said = law.step(seen)
        F1_cmd, F2_cmd = tension_commands(said.u_sat, preload, lower, upper)
        tau_1 = winch_1.step(F1_cmd, seen.F1, a_ref / plant.winch_1.drum_radius)
        tau_2 = winch_2.step(F2_cmd, seen.F2, -a_ref / plant.winch_2.drum_radius)
        queue.append((tau_1, tau_2))
        rows.append(
            (
                *(
                    t,
                    x,
                    v,
                    position[1],
                    speed[1],
                    position[2],
                    speed[2],
                    x_ref,
                    v_ref,
                    a_ref,
                    x + bias - x_ref - late * (v_ref + late * a_ref / 2),
                    F1,
                    F2,
                ),
                *(F1_cmd, F2_cmd, said.u, said.u_sat, said.d_hat, said.L1, said.Z_a, said.s, tau_1, tau_2),
            )
        )
        arrived = queue.popleft()
        if scenario.lag:  # exponentials on their way to what is asked for; the plant gets their means
            gone = [asked - motor for asked, motor in zip(arrived, motors, strict=True)]
            motors = [asked - exp(-Ts / scenario.lag) * way for asked, way in zip(arrived, gone, strict=True)]
            lost = scenario.lag / Ts * (1 - exp(-Ts / scenario.lag))
            arrived = [asked - lost * way for asked, way in zip(arrived, gone, strict=True)]
        given = plant.given(arrived, position, speed, Ts + next_late - late)
        hold = Hold(*given, current=signal("current", k), load=signal("load", k))
        position, speed = solver.advance(t, Ts + next_late - late, position, speed, hold)
        if not plant.on_track(position[0]):
            break
    return dict(zip(COLUMNS, np.array(rows).T, strict=True))
