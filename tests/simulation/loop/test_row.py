"""Columns of a result: those of every run, and the controller's own."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import pytest

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.parts import Context, Estimate, PositionLaw, PositionOutput
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.rows import COLUMNS
from dualwinch.simulation.simulate import simulate
from tests.own_parts import Belief, StateFeedback, Watched
from tests.tiers import each_choice

OWN_OF_LAWS = {
    "fando-nftsm": {"Z_a": "N s", "s": "m", "d_hat": "m/s^2", "L1": "1/s"},
    "nftsm": {"Z_a": "N s", "s": "m"},
    "pid-cascade": {},
    "super-twisting": {"Z_a": "N s", "s": "m"},
    "adrc": {"d_hat": "m/s^2"},
    "lqi": {},
    "eid": {"d_hat": "m/s^2"},
    "rbf-sliding-mode": {"s": "m", "d_hat": "m/s^2"},
    "mpc": {"d_hat": "m/s^2"},
}
ESTIMATED = {"x_est": "m", "v_est": "m/s", "d_est": "m/s^2", "position_used": "1", "speed_used": "1"}
OWN_OF_ESTIMATORS = {
    "none": {},
    "lowpass": {},
    "kalman": ESTIMATED,
    "calibrating-kalman": ESTIMATED | {"excess_1": "1", "excess_2": "1"},
    "self-calibrating-kalman": ESTIMATED
    | {"zero_1": "m", "zero_2": "m", "scale_1": "1", "scale_2": "1", "excess_1": "1", "excess_2": "1"}
    | {"zero_1_sd": "m", "zero_2_sd": "m", "scale_1_sd": "1", "scale_2_sd": "1", "excess_1_sd": "1", "excess_2_sd": "1"}
    | {"fault_1": "1", "fault_2": "1"},
}
OWN_OF_COORDINATIONS = {
    "differential-tension": {},
    "force-position": {},
    "master-slave": {},
    "proportional-tension": {},
    "scheduled-preload": {"preload": "N"},
}


@pytest.mark.parametrize(("law", "estimator", "coordination"), each_choice(POSITION_LAWS, ESTIMATORS, COORDINATIONS))
def test_a_row_has_what_every_run_has_and_then_what_the_parts_give(law: str, estimator: str, coordination: str) -> None:
    controller = Controller(ESTIMATORS[estimator](), POSITION_LAWS[law](), coordination=COORDINATIONS[coordination]())
    loop = closed_loop(structure_of(Experiment(controller=controller)))
    assert loop.columns[: len(COLUMNS)] == tuple(COLUMNS)
    own = {name: loop.quantities[name].unit for name in loop.columns[len(COLUMNS) :]}
    parts = OWN_OF_LAWS[law], OWN_OF_ESTIMATORS[estimator], OWN_OF_COORDINATIONS[coordination]
    assert list(own.items()) == [signal for part in parts for signal in part.items()]


@dataclass(frozen=True)
class Named(PositionLaw):
    """Its one signal of its own has the name of another."""

    kind: ClassVar = "named"
    output: ClassVar[type[PositionOutput]]

    def initial_state(self) -> Belief:
        return Belief()

    def step(
        self, state: Belief, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[Belief, PositionOutput]:
        following, output = StateFeedback().step(state, estimate, setpoint, context)
        return following, self.output(output.u, output.u_sat, output.surprise)  # pyright: ignore[reportCallIssue]


@dataclass(frozen=True)
class LikeAColumn(PositionOutput):
    e: Annotated[Scalar, Quantity("m", "error as it sees it")]


@dataclass(frozen=True)
class LikeAnotherPart(PositionOutput):
    imbalance: Annotated[Scalar, Quantity("m", "of its own")]


class NamedLikeAColumn(Named):
    output = LikeAColumn


class NamedLikeAnotherPart(Named):
    output = LikeAnotherPart


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (NamedLikeAColumn(), "signal 'e': the name is taken by a column of every result"),
        (NamedLikeAnotherPart(), "signal 'imbalance': two parts of the controller give it; rename one of them"),
    ],
)
def test_a_signal_may_not_have_the_name_of_another(law: PositionLaw, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        simulate(replace(case(4), controller=Controller(law=law, coordination=Watched())))
    assert str(caught.value) == message
