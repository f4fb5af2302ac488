"""The sliding-mode law with its observer; the laws themselves are tested each on its own."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.fando_nftsm import FandoNftsm, FandoNftsmOutput, FandoNftsmState
from dualwinch.controllers.laws.nftsm import Nftsm, NftsmState
from dualwinch.controllers.laws.observer import ObserverGains, ObserverState
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.vehicle import Vehicle

T, STILL = 1e-3, Setpoint(0.0, 0.0, 0.0)
SMOOTH = Context(Plant(vehicle=Vehicle(drag_coefficient=0.0, friction_coefficient=0.0)), Limits(), T)


def estimated(x: float, v: float) -> Estimate:
    return Estimate(x, v, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0)


def step(state: FandoNftsmState, x: float, v: float) -> tuple[FandoNftsmState, FandoNftsmOutput]:
    return FandoNftsm().step(state, estimated(x, v), STILL, SMOOTH)


@given(st.floats(-0.3, 0.3), st.floats(-0.5, 0.5), st.floats(-100, 100))
def test_an_observer_that_learns_nothing_leaves_the_law_without_one(x: float, v: float, Z_a: float) -> None:
    blind = FandoNftsm(observer=ObserverGains(l0=0.0, kf=0.0))
    state, ours = blind.step(FandoNftsmState(NftsmState(Z_a)), estimated(x, v), STILL, SMOOTH)
    after, theirs = Nftsm().step(NftsmState(Z_a), estimated(x, v), STILL, SMOOTH)
    assert (ours.u, ours.u_sat, ours.s, ours.Z_a) == (theirs.u, theirs.u_sat, theirs.s, theirs.Z_a)
    assert state.nftsm == after


@given(st.floats(-0.2, 0.2))
def test_the_estimate_is_taken_off_as_mass_times_its_acceleration(d_hat: float) -> None:
    """One that is confirmed: the speed changed over the last sample by what it says."""
    known = FandoNftsmState(observer=ObserverState(d_hat=d_hat, e2_previous=0.1 - T * d_hat, primed=1.0))
    none = FandoNftsmState(observer=ObserverState(e2_previous=0.1, primed=1.0))
    (_, ours), (_, theirs) = step(known, 0.01, 0.1), step(none, 0.01, 0.1)
    assert ours.d_hat == pytest.approx(d_hat, abs=1e-12)
    assert theirs.u - ours.u == pytest.approx(1e4 * d_hat, abs=1e-6)


def test_the_observer_is_told_of_the_saturated_force() -> None:
    state, output = step(FandoNftsmState(), -50.0, 0.0)
    assert (output.u_sat, output.u > 5800) == (5800, True)
    assert state.observer.a_previous == pytest.approx(0.58)
    assert state.nftsm.Z_a == pytest.approx(T * (output.u - 5800))


@given(st.floats(-0.2, 0.2))
def test_a_disturbance_that_the_estimator_knows_is_not_learnt_again(d: float) -> None:
    """The vehicle is expected to follow the command and that disturbance."""
    known = Estimate(0.001, 0.0, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0, d)
    state, output = FandoNftsm().step(FandoNftsmState(), known, STILL, SMOOTH)
    assert state.observer.a_previous == pytest.approx(output.u_sat / 1e4 + d, abs=1e-12)
