"""Sliding mode with a network of radial basis functions that adapts online to the errors of the nominal model.

After Liu, *Radial Basis Function (RBF) Neural Network Control for Mechanical Systems* (Springer, 2013); its Lyapunov
argument is that of Sanner and Slotine (IEEE Trans. Neural Netw. 3 (1992) 837). On ``s = e1 + e2/lam`` the law imposes
``ds/dt = -eta s - k sat(s/phi) + (d - d_hat)/lam`` with the network's output and adaptation law::

    d_hat = sum of W_i h_i(v),   h_i(v) = exp(-(v - c_i)²/(2 width²)),   dW_i/dt = rate h_i(v) s - leakage W_i

so that ``s² + lam (sum of (W_i - W_i*)²)/rate`` decreases wherever s is large compared with the approximation error of
the ideal weights W*. The leakage is the sigma modification of Ioannou and Kokotovic (Automatica 20 (1984) 583): without
excitation, weights would drift by noise.

The basis functions depend on the speed, over which the errors of friction and drag are a fixed curve; a fast adaptation
follows time-varying disturbances. Our additions: weights are limited, and held while the force is beyond its limit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np

from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw, PositionOutput
from dualwinch.model.matrix import dot
from dualwinch.model.quantities.quantity import NonNegative, Positive, Quantity, Tunable, vector
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, exp, where

CENTRES = (-1.0, -2 / 3, -1 / 3, 0.0, 1 / 3, 2 / 3, 1.0)
"""Centres of the basis functions over `RbfSlidingMode.span`."""


@dataclass(frozen=True)
class RbfState:
    """State of the law."""

    weights: Annotated[Any, Quantity("m/s^2", "weights of the network")] = field(
        default_factory=lambda: np.zeros(len(CENTRES))
    )


@dataclass(frozen=True)
class RbfOutput(PositionOutput):
    """Output of the law."""

    s: Annotated[Scalar, Quantity("m", "sliding variable")]
    d_hat: Annotated[Scalar, Quantity("m/s^2", "disturbance acceleration by the network at this speed")]


@dataclass(frozen=True)
class RbfSlidingMode(PositionLaw):
    """The law: sliding mode, network and adaptation."""

    lam: Annotated[
        Positive, Quantity("1/s", "rate at which the error decays on the surface", "by hand"), Tunable(0.1, 20)
    ] = 4.0
    eta: Annotated[
        NonNegative, Quantity("1/s", "rate of the exponential reaching law", "by hand"), Tunable(0.01, 50)
    ] = 6.0
    k: Annotated[NonNegative, Quantity("m/s", "gain of the switching term", "by hand"), Tunable(1e-3, 1)] = 0.02
    phi: Annotated[Positive, Quantity("m", "thickness of the boundary layer", "by hand"), Tunable(1e-3, 0.5)] = 5e-3
    rate: Annotated[NonNegative, Quantity("1/s^3", "rate of the adaptation", "by hand"), Tunable(0.1, 1000)] = 150.0
    leakage: Annotated[
        NonNegative,
        Quantity("1/s", "rate at which weights decay, sigma modification", "by hand"),
        Tunable(1e-4, 1, standard=False),
    ] = 0.01
    weight_limit: Annotated[
        NonNegative, Quantity("m/s^2", "largest weight", "by hand"), Tunable(0.01, 2, standard=False)
    ] = 0.5
    span: Annotated[
        Positive,
        Quantity("m/s", "speed of the outermost centres of the basis functions", "by hand"),
        Tunable(0.5, 4, standard=False),
    ] = 2.1
    width: Annotated[
        Positive, Quantity("m/s", "width of a basis function", "by hand"), Tunable(0.2, 2, standard=False)
    ] = 0.5

    kind: ClassVar = "rbf-sliding-mode"
    label: ClassVar = "RBF sliding mode"
    colour: ClassVar = "#AA4499"
    dashes: ClassVar = (0, (6, 1.5, 1, 1.5, 1, 1.5))

    def initial_state(self) -> RbfState:
        """Zero weights."""
        return RbfState()

    def basis(self, v: Scalar) -> Sequence[Scalar]:
        """Values of the basis functions at a speed in m/s."""
        return [exp(-(((v - self.span * centre) / self.width) ** 2) / 2) for centre in CENTRES]

    def step(
        self, state: RbfState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[RbfState, RbfOutput]:
        """One sample: sliding mode with the present weights, then their adaptation."""
        weights = [state.weights[i] for i in range(len(CENTRES))]
        basis = self.basis(estimate.v)
        d_hat = dot(weights, basis)
        e1, e2 = estimate.x - setpoint.x, estimate.v - setpoint.v
        s = e1 + e2 / self.lam
        reaching = self.eta * s + self.k * clip(s / self.phi, -1.0, 1.0)
        forces = nominal_forces(estimate.v, estimate.d, context.nominal)
        u = forces.mass * (setpoint.a - self.lam * (e2 + reaching) - d_hat) + forces.resistance
        u_sat = context.limits.clipped(u)

        def adapted(weight: Scalar, value: Scalar) -> Scalar:
            weight_unbounded = weight + context.sample_time * (self.rate * value * s - self.leakage * weight)
            return where(u == u_sat, clip(weight_unbounded, -self.weight_limit, self.weight_limit), weight)

        following = [adapted(weight, value) for weight, value in zip(weights, basis, strict=True)]
        return RbfState(vector(following)), RbfOutput(u=u, u_sat=u_sat, s=s, d_hat=d_hat)
