"""The controller: estimator, position law and coordination of the winches (paper Section 3, Figure 4)."""

import math
from dataclasses import dataclass, field, fields
from typing import Annotated, Any

import casadi as ca

from dualwinch.controllers.coordinations.differential_tension import DifferentialTension
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.nominal import Nominal
from dualwinch.controllers.parts import (
    Context,
    Coordination,
    CoordinationOutput,
    Estimate,
    Estimator,
    Measurement,
    PositionLaw,
    PositionOutput,
)
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.controllers.tension_observer import TensionObserver, TensionState, commanded, observed
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import Previewed, previewed
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe, describe_parts
from dualwinch.model.quantities.part import NO_STATE, PartChoice
from dualwinch.model.quantities.quantity import Key, Mark, Quantity
from dualwinch.model.quantities.steps import started, stepped
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, present


@dataclass(frozen=True)
class Controller:
    """Three parts with their gains, in signal order, and the limits and nominal model that they share."""

    estimator: Annotated[
        Estimator,
        Quantity("", "estimator between the sensors and the position law", "assumption"),
        PartChoice("estimator", ESTIMATORS),
    ] = field(default_factory=LowPass)
    law: Annotated[PositionLaw, Quantity("", "position law", "paper Table 2"), PartChoice("kind", POSITION_LAWS)] = (
        field(default_factory=FandoNftsm)
    )
    limits: Annotated[Limits, Key("coordination")] = field(default_factory=Limits)
    coordination: Annotated[
        Coordination,
        Quantity("", "how the winches share the force; the paper argues for differential tension", "paper 1.1"),
        PartChoice("coordination.kind", COORDINATIONS),
    ] = field(default_factory=DifferentialTension)
    nominal: Nominal = field(default_factory=Nominal)
    tension_observer: TensionObserver = field(default_factory=TensionObserver)

    @property
    def silent(self) -> frozenset[str]:
        """Names of measurements that may be missing: those of the estimator, and tensions where they are estimated."""
        tensions = frozenset({"F1", "F2"} if present(self.tension_observer.bandwidth) else ())
        return self.estimator.silent | tensions

    @property
    def preview(self) -> tuple[float, ...]:
        """Times in s ahead, ascending, at which a part requests the setpoint.

        Raises:
            ConfigurationError: a requested time is invalid.
        """
        times: set[float] = set()
        for part in (self.estimator, self.law, self.coordination):
            for time in part.preview:
                if not (isinstance(time, int | float) and 0 < time < math.inf):
                    raise ConfigurationError(f"{part.kind}: its preview gives {time}: must be times > 0 s")
            times |= set(part.preview)
        return tuple(sorted(times))


@dataclass(frozen=True)
class ControllerOutput:
    """Outputs of the parts in one sample."""

    estimate: Estimate
    position: PositionOutput
    winches: CoordinationOutput

    @property
    def saturated(self) -> Scalar:
        """1 where the force command exceeds its limit."""
        return self.position.u_sat != self.position.u


@dataclass(frozen=True)
class ControllerState:
    """States of the three parts, and of the observers of tensions."""

    estimator: Any
    law: Any
    coordination: Any
    tensions: Any = NO_STATE


def initial_controller_state(controller: Controller, x: Scalar = 0.0) -> ControllerState:
    """State before the first sample of a run that begins at x in m, which is added to states marked as positions.

    Raises:
        ConfigurationError: the initial state of a part is invalid.
    """
    state = ControllerState(
        estimator=started(controller.estimator),
        law=started(controller.law),
        coordination=started(controller.coordination),
        tensions=TensionState() if present(controller.tension_observer.bandwidth) else NO_STATE,
    )
    descriptions, values = describe_parts(state), leaves(state)
    return with_leaves(
        state, {key: x + values[key] for key, leaf in descriptions.items() if Mark.POSITION in leaf.marks}
    )


