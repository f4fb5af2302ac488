"""Case 4 written by hand over an array library without branches: what JAX traces, and whatever has NumPy's names."""

from typing import Any, TypeAlias

from benchmarks.by_hand.control import RULES
from benchmarks.by_hand.parameters import Parameters
from benchmarks.by_hand.plant import Constants

Motion: TypeAlias = tuple[Any, Any, Any, Any, Any, Any]
"""x, v, theta_1, omega_1, theta_2, omega_2; numbers or arrays."""

LABELS = len(RULES)


class ByHand:
    """Plant, controller and mean square error over an array library.

    Args:
        xp: module with NumPy's names, such as ``jax.numpy``.
        p: parameters; arrays or traced values may stand for numbers.
        c: constants of the plant.
    """

    def __init__(self, xp: Any, p: Parameters, c: Constants) -> None:
        self.xp, self.p, self.c = xp, p, c

    def clip(self, value: Any, lower: Any, upper: Any) -> Any:
        """The value, limited to [lower, upper]."""
        return self.xp.minimum(self.xp.maximum(value, lower), upper)

    def tensions(self, motion: Motion) -> tuple[Any, Any]:
        """Tensions of both ropes in N."""
        xp, c = self.xp, self.c
        x, v, theta_1, omega_1, theta_2, omega_2 = motion
        stretch_1, stretch_2 = c.radius_1 * theta_1 - x, c.radius_2 * theta_2 + x
        length_1, length_2 = xp.maximum(c.longest_1 - x, 0.05), xp.maximum(x + c.rope_offset, 0.05)
        pull_1 = c.stiffness_1 / length_1 * stretch_1 + c.damping_1 * (c.radius_1 * omega_1 - v)
        pull_2 = c.stiffness_2 / length_2 * stretch_2 + c.damping_2 * (c.radius_2 * omega_2 + v)
        F1 = xp.where(stretch_1 > 0, xp.maximum(pull_1, 0.0), 0.0)
        return F1, xp.where(stretch_2 > 0, xp.maximum(pull_2, 0.0), 0.0)

    def derivative(self, t: Any, motion: Motion, tau_1: Any, tau_2: Any) -> Motion:
        """Time derivative of the plant's state."""
        xp, c = self.xp, self.c
        F1, F2 = self.tensions(motion)
        v = motion[1]
        drag = c.drag * v * xp.abs(v)
        slow = drag * (c.vortex * xp.sin(c.shedding * v * t) - 1) - c.friction * xp.tanh(v * c.per_friction_velocity)
        return (
            v,
            (F1 - F2 + slow) * c.per_mass,
            motion[3],
            c.drive_1 * tau_1 - c.load_1 * F1,
            motion[5],
            c.drive_2 * tau_2 - c.load_2 * F2,
        )

    def rk4(self, t: Any, start: Motion, tau_1: Any, tau_2: Any, h: float) -> Motion:
        """One step of the classical Runge–Kutta method."""

        def along(slope: Motion, step: float) -> Motion:
            return tuple(a + step * b for a, b in zip(start, slope, strict=True))  # pyright: ignore[reportReturnType]

        k1 = self.derivative(t, start, tau_1, tau_2)
        k2 = self.derivative(t + h / 2, along(k1, h / 2), tau_1, tau_2)
        k3 = self.derivative(t + h / 2, along(k2, h / 2), tau_1, tau_2)
        k4 = self.derivative(t + h, along(k3, h), tau_1, tau_2)
        slopes = zip(k1, k2, k3, k4, strict=True)
        return along(tuple(a + 2 * (b + c) + d for a, b, c, d in slopes), h / 6)  # pyright: ignore[reportArgumentType]

    def fuzzy(self, error: Any, rate: Any) -> Any:
        """Triangular labels with product inference, as a sum over all rules."""
        xp = self.xp
        a, b = 2 * (self.clip(error, -1.0, 1.0) + 1), 2 * (self.clip(rate, -1.0, 1.0) + 1)
        of_a = [xp.maximum(1 - xp.abs(a - label), 0.0) for label in range(LABELS)]
        of_b = [xp.maximum(1 - xp.abs(b - label), 0.0) for label in range(LABELS)]
        return sum(RULES[i][j] * of_a[i] * of_b[j] for i in range(LABELS) for j in range(LABELS))

    def _winch(self, command: Any, tension: Any, feed: Any, to_torque: Any, kp: Any, ki: Any, integral: Any) -> Any:
        p, error = self.p, command - tension
        following = integral + p.sample_time * error
        wanted = to_torque * command + feed + kp * error + ki * following
        torque = self.clip(wanted, to_torque * p.tension_min, to_torque * p.tension_max)
        return torque, self.xp.where(torque == wanted, following, integral)

    def control(self, first: Any, motion: Motion, reference: Any, memory: tuple) -> tuple[Any, Any, tuple]:
        """One sample of the controller: both torques in N m and the next memory (as `control.Memory`).

        Args:
            first: 1 at the first sample, else 0.
            motion: the plant's state.
            reference: position, speed, acceleration.
            memory: the controller's state.
        """
        xp, p, c = self.xp, self.p, self.c
        Z_a, d_hat, filtered, e2_previous, a_previous, integral_1, integral_2 = memory
        x, v, a_ref = motion[0], motion[1], reference[2]
        F1, F2 = self.tensions(motion)
        e1, e2 = x - reference[0], v - reference[1]
        d_tilde = (1 - first) * ((e2 - e2_previous) / p.sample_time - a_previous - d_hat)
        change = p.sample_time / (p.filter_time + p.sample_time) * (d_tilde - filtered)
        filtered = filtered + change
        L1 = p.l0 + p.kf * self.fuzzy(filtered / p.error_scale, change / p.sample_time / p.rate_scale)
        d_hat = d_hat + (1 - xp.exp(-L1 * p.sample_time)) * d_tilde

        mass = p.nominal_mass + p.nominal_added_mass
        drag = 0.5 * p.nominal_drag_coefficient * p.water_density * p.drag_area
        friction = p.nominal_friction_coefficient * p.normal_force
        resistance = friction * xp.tanh(v * c.per_friction_velocity) + drag * v * xp.abs(v)
        ratio, smooth, z = p.p / p.q, p.smoothing * p.smoothing, e2 + p.gamma * Z_a
        surface = e1 + z * (z * z + smooth) ** ((ratio - 1) / 2) / p.beta
        terminal = p.beta / ratio * e2 * (e2 * e2 + smooth) ** ((1 - ratio) / 2)
        reaching = p.eta * surface + p.k * self.clip(surface / p.phi, -1.0, 1.0)
        u = mass * (a_ref - terminal - reaching - d_hat) + resistance - p.gamma_force * Z_a
        limit = p.tension_max - p.tension_min
        u_sat = self.clip(u, -limit, limit)

        wanted_1, wanted_2 = (p.preload + u_sat) / 2, (p.preload - u_sat) / 2
        excess_1 = self.clip(wanted_1, p.tension_min, p.tension_max) - wanted_1
        excess_2 = self.clip(wanted_2, p.tension_min, p.tension_max) - wanted_2
        command_1 = self.clip(wanted_1 + excess_2, p.tension_min, p.tension_max)
        command_2 = self.clip(wanted_2 + excess_1, p.tension_min, p.tension_max)
        feed_1 = p.inertia_1 / p.gear_ratio_1 * a_ref / p.drum_radius_1
        feed_2 = -p.inertia_2 / p.gear_ratio_2 * a_ref / p.drum_radius_2
        to_1, to_2 = p.drum_radius_1 / p.gear_ratio_1, p.drum_radius_2 / p.gear_ratio_2
        tau_1, integral_1 = self._winch(command_1, F1, feed_1, to_1, p.kp_1, p.ki_1, integral_1)
        tau_2, integral_2 = self._winch(command_2, F2, feed_2, to_2, p.kp_2, p.ki_2, integral_2)
        Z_a = Z_a + p.sample_time * (-p.k_a * Z_a + (u - u_sat))
        following = (Z_a, d_hat, filtered, e2, (u_sat - resistance) / mass - a_ref, integral_1, integral_2)
        return tau_1, tau_2, following
