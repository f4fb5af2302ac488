"""The three position laws, the coordination and the winch controllers, sample by sample in floats."""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, floor, nan, tanh

from tests.oracle.values import Values, group

RULES = (
    (1.0, 1.0, 1.0, 1.0, 1.0),
    (0.75, 0.5, 0.5, 0.5, 0.75),
    (0.5, 0.25, 0.0, 0.25, 0.5),
    (0.75, 0.5, 0.5, 0.5, 0.75),
    (1.0, 1.0, 1.0, 1.0, 1.0),
)


def clip(value: float, lower: float, upper: float) -> float:
    return min(max(value, lower), upper)


def fuzzy(error: float, rate: float) -> float:
    """Triangular partitions with product inference interpolate the rule table bilinearly."""
    levels = [2 * clip(value, -1.0, 1.0) + 2 for value in (error, rate)]
    (row, down), (column, right) = ((min(floor(level), 3), level - min(floor(level), 3)) for level in levels)
    upper = RULES[row][column] * (1 - right) + RULES[row][column + 1] * right
    lower = RULES[row + 1][column] * (1 - right) + RULES[row + 1][column + 1] * right
    return upper * (1 - down) + lower * down


def odd_power(z: float, exponent: float, smoothing: float) -> float:
    return z * (z * z + smoothing * smoothing) ** ((exponent - 1) / 2)


@dataclass(frozen=True)
class Measured:
    """Measured position, speed and tensions, and the reference, of one sample."""

    x: float
    v: float
    F1: float
    F2: float
    x_ref: float
    v_ref: float
    a_ref: float


@dataclass
class Output:
    """What a position law says; NaN for what it has not."""

    u: float
    u_sat: float
    d_hat: float = nan
    L1: float = nan
    Z_a: float = nan
    s: float = nan


class Nominal:
    """Mass and resistance as the controller assumes them."""

    def __init__(self, values: Values) -> None:
        vehicle, nominal = group(values, "plant.vehicle."), vars(group(values, "controller.nominal."))
        self.mass = nominal.get("mass", vehicle.mass + vehicle.added_mass)
        self.friction = nominal.get("friction_coefficient", vehicle.friction_coefficient) * vehicle.normal_force
        self.friction_velocity = vehicle.friction_velocity
        self.drag = (
            nominal.get("drag_coefficient", vehicle.drag_coefficient) * vehicle.water_density * vehicle.drag_area / 2
        )

    def resistance(self, v: float) -> float:
        return self.friction * tanh(v / self.friction_velocity) + self.drag * v * abs(v)


class SlidingMode:
    """FANDO-NFTSM, and NFTSM where there is no observer."""

    def __init__(self, values: Values, *, observer: bool) -> None:
        self.nominal = Nominal(values)
        self.gains = group(values, "controller.nftsm.")
        self.auxiliary = group(values, "controller.auxiliary.")
        self.observer = group(values, "controller.observer.") if observer else None
        self.sample_time = values["simulation.sample_time"]
        limits = group(values, "controller.coordination.")
        self.limit = limits.tension_max - limits.tension_min
        self.Z_a = self.d_hat = self.filtered = 0.0
        self.last: tuple[float, float] | None = None

    def estimate(self, e2: float) -> float:
        """Update the estimate; returns the observer gain."""
        if self.observer is None:
            return nan
        Ts, gains = self.sample_time, self.observer
        d_tilde = 0.0
        if self.last is not None:
            e2_before, a_before = self.last
            d_tilde = (e2 - e2_before) / Ts - a_before - self.d_hat
        before = self.filtered
        self.filtered += Ts / (gains.filter_time + Ts) * (d_tilde - before)
        rate = (self.filtered - before) / Ts
        L1 = gains.l0 + gains.kf * fuzzy(self.filtered / gains.error_scale, rate / gains.rate_scale)
        self.d_hat += (1 - exp(-L1 * Ts)) * d_tilde
        return L1

    def step(self, measured: Measured) -> Output:
        e1, e2 = measured.x - measured.x_ref, measured.v - measured.v_ref
        L1 = self.estimate(e2)
        gains, auxiliary, mass = self.gains, self.auxiliary, self.nominal.mass
        r, Z_a = gains.p / gains.q, self.Z_a
        resistance = self.nominal.resistance(measured.v)
        s = e1 + odd_power(e2 + auxiliary.gamma * Z_a, r, gains.smoothing) / gains.beta
        u = mass * measured.a_ref + resistance
        u -= mass * gains.beta / r * odd_power(e2, 2 - r, gains.smoothing)
        width = 1.0
        if gains.linear_speed:
            width = (1 + ((e2 + auxiliary.gamma * Z_a) / gains.linear_speed) ** 2) ** ((r - 1) / 2)
        u -= mass * (gains.eta * s / width + gains.k * clip(s / (gains.phi * width), -1, 1))
        u -= auxiliary.gamma_force * Z_a + mass * self.d_hat
        u_sat = clip(u, -self.limit, self.limit)
        self.Z_a += self.sample_time * (-auxiliary.k_a * Z_a + (u - u_sat))
        self.last = (e2, (u_sat - resistance) / mass - measured.a_ref)
        return Output(u, u_sat, self.d_hat if self.observer else nan, L1, Z_a, s)


