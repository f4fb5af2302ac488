"""Nonsingular fast terminal sliding-mode position control with anti-saturation (paper Sections 3.1.1, 3.1.2, 3.1.4)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import annotated_types as at

from dualwinch.controllers.laws.auxiliary import auxiliary_update
from dualwinch.controllers.limits import force_limit
from dualwinch.controllers.signals import PositionOutput, Seen
from dualwinch.model.plant import Plant
from dualwinch.model.quantity import Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, power
from dualwinch.model.vehicle import drag, friction, inertia

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller


@dataclass(frozen=True)
class NftsmGains:
    """Gains of the sliding-mode law; p and q odd, p > q."""

    beta: Annotated[
        float, at.Gt(0), Quantity("m^(p/q-1)/s^(p/q)", "weight of the position error", "paper 4.1"), Tunable(0.005, 5)
    ] = 0.05
    eta: Annotated[
        float, at.Ge(0), Quantity("1/s^2", "rate of the exponential reaching law", "paper 4.1"), Tunable(0.005, 50)
    ] = 0.05
    k: Annotated[float, at.Ge(0), Quantity("m/s^2", "gain of the switching term", "paper 4.1"), Tunable(0.01, 20)] = 0.5
    phi: Annotated[
        float, at.Gt(0), Quantity("m", "thickness of the boundary layer", "paper 4.1"), Tunable(0.005, 5)
    ] = 0.5
    p: Annotated[int, at.Ge(3), Quantity("1", "numerator of the surface's power, odd", "paper 4.1")] = 5
    q: Annotated[int, at.Ge(1), Quantity("1", "denominator of the surface's power, odd", "paper 4.1")] = 3
    smoothing: Annotated[
        float, at.Gt(0), Quantity("m/s", "speed error below which the odd power is smoothed", "A7")
    ] = 1e-5


@dataclass(frozen=True)
class NftsmState:
    """State of the law without an observer."""

    Z_a: Annotated[Scalar, Quantity("N s", "state of the anti-saturation system")] = 0.0


@dataclass(frozen=True)
class NominalForces:
    """Resistances the law compensates."""

    mass: Scalar
    resistance: Scalar


def odd_power(value: Scalar, exponent: Scalar, smoothing: Scalar) -> Scalar:
    """sign(z) |z|^a, smoothed near zero: its slope there is infinite for a < 1 and chatters when sampled (A7)."""
    return value * power(value**2 + smoothing**2, (exponent - 1) / 2)


def nominal_forces(v: Scalar, d: Scalar, nominal: Plant) -> NominalForces:
    """Mass in kg and resistance F_f + F_w in N of the nominal model at the speed v in m/s, less a known disturbance.

    `d` is its acceleration in m/s².
    """
    vehicle = nominal.vehicle
    mass = inertia(vehicle)
    return NominalForces(mass, friction(v, vehicle) + drag(v, vehicle) - mass * d)


def nftsm_control(
    Z_a: Scalar,
    d_hat: Scalar,
    measurement: Seen,
    setpoint: Setpoint,
    controller: "Controller",
    nominal: Plant,
) -> tuple[Scalar, Scalar, Scalar]:
    """Force u, its saturated value u_sat (N) and the sliding variable s (m) (paper Section 3.1.4, E7, E8).

    Args:
        Z_a: anti-saturation state in N s.
        d_hat: estimated disturbance acceleration in m/s², 0 without an observer.
        measurement: position and speed are used.
        setpoint: reference position, speed, acceleration.
        controller: gains.
        nominal: the plant as the controller believes it to be.
    """
    gains, auxiliary = controller.nftsm, controller.auxiliary
    forces = nominal_forces(measurement.v, measurement.d, nominal)
    e1, e2 = measurement.x - setpoint.x, measurement.v - setpoint.v
    ratio = gains.p / gains.q
    s = e1 + odd_power(e2 + auxiliary.gamma * Z_a, ratio, gains.smoothing) / gains.beta
    terminal = gains.beta / ratio * odd_power(e2, 2 - ratio, gains.smoothing)
    reaching = gains.eta * s + gains.k * clip(s / gains.phi, -1.0, 1.0)
    u = forces.mass * (setpoint.a - terminal - reaching - d_hat) + forces.resistance - auxiliary.gamma_force * Z_a
    limit = force_limit(controller.coordination)
    return u, clip(u, -limit, limit), s


def nftsm_step(
    state: NftsmState,
    measurement: Seen,
    setpoint: Setpoint,
    controller: "Controller",
    nominal: Plant,
    sample_time: Scalar,
) -> tuple[NftsmState, PositionOutput]:
    """One sample of the law without an observer (d_hat = 0)."""
    u, u_sat, s = nftsm_control(state.Z_a, 0.0, measurement, setpoint, controller, nominal)
    Z_a = auxiliary_update(state.Z_a, u - u_sat, controller.auxiliary, sample_time)
    return NftsmState(Z_a), PositionOutput(u=u, u_sat=u_sat, Z_a=state.Z_a, s=s)
