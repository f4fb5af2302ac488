"""What holds in every run, whatever the gains, the plant and the sea."""

from dataclasses import replace
from itertools import cycle, product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.laws.nftsm import NftsmGains
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Coordination, PositionLaw
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Leaf
from dualwinch.model.quantities.tree import Group, numbers, with_leaves
from dualwinch.model.ropes import Rope
from dualwinch.model.vehicle import Vehicle
from dualwinch.model.winch import Winch
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.paper import case
from dualwinch.simulation.sensors import Sensors
from dualwinch.simulation.simulate import simulate
from tests.tiers import examples, in_full, mostly_slow
from tests.tolerances import close

SHORT = Simulation(duration=0.3)
MANY = in_full()
IN_TURN = list(zip(POSITION_LAWS.values(), cycle(COORDINATIONS.values()), strict=False))
LAWS_AND_COORDINATIONS = list(product(POSITION_LAWS.values(), COORDINATIONS.values())) if MANY else IN_TURN
"""With few examples coordinations come in turn, for each pair has compiled code of its own."""


def factor(value: float) -> st.SearchStrategy[float]:
    return st.floats(0.3, 3).map(lambda share: share * value)


def but_zero(value: float) -> float:
    """The smallest number in zero's place: each set of zeros has compiled code of its own."""
    return value or 5e-324


def up_to(largest: float) -> st.SearchStrategy[float]:
    return st.floats(0, largest).map(but_zero)


plants = st.builds(
    Plant,
    vehicle=st.builds(Vehicle, mass=factor(1e4), drag_coefficient=factor(0.3), friction_coefficient=factor(0.1)),
    rope_1=st.builds(Rope, damping=factor(1000.0)),
    rope_2=st.builds(Rope, modulus=factor(80e9)),
    winch_1=st.builds(Winch, inertia=factor(1.8), coulomb_friction=up_to(30)),
    winch_2=st.builds(Winch, drum_radius=st.floats(0.5, 1.2)),
)
gains = {
    "nftsm": st.builds(NftsmGains, beta=factor(0.05), eta=factor(0.5), k=factor(1.0)),
    "winch_1": st.builds(WinchGains, kp=factor(5e-4), ki=factor(2e-2)),
}


def with_gains(part: type[Any]) -> st.SearchStrategy[Any]:
    """The part with what it has of `gains`."""
    return st.builds(part, **{name: gains[name] for name in gains if hasattr(part(), name)})


limits = st.builds(
    Limits,
    preload=st.floats(850, 6000),
    tension_min=st.floats(50, 400),
    tension_max=st.floats(3100, 8000),
)
controllers = st.one_of(
    [
        st.builds(Controller, law=with_gains(law), limits=limits, coordination=with_gains(coordination))
        for law, coordination in LAWS_AND_COORDINATIONS
    ]
)
seas = st.builds(Disturbance, vortex=st.sampled_from([False, True] if MANY else [True]), current_sigma=up_to(0.1))
experiments = st.builds(
    Experiment,
    plant=plants,
    controller=controllers,
    reference=st.sampled_from([case(1).reference, case(2).reference]),
    disturbance=seas,
    sensors=st.builds(Sensors, speed_noise=up_to(1e-3), tension_noise=up_to(20)),
    simulation=st.builds(Simulation, duration=st.just(SHORT.duration), seed=st.integers(0, 99)),
)


@examples(60)
@given(experiments)
def test_limits_hold_in_every_sample(experiment: Experiment) -> None:
    result, limits = simulate(experiment), experiment.controller.limits
    force_limit = limits.tension_max - limits.tension_min
    assert result["F1"].min() >= 0
    assert result["F2"].min() >= 0
    assert np.abs(result["u_sat"]).max() <= force_limit
    for command in (result["F1_cmd"], result["F2_cmd"]):
        assert command.min() >= limits.tension_min
        assert command.max() <= limits.tension_max
    assert close(result["F1_cmd"] - result["F2_cmd"], result["u_sat"], abs=1e-9 * limits.tension_max)
    for torque, winch in ((result["tau_1"], experiment.plant.winch_1), (result["tau_2"], experiment.plant.winch_2)):
        lever = winch.drum_radius / winch.gear_ratio
        assert torque.min() >= lever * limits.tension_min * (1 - 1e-12)
        assert torque.max() <= lever * limits.tension_max * (1 + 1e-12)