def controller_step(
    state: ControllerState,
    measurement: Measurement,
    setpoint: Setpoint,
    controller: Controller,
    nominal: Plant,
    sample_time: Scalar,
    shared_force: Scalar | None = None,
) -> tuple[ControllerState, ControllerOutput]:
    """One sample of the controller: estimator, position law, coordination; its next state and the parts' outputs.

    Without a preview the setpoint continues at constant acceleration. A `shared_force` in N takes the place of the
    position law's u_sat for the coordination, which opens the loop there. The sample time is in s.

    Raises:
        ConfigurationError: a part's step returns no valid state and output.
    """
    context = Context(nominal, controller.limits, sample_time)
    if not isinstance(setpoint, Previewed):
        setpoint = previewed(setpoint, controller.preview)
    tensions, bandwidth = state.tensions, controller.tension_observer.bandwidth
    if isinstance(tensions, TensionState):
        preload = controller.limits.preload
        tensions, measurement = observed(tensions, measurement, nominal, preload, bandwidth, sample_time)
    estimator, estimate = stepped(controller.estimator, state.estimator, Estimate, measurement, setpoint, context)
    law, position = stepped(controller.law, state.law, PositionOutput, estimate, setpoint, context)
    force = position.u_sat if shared_force is None else shared_force
    coordination, winches = stepped(
        controller.coordination, state.coordination, CoordinationOutput, force, estimate, setpoint, context
    )
    if isinstance(tensions, TensionState):
        tensions = commanded(tensions, winches)
    return ControllerState(estimator, law, coordination, tensions), ControllerOutput(estimate, position, winches)


SATURATED = "saturated"
"""Output of every controller in addition to those of its parts."""


def own_signals(output: ControllerOutput) -> dict[str, tuple[Scalar, Quantity]]:
    """Further signals of the parts, which they do not pass on to each other: name → value and quantity.

    Raises:
        ConfigurationError: two parts have signals of one name, or the name is taken.
    """
    signals: dict[str, tuple[Scalar, Quantity]] = {}
    for output_of_part, passed_on in (
        (output.position, PositionOutput),
        (output.estimate, Estimate),
        (output.winches, CoordinationOutput),
    ):
        common, descriptions = describe(passed_on), describe_parts(output_of_part)
        for name, value in leaves(output_of_part).items():
            if name in signals:
                raise ConfigurationError(f"signal '{name}': two parts of the controller give it; rename one of them")
            if name == SATURATED:
                raise ConfigurationError(f"signal '{name}': the name is taken by an output of every controller")
            if name not in common:
                signals[name] = value, descriptions[name].quantity
    return signals


def controller_function(controller: Controller, nominal: Plant) -> ca.Function:
    """The controller as a named CasADi function to call, print, differentiate or generate code from.

    Args:
        controller: its parts and the values of their gains.
        nominal: the nominal plant.

    Returns:
        ``fando_nftsm(state, measurement, setpoint, sample_time) -> (next_state, torques, commands)`` (named after
        the law), with the state in the order of ``leaves(initial_controller_state(controller))``, the fields of
        `Measurement` and `Setpoint`, the motor torques (2) in N m and the tension commands (2) in N. A controller with
        preview has a further input ``ahead``, with a setpoint (3) in a column for each time of its `preview`.

    Example:
        >>> import dualwinch as dw
        >>> step = dw.controller_function(dw.case(2).controller, dw.Plant())
        >>> step.name(), step.name_in()
        ('fando_nftsm', ['state', 'measurement', 'setpoint', 'sample_time'])
        >>> step.name_out()
        ['next_state', 'torques', 'commands']
    """
    start = initial_controller_state(controller)
    state = ca.SX.sym("state", len(leaves(start)))
    measurement, setpoint = ca.SX.sym("measurement", len(fields(Measurement))), ca.SX.sym("setpoint", 3)
    sample_time = ca.SX.sym("sample_time")
    times = controller.preview
    ahead = {"ahead": ca.SX.sym("ahead", 3, len(times))} if times else {}
    setpoints = {time: Setpoint(*ca.vertsplit(ahead["ahead"][:, index])) for index, time in enumerate(times)}
    inputs = {"state": state, "measurement": measurement, "setpoint": setpoint, "sample_time": sample_time} | ahead
    next_state, output = controller_step(
        with_leaves(start, dict(zip(leaves(start), ca.vertsplit(state), strict=True))),
        Measurement(*ca.vertsplit(measurement)),
        Previewed(*ca.vertsplit(setpoint), known=setpoints),
        controller,
        nominal,
        sample_time,
    )
    winches = output.winches
    return ca.Function(
        controller.law.table(),
        list(inputs.values()),
        [
            ca.vertcat(*leaves(next_state).values()),
            ca.vertcat(winches.tau_1, winches.tau_2),
            ca.vertcat(winches.F1_cmd, winches.F2_cmd),
        ],
        list(inputs),
        ["next_state", "torques", "commands"],
    )
