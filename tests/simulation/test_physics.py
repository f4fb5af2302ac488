"""What holds in every run, whatever the gains, the plant and the sea."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.controllers.controller import POSITION_LAWS, Controller
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.estimators.kalman import KalmanGains
from dualwinch.controllers.laws.adrc import AdrcGains
from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.controllers.laws.nftsm import NftsmGains
from dualwinch.controllers.laws.observer import ObserverGains
from dualwinch.controllers.laws.pid_cascade import PidCascadeGains
from dualwinch.controllers.laws.super_twisting import SuperTwistingGains
from dualwinch.controllers.limits import Coordination
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import Plant
from dualwinch.model.rope import Rope
from dualwinch.model.vehicle import Vehicle
from dualwinch.model.winch import Winch
from dualwinch.simulation.exogenous.sensors import Sensors
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.paper import CASES, CONTROLLERS, case
from dualwinch.simulation.simulate import OUTCOMES, simulate

kinds = st.sampled_from(list(POSITION_LAWS))
SHORT = Simulation(duration=0.3)


def factor(value: float) -> st.SearchStrategy[float]:
    return st.floats(0.3, 3).map(lambda share: share * value)


plants = st.builds(
    Plant,
    vehicle=st.builds(Vehicle, mass=factor(1e4), drag_coefficient=factor(0.3), friction_coefficient=factor(0.1)),
    rope_1=st.builds(Rope, damping=factor(1000.0)),
    rope_2=st.builds(Rope, modulus=factor(80e9)),
    winch_1=st.builds(Winch, inertia=factor(1.8), coulomb_friction=st.floats(0, 30)),
    winch_2=st.builds(Winch, drum_radius=st.floats(0.5, 1.2)),
)
controllers = st.builds(
    Controller,
    kind=kinds,
    nftsm=st.builds(NftsmGains, beta=factor(0.05), eta=factor(0.5), k=factor(1.0)),
    coordination=st.builds(
        Coordination,
        preload=st.floats(850, 6000),
        tension_min=st.floats(50, 400),
        tension_max=st.floats(3100, 8000),
    ),
    winch_1=st.builds(WinchGains, kp=factor(5e-4), ki=factor(2e-2)),
)
seas = st.builds(Disturbance, vortex=st.booleans(), current_sigma=st.floats(0, 0.1))
experiments = st.builds(
    Experiment,
    plant=plants,
    controller=controllers,
    reference=st.sampled_from([case(1).reference, case(2).reference]),
    disturbance=seas,
    sensors=st.builds(Sensors, speed_noise=st.floats(0, 1e-3), tension_noise=st.floats(0, 20)),
    simulation=st.builds(Simulation, duration=st.just(SHORT.duration), seed=st.integers(0, 99)),
)


@settings(max_examples=60)
@given(experiments)
def test_limits_hold_in_every_sample(experiment: Experiment) -> None:
    result, limits = simulate(experiment), experiment.controller.coordination
    force_limit = limits.tension_max - limits.tension_min
    assert result["F1"].min() >= 0
    assert result["F2"].min() >= 0
    assert np.abs(result["u_sat"]).max() <= force_limit
    for command in (result["F1_cmd"], result["F2_cmd"]):
        assert command.min() >= limits.tension_min
        assert command.max() <= limits.tension_max
    assert result["F1_cmd"] - result["F2_cmd"] == pytest.approx(result["u_sat"], abs=1e-9 * limits.tension_max)
    for torque, winch in ((result["tau1"], experiment.plant.winch_1), (result["tau2"], experiment.plant.winch_2)):
        lever = winch.drum_radius / winch.gear_ratio
        assert torque.min() >= lever * limits.tension_min * (1 - 1e-12)
        assert torque.max() <= lever * limits.tension_max * (1 + 1e-12)


@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.parametrize("number", CASES)
def test_tension_is_never_negative_in_the_papers_cases(number: int, kind: str, paper_run: Any) -> None:
    result = paper_run(number, kind)
    assert min(result["F1"].min(), result["F2"].min()) >= 0


def but_zero(value: float) -> float:
    """The smallest number in zero's place: each set of zeros has compiled code of its own."""
    return value or 5e-324


