"""The plant between two samples by SciPy's Radau solver: slow, with tight tolerances; the yardstick of collocation."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.oracle.plant import Gates, Hold, Plant, Taut, Triple

Vector = NDArray[np.float64]


class SciPySolver:
    """Advances the plant from sample to sample, restarting at each rope switch."""

    def __init__(self, plant: Plant, *, rtol: float = 1e-11) -> None:
        self.plant, self.rtol = plant, rtol

    def advance(self, t: float, duration: float, position: Triple, speed: Triple, held: Hold) -> tuple[Triple, Triple]:
        """Position and speed after `duration` with the inputs held."""
        taut = self.plant.taut(position, speed)
        now, end = np.array([*position, *speed]), t + duration
        while end - t > 1e-9 * duration:
            done = solve_ivp(
                lambda at, y, taut=taut: [*y[3:], *self._motion(at, y, held, taut)[0]],
                (t, end),
                now,
                method="Radau",
                rtol=self.rtol,
                atol=1e-13,
                events=[self._gate(rope, held, taut) for rope in (0, 1)],
            )
            t, now = done.t[-1], done.y[:, -1]
            if done.status == 1:
                switched = [len(instants) > 0 for instants in done.t_events]
                taut = (taut[0] != switched[0], taut[1] != switched[1])
        x, theta_1, theta_2, v, omega_1, omega_2 = now.tolist()
        return (x, theta_1, theta_2), (v, omega_1, omega_2)

    def _motion(self, t: float, y: Vector, held: Hold, taut: Taut) -> tuple[Triple, Gates]:
        x, theta_1, theta_2, v, omega_1, omega_2 = y.tolist()
        return self.plant.motion(t, (x, theta_1, theta_2), (v, omega_1, omega_2), held, taut)

    def _gate(self, rope: int, held: Hold, taut: Taut) -> Callable[[float, Vector], float]:
        def gate(t: float, y: Vector) -> float:
            return self._motion(t, y, held, taut)[1][rope] if self.plant.slack else 1.0

        gate.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
        gate.direction = -1.0 if taut[rope] else 1.0  # pyright: ignore[reportFunctionMemberAccess]
        return gate
