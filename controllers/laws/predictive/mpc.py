"""Model predictive control: the force that costs least over a horizon, within its limits, for the reference to come.

The vehicle is a mass; its nominal resistance along the reference is known, a disturbance is estimated and stays. Errors
of position and speed cost, and so do changes of the force, which ropes and winches have to follow. What lies beyond the
horizon costs what the best feedback without limits would pay for it. Force and its rate stay within their limits: at
each end of a stage the force is one that can be reached by then.

After Rawlings, Mayne and Diehl, *Model Predictive Control: Theory, Computation, and Design* (2nd ed., 2017): the cost
of what lies beyond the horizon, and a disturbance model against offset.
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
    """What the observer expects, the last force, and which ends of stages it was at its limits at."""

    observer: ExtendedState
    force: Annotated[Scalar, Quantity("N", "force command of the last sample")]
    sides: Annotated[
        NDArray[np.float64], Quantity("1", "-1 or 1 where the force is at its lower or upper limit, else 0")
    ]


@dataclass(frozen=True)
class Mpc(PositionLaw):
    """The law, what it weighs, and how far it looks ahead.

    Weights are errors that one would put up with, each as bad as a force that changes by `force_rate`.
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
        Positive, Quantity("s", "least time in which the force goes from none to its limit", "assumption")
    ] = 0.1
    horizon: Annotated[
        float, at.Ge(0.01), at.Le(60), Quantity("s", "how far ahead it looks", "assumption"), Mark.SHAPES_CODE
    ] = 0.6
    stages: Annotated[
        int, at.Ge(2), at.Le(12), Quantity("1", "stages of the horizon", "assumption"), Mark.SHAPES_CODE
    ] = 6
    iterations: Annotated[
        int, at.Ge(1), at.Le(12), Quantity("1", "linear systems solved in a sample", "assumption"), Mark.SHAPES_CODE
    ] = 2

    kind: ClassVar = "mpc"
    label: ClassVar = "MPC"
    colour: ClassVar = "#999999"
    dashes: ClassVar = (0, (5, 1, 1, 1))

    @property
    def predicted(self) -> Prediction:
        """The horizon's instants."""
        return prediction(self.horizon, self.stages)

    @property
    def preview(self) -> tuple[float, ...]:
        """The ends of the stages."""
        return tuple(self.predicted.times.tolist())

    def initial_state(self) -> MpcState:
        """Nothing expected, no force."""
        return MpcState(ExtendedState(), 0.0, np.zeros(self.stages))

    def step(
        self, state: MpcState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[MpcState, ObserverOutput]:
        """One sample: correct what was expected, solve the quadratic program, move to its first stage's end."""
        T = context.sample_time
        x, v, d = corrected(state.observer, estimate, self.observer_bandwidth, T)
        forces = nominal_forces(v, estimate.d, context.nominal)
        program = self.program(state.force, (x, v, d), estimate.d, setpoint, context)
        sides = [state.sides[i] for i in range(self.stages)]
        changes, sides = least_in_box(*program, sides, self.iterations)

        # the force goes to the first stage's end along a straight line: this sample's share of the way
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
        """The quadratic program of a sample after one with a force in N.

        The motion is position in m, speed in m/s and disturbance acceleration in m/s², as observed; `d_known` is the
        acceleration in m/s² that the estimator knows.
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
