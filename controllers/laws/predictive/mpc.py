"""Model predictive control: the force that minimises a cost over a horizon, within limits, for the future reference.

The model is a mass with the nominal resistance along the reference and a constant disturbance, estimated by an
observer. The cost weights errors of position and speed, and changes of the force, which ropes and winches have to
follow. The terminal cost is that of the optimal unconstrained feedback. Force and its rate are limited: at the end of
each stage the force is one that can be reached by then.

After Rawlings, Mayne and Diehl, *Model Predictive Control: Theory, Computation, and Design* (2nd ed., 2017): terminal
cost, and a disturbance model for offset-free control.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.laws.extended_state_observer import ExtendedState, ObserverOutput, corrected, expected
from dualwinch.controllers.laws.predictive.box import least_in_box
from dualwinch.controllers.laws.predictive.program import (
    Prediction,
    Program,
    VehicleMotion,
    Weights,
    cost_of_changes,
    prediction,
    room,
    slope_of_cost,
)
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw
from dualwinch.model.quantities.quantity import Mark, Positive, Quantity, Tunable, vector
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, minimum


@dataclass(frozen=True)
class MpcState:
    """State of the observer, the last force, and the active set of the last sample."""

    observer: ExtendedState
    force: Annotated[Scalar, Quantity("N", "force command of the last sample")]
    sides: Annotated[
        NDArray[np.float64], Quantity("1", "-1 or 1 where the force is at its lower or upper limit, else 0")
    ]


@dataclass(frozen=True)
class Mpc(PositionLaw):
    """The law, its weights and its horizon.

    Weights are acceptable errors: each costs as much as a change of the force at `force_rate`.
    """

    position: Annotated[Positive, Quantity("m", "position error, weight 1", "by hand"), Tunable(1e-5, 1e-2)] = 5e-4
    speed: Annotated[Positive, Quantity("m/s", "speed error, weight 1", "by hand"), Tunable(1e-4, 1)] = 1e-2
    force_rate: Annotated[
        Positive, Quantity("N/s", "rate of the force, weight 1", "by hand"), Tunable(2e3, 2e5, standard=False)
    ] = 2e4
    observer_bandwidth: Annotated[Positive, Quantity("rad/s", "poles of the observer", "by hand"), Tunable(1, 200)] = (
        20.0
    )
    rise_time: Annotated[
        Positive, Quantity("s", "least rise time of the force from zero to its limit", "assumption")
    ] = 0.1
    horizon: Annotated[
        float, at.Ge(0.01), at.Le(60), Quantity("s", "length of the horizon", "assumption"), Mark.SHAPES_CODE
    ] = 0.6
    stages: Annotated[
        int, at.Ge(2), at.Le(12), Quantity("1", "stages of the horizon", "assumption"), Mark.SHAPES_CODE
    ] = 6
    iterations: Annotated[
        int,
        at.Ge(1),
        at.Le(12),
        Quantity("1", "iterations of the quadratic program per sample", "assumption"),
        Mark.SHAPES_CODE,
    ] = 2

    kind: ClassVar = "mpc"
    label: ClassVar = "MPC"
    colour: ClassVar = "#999999"
    dashes: ClassVar = (0, (5, 1, 1, 1))

    @property
    def predicted(self) -> Prediction:
        """The prediction over the horizon."""
        return prediction(self.horizon, self.stages)

    @property
    def preview(self) -> tuple[float, ...]:
        """The ends of the stages."""
        return tuple(self.predicted.times.tolist())

    def initial_state(self) -> MpcState:
        """Zero state and force."""
        return MpcState(ExtendedState(), 0.0, np.zeros(self.stages))

    def step(
        self, state: MpcState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[MpcState, ObserverOutput]:
        """One sample: correct the prediction, solve the quadratic program, move towards the end of its first stage."""
        T = context.sample_time
        x, v, d = corrected(state.observer, estimate, self.observer_bandwidth, T)
        forces = nominal_forces(v, estimate.d, context.nominal)
        program = self.program(state.force, (x, v, d), estimate.d, setpoint, context)
        sides = [state.sides[i] for i in range(self.stages)]
        changes, sides = least_in_box(*program, sides, self.iterations)

        # the force moves linearly to its value at the end of the first stage
        share = minimum(T / self.predicted.lengths[0], 1.0) * forces.mass
        u = state.force + share * clip(changes[0], program.lower[0], program.upper[0])
        u_sat = context.limits.clipped(u)

        a = (u_sat - forces.resistance) / forces.mass + d
        following = MpcState(expected(x, v, d, a, T), u_sat, vector(sides))
        return following, ObserverOutput(u=u, u_sat=u_sat, d_hat=d)

    def program(
        self,
        force: Scalar,
        motion: tuple[Scalar, Scalar, Scalar],
        d_known: Scalar,
        setpoint: Setpoint,
        context: Context,
    ) -> Program:
        """The quadratic program of a sample.

        Args:
            force: force of the last sample in N.
            motion: position in m, speed in m/s and disturbance acceleration in m/s² from the observer.
            d_known: disturbance acceleration in m/s² known to the estimator.
            setpoint: reference with preview.
            context: nominal plant and limits.
        """
        x, v, d = motion
        forces = nominal_forces(v, d_known, context.nominal)
        mass, ahead = forces.mass, [setpoint.ahead(time) for time in self.predicted.times.tolist()]
        lost = [
            (nominal_forces(point.v, d_known, context.nominal).resistance - forces.resistance) / mass for point in ahead
        ]
        jerk = self.force_rate / mass
        weights = Weights((jerk / self.position) ** 2, (jerk / self.speed) ** 2)
        now = VehicleMotion(x, v, (force - forces.resistance) / mass + d)
        limit = context.limits.force / mass
        return Program(
            cost_of_changes(self.predicted, weights),
            slope_of_cost(self.predicted, weights, now, ahead, lost),
            *room(self.predicted, force / mass, limit, limit / self.rise_time),
        )
