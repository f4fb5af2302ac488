"""Radau IIA collocation: an implicit, L-stable method of order 2 s - 1, with exact switching of the ropes.

The unknowns are the accelerations at the s nodes of a step; positions and speeds follow from them. A simplified
Newton iteration finds them with one inverse matrix that serves many steps. When a rope goes slack or taut within a
step, the instant is found by root finding and the step is split there.
"""

from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar
from scipy.special import roots_jacobi

from tests.oracle.plant import Gates, Hold, Plant, Taut, Triple

Matrix = NDArray[np.float64]


def radau_nodes(count: int) -> Matrix:
    """Nodes in (0, 1], the last one being 1."""
    inner, _ = roots_jacobi(count - 1, 1.0, 0.0)
    return np.append((1 + np.asarray(inner)) / 2, 1.0)


def collocation_matrix(nodes: Matrix) -> Matrix:
    """Integrals of the Lagrange polynomials of the nodes from 0 to each node."""
    powers = np.arange(len(nodes))
    return nodes[:, None] ** (powers + 1) / (powers + 1) @ np.linalg.inv(nodes[:, None] ** powers)


class Collocation:
    """Advances the plant from sample to sample."""

    def __init__(self, plant: Plant, *, nodes: int = 5, swing: float = 2.0) -> None:
        """Swing: largest product of step and fastest rope-drum frequency; halve it to halve the steps."""
        self.plant, self.swing = plant, swing
        self.nodes = radau_nodes(nodes)
        self.once = collocation_matrix(self.nodes)
        self.twice = self.once @ self.once
        self._inverse: tuple[float, Taut, float, Matrix] | None = None

    def advance(self, t: float, duration: float, position: Triple, speed: Triple, hold: Hold) -> tuple[Triple, Triple]:
        """Position and speed after `duration` with the inputs hold."""
        taut = self.plant.taut(position, speed, t)
        step = duration / ceil(duration * self._fastest(position[0]) / self.swing)
        end = t + duration
        while end - t > 1e-9 * duration:
            h = min(step, end - t)
            moved, pace, gates = self._step(t, h, position, speed, hold, taut)
            switch = self._first_switch(gates, taut)
            if switch is not None:
                rope, node = switch
                h = self._instant(t, h * self.nodes[node], position, speed, hold, taut, rope)
                moved, pace, _ = self._step(t, h, position, speed, hold, taut)
                taut = (not taut[0], taut[1]) if rope == 0 else (taut[0], not taut[1])
            t, position, speed = t + h, moved, pace
        return position, speed

    def _fastest(self, x: float) -> float:
        k_1, k_2 = self.plant.stiffnesses(x)
        winch_1, winch_2 = self.plant.winch_1, self.plant.winch_2
        return max(
            winch_1.drum_radius * sqrt(k_1 / winch_1.inertia),
            winch_2.drum_radius * sqrt(k_2 / winch_2.inertia),
        )

    def _step(
        self, t: float, h: float, position: Triple, speed: Triple, hold: Hold, taut: Taut
    ) -> tuple[Triple, Triple, list[Gates]]:
        motion, times = self.plant.motion, (t + h * self.nodes).tolist()
        coasting = np.array(position) + np.outer(h * self.nodes, speed)
        inverse = self._newton(h, position, speed, hold, taut)
        start, _ = motion(t, position, speed, hold, taut)
        rates = np.tile(start, (len(times), 1))
        for _ in range(50):
            places = (coasting + h * h * (self.twice @ rates)).tolist()
            paces = (speed + h * (self.once @ rates)).tolist()
            found = [motion(*node, hold, taut) for node in zip(times, places, paces, strict=True)]
            missing = np.array([rate for rate, _ in found]) - rates
            change = (inverse @ missing.ravel()).reshape(missing.shape)
            rates += change
            if np.abs(change).max() < 1e-4 + 1e-9 * np.abs(rates).max():
                break
        else:
            raise ArithmeticError("the Newton iteration does not converge")
        x, theta_1, theta_2 = (coasting[-1] + h * h * (self.twice[-1] @ rates)).tolist()
        v, omega_1, omega_2 = (speed + h * (self.once[-1] @ rates)).tolist()
        return (x, theta_1, theta_2), (v, omega_1, omega_2), [gates for _, gates in found]

    def _newton(self, h: float, position: Triple, speed: Triple, hold: Hold, taut: Taut) -> Matrix:
        """Inverse of the Newton matrix; an old one serves while the rope lengths have hardly changed."""
        x = position[0]
        if self._inverse is not None:
            old_h, old_taut, old_x, inverse = self._inverse
            near = abs(x - old_x) < 0.01 * min(self.plant.lengths(x))
            if abs(h - old_h) < 1e-6 * h and old_taut == taut and near:
                return inverse
        by_position, by_speed = self._partials(position, speed, hold, taut)
        matrix = (
            np.eye(3 * len(self.nodes)) - np.kron(h * h * self.twice, by_position) - np.kron(h * self.once, by_speed)
        )
        inverse = np.asarray(np.linalg.inv(matrix), np.float64)
        self._inverse = (h, taut, x, inverse)
        return inverse

    def _partials(self, position: Triple, speed: Triple, hold: Hold, taut: Taut) -> tuple[Matrix, Matrix]:
        """Derivatives of the accelerations by position and by speed, from central differences."""
        found: list[Matrix] = []
        for which in (0, 1):
            columns: list[Matrix] = []
            for axis in range(3):
                sides: list[Triple] = []
                for sign in (1, -1):
                    moved = [list(position), list(speed)]
                    moved[which][axis] += sign * 1e-6
                    (a, b, c), (d, e, f) = moved
                    sides.append(self.plant.motion(0.0, (a, b, c), (d, e, f), hold, taut)[0])
                columns.append((np.array(sides[0]) - np.array(sides[1])) / 2e-6)
            found.append(np.column_stack(columns))
        return found[0], found[1]

    def _first_switch(self, gates: list[Gates], taut: Taut) -> tuple[int, int] | None:
        if not self.plant.slack:
            return None
        for node, gate in enumerate(gates):
            for rope in (0, 1):
                if (gate[rope] > 0) != taut[rope]:
                    return rope, node
        return None

    def _instant(
        self, t: float, latest: float, position: Triple, speed: Triple, hold: Hold, taut: Taut, rope: int
    ) -> float:
        """How long after t the rope's gate crosses zero."""

        def gate(h: float) -> float:
            return self._step(t, h, position, speed, hold, taut)[2][-1][rope]

        shortest = 1e-9 * latest
        if (gate(shortest) > 0) != taut[rope]:
            return shortest
        return root_scalar(gate, bracket=(shortest, latest), method="brentq", xtol=1e-16).root