ODD = {
    "nftsm.p": st.integers(2, 10**6).map(lambda half: 2 * half + 1),
    "nftsm.q": st.sampled_from([1, 3]),
}


def anything(leaf: Leaf) -> st.SearchStrategy[float]:
    """Any number within a gain's bounds, from the smallest to the largest there is."""
    lower, upper = max(leaf.bounds[0], -1e308), min(leaf.bounds[1], 1e308)
    found = st.floats(lower, upper) | st.floats(max(lower, -10), min(upper, 10))
    return found.map(but_zero).filter(leaf.admits)


@st.composite
def wild(draw: st.DrawFn, part: type[Group]) -> Group:
    """A part with any gains."""
    return with_leaves(part(), {key: draw(ODD.get(key, anything(leaf))) for key, leaf in describe(part).items()})


@st.composite
def wild_controllers(draw: st.DrawFn) -> Controller:
    """Every law with every estimator; coordinations come in turn, for each threesome has compiled code of its own.

    With few examples estimators come in turn, too.
    """
    law = draw(st.integers(0, len(POSITION_LAWS) - 1))
    estimator = draw(st.integers(0, len(ESTIMATORS) - 1)) if MANY else law % len(ESTIMATORS)
    coordination = list(COORDINATIONS.values())[(law + estimator) % len(COORDINATIONS)]
    return Controller(
        estimator=draw(wild(list(ESTIMATORS.values())[estimator])),
        law=draw(wild(list(POSITION_LAWS.values())[law])),
        coordination=draw(wild(coordination)),
    )


@examples(300)
@given(wild_controllers(), st.sampled_from([3, 4]))
def test_any_finite_gains_give_an_outcome(controller: Controller, number: int) -> None:
    experiment = replace(case(number), controller=controller, simulation=Simulation(duration=0.1))
    result = simulate(experiment)
    assert result.outcome in {"completed", "diverged", "left_track"}
    finite = np.isfinite(list(result.final_state.values())).all()
    assert finite == (result.outcome != "diverged")
    assert len(result["t"]) == round(result.end_time / 1e-3)
    assert np.isnan(result.metrics.mse) == np.isnan(result.metrics.peak_tension) == (result.outcome != "completed")


@pytest.mark.slow
@examples(60)
@given(wild_controllers(), st.sampled_from([3, 4]))
def test_any_finite_gains_give_the_same_outcome_in_both_engines(controller: Controller, number: int) -> None:
    """But where a product is within rounding of the largest float: fused with a sum it stays finite."""
    experiment = replace(case(number), controller=controller, simulation=Simulation(duration=0.05))
    ours, theirs = simulate(experiment), simulate(experiment, engine="interpreter")
    if max(map(abs, numbers(controller).values())) > 1e300:
        assert {ours.outcome, theirs.outcome} <= {"completed", "diverged", "left_track"}
        return
    assert ours.outcome == theirs.outcome
    # near 1e308 a fused product and sum stays finite where the rounded product overflows: it diverges a sample later
    apart = 1.5e-3 if ours.outcome == "diverged" else 0.0
    assert abs(ours.end_time - theirs.end_time) <= apart


def without_gains(part: type[Group]) -> Group:
    """A part whose gains are zero where they may be."""
    return with_leaves(
        part(), {key: 0.0 for key, leaf in describe(part).items() if leaf.kind is float and leaf.admits(0)}
    )


@pytest.mark.parametrize(
    ("law", "coordination"),
    mostly_slow(
        product(POSITION_LAWS.values(), COORDINATIONS.values()),
        {*IN_TURN[:4]}.__contains__,
    ),
)
def test_gains_of_zero_give_the_same_outcome_in_both_engines(
    law: type[PositionLaw], coordination: type[Coordination]
) -> None:
    """Estimators, which have few gains that may be zero, come in turn."""
    turn = list(POSITION_LAWS.values()).index(law) + list(COORDINATIONS.values()).index(coordination)
    estimator = list(ESTIMATORS.values())[turn % len(ESTIMATORS)]
    controller = Controller(without_gains(estimator), without_gains(law), coordination=without_gains(coordination))
    experiment = replace(case(4), controller=controller, simulation=SHORT)
    ours, theirs = simulate(experiment), simulate(experiment, engine="interpreter")
    assert (ours.outcome, ours.end_time) == (theirs.outcome, theirs.end_time)
    assert np.abs(ours["x"] - theirs["x"]).max() <= 1e-12