any_number = (st.floats(-1e308, 1e308) | st.floats(-10, 10)).map(but_zero)
filter_times = st.floats(0, 1e308).map(but_zero)
positive = st.floats(1e-308, 1e308) | st.floats(1e-3, 10)
wild_controllers = st.builds(
    Controller,
    kind=kinds,
    estimator=st.sampled_from(["lowpass", "kalman"]),
    speed_filter_time=filter_times,
    kalman=st.builds(KalmanGains, *[positive] * 4),
    nftsm=st.builds(
        NftsmGains,
        beta=positive,
        eta=any_number,
        k=any_number,
        phi=positive,
        p=st.integers(2, 10**6).map(lambda half: 2 * half + 1),
        q=st.sampled_from([1, 3]),
        smoothing=positive,
    ),
    observer=st.builds(
        ObserverGains,
        l0=any_number,
        kf=any_number,
        error_scale=positive,
        rate_scale=positive,
        filter_time=filter_times,
    ),
    super_twisting=st.builds(SuperTwistingGains, positive, any_number, any_number, positive),
    adrc=st.builds(AdrcGains, any_number, positive),
    auxiliary=st.builds(AuxiliaryGains, gamma=any_number, gamma_force=any_number, k_a=any_number),
    pid_cascade=st.builds(PidCascadeGains, *[any_number] * 6),
    winch_1=st.builds(WinchGains, *[any_number] * 3),
    winch_2=st.builds(WinchGains, *[any_number] * 3),
)


@settings(max_examples=300)
@given(wild_controllers, st.sampled_from([3, 4]))
def test_any_finite_gains_give_an_outcome(controller: Controller, number: int) -> None:
    experiment = replace(case(number), controller=controller, simulation=Simulation(duration=0.1))
    result = simulate(experiment)
    assert result.outcome in OUTCOMES
    finite = np.isfinite(list(result.final_state.values())).all()
    assert finite == (result.outcome != "diverged")
    assert len(result["t"]) == round(result.end_time / 1e-3)
    assert np.isnan(result.metrics.mse) == np.isnan(result.metrics.peak_tension) == (result.outcome != "completed")


@settings(max_examples=60)
@given(wild_controllers, st.sampled_from([3, 4]))
def test_any_finite_gains_give_the_same_outcome_in_both_engines(controller: Controller, number: int) -> None:
    experiment = replace(case(number), controller=controller, simulation=Simulation(duration=0.05))
    ours, theirs = simulate(experiment), simulate(experiment, engine_name="interpreter")
    assert (ours.outcome, ours.end_time) == (theirs.outcome, theirs.end_time)


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_gains_of_zero_give_the_same_outcome_in_both_engines(kind: Any) -> None:
    controller = Controller(
        kind=kind,
        speed_filter_time=0.0,
        nftsm=NftsmGains(eta=0.0, k=0.0),
        observer=ObserverGains(l0=0.0, kf=0.0, filter_time=0.0),
        super_twisting=SuperTwistingGains(k1=0.0, k2=0.0),
        adrc=AdrcGains(observer_bandwidth=0.0),
        auxiliary=AuxiliaryGains(0.0, 0.0, 0.0),
        pid_cascade=PidCascadeGains(*[0.0] * 6),
        winch_1=WinchGains(*[0.0] * 3),
        winch_2=WinchGains(*[0.0] * 3),
    )
    experiment = replace(case(4), controller=controller, simulation=SHORT)
    ours, theirs = simulate(experiment), simulate(experiment, engine_name="interpreter")
    assert (ours.outcome, ours.end_time) == (theirs.outcome, theirs.end_time)
    assert np.abs(ours["x"] - theirs["x"]).max() <= 1e-12
