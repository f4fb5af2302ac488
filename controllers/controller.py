"""The whole controller: estimator, position law, coordination of the winches (paper Section 3, Figure 4)."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal

import annotated_types as at
import casadi as ca

from dualwinch.controllers.coordinations.force_position import ForcePositionGains
from dualwinch.controllers.coordinations.master_slave import MasterSlaveGains
from dualwinch.controllers.coordinations.registry import COORDINATIONS
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.estimators.calibrating_kalman import CalibrationGains
from dualwinch.controllers.estimators.kalman import KalmanGains
from dualwinch.controllers.estimators.registry import ESTIMATORS
from dualwinch.controllers.laws.adrc import AdrcGains, AdrcState, adrc_step
from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.controllers.laws.fando_nftsm import FandoNftsmState, fando_nftsm_step
from dualwinch.controllers.laws.nftsm import NftsmGains, NftsmState, nftsm_step
from dualwinch.controllers.laws.observer import ObserverGains
from dualwinch.controllers.laws.pid_cascade import PidCascadeGains, PidCascadeState, pid_cascade_step
from dualwinch.controllers.laws.super_twisting import SuperTwistingGains, SuperTwistingState, super_twisting_step
from dualwinch.controllers.limits import Coordination
from dualwinch.controllers.nominal import Nominal
from dualwinch.controllers.signals import ControllerOutput, Measurement, PositionOutput
from dualwinch.model.plant import Plant
from dualwinch.model.quantity import Quantity, Tunable, leaves, with_leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class PositionLaw:
    """A position law: its initial state and one sample of it, ``(state, ...) -> (state, PositionOutput)``."""

    initial_state: Any
    step: Callable[..., tuple[Any, PositionOutput]]


POSITION_LAWS = {
    "fando-nftsm": PositionLaw(FandoNftsmState(), fando_nftsm_step),
    "nftsm": PositionLaw(NftsmState(), nftsm_step),
    "pid-cascade": PositionLaw(PidCascadeState(), pid_cascade_step),
    "super-twisting": PositionLaw(SuperTwistingState(), super_twisting_step),
    "adrc": PositionLaw(AdrcState(), adrc_step),
}
"""Every position law by its name; a new law is a new file and one line here."""


@dataclass(frozen=True)
class Controller:
    """Choice of the position law and all gains."""

    kind: Annotated[
        Literal["fando-nftsm", "nftsm", "pid-cascade", "super-twisting", "adrc"],
        Quantity("", "position law", "paper Table 2; the last two are ours"),
    ] = "fando-nftsm"
    estimator: Annotated[
        Literal["none", "lowpass", "kalman", "calibrating-kalman"],
        Quantity(
            "",
            "what the position law sees: sensors, filtered speed, filtered motion, the same with ropes learnt",
            "assumption",
        ),
    ] = "lowpass"
    speed_filter_time: Annotated[
        float,
        at.Ge(0),
        Quantity("s", "lowpass: time constant on the measured speed; 0: none", "assumption"),
        Tunable(0, 0.1, log=False),
    ] = 0.0
    nominal: Nominal = field(default_factory=Nominal)
    kalman: KalmanGains = field(default_factory=KalmanGains)
    calibration: CalibrationGains = field(default_factory=CalibrationGains)
    nftsm: NftsmGains = field(default_factory=NftsmGains)
    observer: ObserverGains = field(default_factory=ObserverGains)
    auxiliary: AuxiliaryGains = field(default_factory=AuxiliaryGains)
    pid_cascade: PidCascadeGains = field(default_factory=PidCascadeGains)
    super_twisting: SuperTwistingGains = field(default_factory=SuperTwistingGains)
    adrc: AdrcGains = field(default_factory=AdrcGains)
    coordination: Coordination = field(default_factory=Coordination)
    master_slave: MasterSlaveGains = field(default_factory=MasterSlaveGains)
    force_position: ForcePositionGains = field(default_factory=ForcePositionGains)
    winch_1: WinchGains = field(default_factory=WinchGains)
    winch_2: WinchGains = field(default_factory=WinchGains)


@dataclass(frozen=True)
class ControllerState:
    """State of the whole controller; its parts are those of the chosen laws."""

    position: Any
    estimator: Any
    coordination: Any


def initial_controller_state(controller: Controller) -> ControllerState:
    """State before the first sample."""
    return ControllerState(
        position=POSITION_LAWS[controller.kind].initial_state,
        estimator=ESTIMATORS[controller.estimator].initial_state,
        coordination=COORDINATIONS[controller.coordination.kind].initial_state,
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
    """One sample of the whole controller.

    Args:
        state: the controller's state.
        measurement: this sample's sensor values.
        setpoint: this sample's reference.
        controller: position law and gains.
        nominal: the plant as the controller believes it to be.
        sample_time: in s.
        shared_force: force in N that the winches share in place of the position law's u_sat: cuts the loop there.

    Returns:
        The next state and this sample's torques, commands and inner signals.
    """
    estimator, seen = ESTIMATORS[controller.estimator].step(
        state.estimator, measurement, controller, nominal, sample_time
    )
    law = POSITION_LAWS[controller.kind]
    position, output = law.step(state.position, seen, setpoint, controller, nominal, sample_time)
    force = output.u_sat if shared_force is None else shared_force
    coordination, winches = COORDINATIONS[controller.coordination.kind].step(
        state.coordination, force, seen, setpoint, controller, nominal, sample_time
    )
    said = ControllerOutput(
        position=output,
        F1_cmd=winches.F1_cmd,
        F2_cmd=winches.F2_cmd,
        tau1=winches.tau1,
        tau2=winches.tau2,
        saturated=output.u_sat != output.u,
        torque_saturated=winches.torque_saturated,
    )
    return ControllerState(position, estimator, coordination), said


def controller_function(controller: Controller, nominal: Plant) -> ca.Function:
    """The controller as a named CasADi function to call, print, differentiate or generate code from.

    Args:
        controller: the position law and the values of the gains.
        nominal: the plant as the controller believes it to be.

    Returns:
        ``fando_nftsm(state, measurement, setpoint, sample_time) -> (next_state, torques, commands)`` (named after
        the law), with the state in the order of ``leaves(initial_controller_state(controller))``, the fields of
        `Measurement` and `Setpoint`, the motor torques (2) in N m and the tension commands (2) in N.
    """
    start = initial_controller_state(controller)
    state = ca.SX.sym("state", len(leaves(start)))
    measurement, setpoint = ca.SX.sym("measurement", len(fields(Measurement))), ca.SX.sym("setpoint", 3)
    sample_time = ca.SX.sym("sample_time")
    next_state, said = controller_step(
        with_leaves(start, dict(zip(leaves(start), ca.vertsplit(state), strict=True))),
        Measurement(*ca.vertsplit(measurement)),
        Setpoint(*ca.vertsplit(setpoint)),
        controller,
        nominal,
        sample_time,
    )
    return ca.Function(
        controller.kind.replace("-", "_"),
        [state, measurement, setpoint, sample_time],
        [
            ca.vertcat(*leaves(next_state).values()),
            ca.vertcat(said.tau1, said.tau2),
            ca.vertcat(said.F1_cmd, said.F2_cmd),
        ],
        ["state", "measurement", "setpoint", "sample_time"],
        ["next_state", "torques", "commands"],
    )