class PidCascade:
    """Position loop around a speed loop with conditional integration."""

    def __init__(self, values: Values) -> None:
        self.mass = Nominal(values).mass
        self.gains = group(values, "controller.pid_cascade.")
        self.sample_time = values["simulation.sample_time"]
        limits = group(values, "controller.coordination.")
        self.limit = limits.tension_max - limits.tension_min
        self.I1 = self.I2 = 0.0
        self.ev_before: float | None = None

    def step(self, measured: Measured) -> Output:
        gains, Ts = self.gains, self.sample_time
        e1, e2 = measured.x - measured.x_ref, measured.v - measured.v_ref

        def command(I1: float, I2: float, share: float) -> tuple[float, float, float]:
            ev = -gains.kp1 * e1 - gains.ki1 * I1 - gains.kd1 * e2 - measured.v
            I2 += share * ev
            slope = 0.0 if self.ev_before is None else (ev - self.ev_before) / Ts
            return self.mass * (gains.kp2 * ev + gains.ki2 * I2 + gains.kd2 * slope), ev, I2

        I1 = self.I1 + Ts * e1
        u, ev, I2 = command(I1, self.I2, Ts)
        if (u > self.limit and ev > 0) or (u < -self.limit and ev < 0):
            I1 = self.I1
            u, ev, I2 = command(I1, self.I2, 0.0)
        self.I1, self.I2, self.ev_before = I1, I2, ev
        return Output(u, clip(u, -self.limit, self.limit))


LAWS: dict[str, Callable[[Values], SlidingMode | PidCascade]] = {
    "fando-nftsm": lambda values: SlidingMode(values, observer=True),
    "nftsm": lambda values: SlidingMode(values, observer=False),
    "pid-cascade": PidCascade,
}


def tension_commands(u_sat: float, preload: float, lower: float, upper: float) -> tuple[float, float]:
    """Half the preload plus and minus half the force; what one rope cannot give is put on the other."""
    first, second = (preload + u_sat) / 2, (preload - u_sat) / 2
    missing_1, missing_2 = clip(first, lower, upper) - first, clip(second, lower, upper) - second
    return clip(first + missing_2, lower, upper), clip(second + missing_1, lower, upper)


class WinchPid:
    """Feedforward and PID on one rope's tension."""

    def __init__(self, values: Values, number: int) -> None:
        self.gains = group(values, f"controller.winch_{number}.")
        self.winch = group(values, f"plant.winch_{number}.")
        self.limits = group(values, "controller.coordination.")
        self.sample_time = values["simulation.sample_time"]
        self.integral = 0.0
        self.before: float | None = None

    def step(self, command: float, tension: float, alpha: float) -> float:
        lever = self.winch.drum_radius / self.winch.gear_ratio
        error = command - tension
        integral = self.integral + self.sample_time * error
        slope = 0.0 if self.before is None else (error - self.before) / self.sample_time
        torque = lever * command + self.winch.inertia / self.winch.gear_ratio * alpha
        torque += self.gains.kp * error + self.gains.ki * integral + self.gains.kd * slope
        clipped = clip(torque, lever * self.limits.tension_min, lever * self.limits.tension_max)
        if clipped == torque:
            self.integral = integral
        self.before = error
        return clipped
