"""The paper's errata: what each printed form would do, beside what this project computes."""

from dataclasses import fields, replace
from math import exp, pi, sin

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from dualwinch.controllers.coordinations.differential_tension import tension_commands
from dualwinch.controllers.coordinations.winch_pid import DrumMotion, WinchGains, WinchState, winch_step
from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.controllers.laws.nftsm import Nftsm, NftsmGains
from dualwinch.controllers.laws.observer import ObserverGains, ObserverState, estimate_disturbance, remember
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate, Measurement
from dualwinch.model.disturbance import Disturbance, vortex_force
from dualwinch.model.plant import (
    DisturbanceInputs,
    Plant,
    PlantState,
    Torques,
    derivative,
    holding_torques,
    resting_state,
    tensions,
)
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Reference, setpoint
from dualwinch.model.ropes import Rope, one_sided, stiffness
from dualwinch.model.vehicle import Vehicle, drag, friction
from dualwinch.model.winch import Winch, drum_acceleration
from dualwinch.simulation.experiment import Simulation
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from tests.conftest import PaperRun

Vector = NDArray[np.float64]
PLANT = Plant()
REST = resting_state(2000.0, PLANT, 25.0)
CONTEXT = Context(PLANT, Limits(), 1e-3)


def fastest_growth(slope_of: "ca.Function", point: list[float]) -> float:
    """Largest real part of the eigenvalues of a system's linearisation, in 1/s."""
    x = ca.SX.sym("x", len(point))
    matrix = ca.Function("matrix", [x], [ca.jacobian(slope_of(x), x)])
    return float(np.linalg.eigvals(np.array(matrix(point))).real.max())


def as_function(slopes: list[ca.SX], x: ca.SX) -> ca.Function:
    return ca.Function("slopes", [x], [ca.vertcat(*slopes)])


def test_e1_retrieving_rope_2_raises_its_tension() -> None:
    """Printed, its elongation is x - R theta_2, while its winch equation counts retrieval as positive."""
    wound = replace(REST, theta_2=REST.theta_2 + 1e-4)
    assert tensions(wound, PLANT)[1] > tensions(REST, PLANT)[1]
    k = stiffness(25.5, Rope())
    printed = [k * (25.0 - 0.8 * theta) for theta in (REST.theta_2, wound.theta_2)]
    assert printed[1] < printed[0]


def test_e1_as_printed_no_equilibrium_is_stable() -> None:
    """A drum that winds in loosens its own rope and winds in further."""
    x = ca.SX.sym("x", 6)
    state, torques = PlantState(*ca.vertsplit(x)), holding_torques(2000.0, PLANT)
    ours = derivative(state, torques, DisturbanceInputs(), PLANT)
    rest = [float(value) for value in leaves(REST).values()]
    assert fastest_growth(as_function(list(leaves(ours).values()), x), rest) < 1e-6

    force_1 = tensions(state, PLANT)[0]
    stretch_2, rate_2 = state.x - 0.8 * state.theta_2, state.v - 0.8 * state.omega_2
    force_2 = one_sided(stretch_2, PLANT.rope_2.tension(stretch_2, rate_2, state.x + 0.5))
    resistance = friction(state.v, PLANT.vehicle) + drag(state.v, PLANT.vehicle)
    printed = replace(
        ours,
        v=(force_1 - force_2 - resistance) / 1e4,
        omega_2=drum_acceleration(state.omega_2, force_2, torques.tau_2, PLANT.winch_2),
    )
    stretched = 1000 / stiffness(25.5, Rope())
    rest[4] = (25.0 - stretched) / 0.8
    assert fastest_growth(as_function(list(leaves(printed).values()), x), rest) > 10


@given(st.floats(-3, 3))
def test_e2_friction_and_drag_take_power_from_the_vehicle(v: float) -> None:
    assert friction(v, PLANT.vehicle) * v >= 0
    assert drag(v, PLANT.vehicle) * v >= 0


def test_e2_as_printed_they_push_a_vehicle_that_moves_back() -> None:
    """Printed without a sign: mu F_N + C rho A v²/2 acts towards -x whatever the direction of motion."""
    v = -1.0
    printed = 0.1 * 4900 + 0.5 * 0.3 * 1000 * 6 * v**2
    assert -printed * v > 0
    assert -(friction(v, PLANT.vehicle) + drag(v, PLANT.vehicle)) * v < 0


def test_e2_as_printed_a_vehicle_at_rest_starts_to_move() -> None:
    ours = derivative(REST, holding_torques(2000.0, PLANT), DisturbanceInputs(), PLANT)
    assert ours.v == pytest.approx(0, abs=1e-9)
    printed = (1000 - 1000 - 0.1 * 4900) / 1e4
    assert printed < -0.04


def test_e2_the_drags_area_is_not_the_ropes(paper_run: PaperRun) -> None:
    """One symbol A for both would leave less than a newton of drag; the ropes pull 2.9 kN at 1.8 m/s."""
    assert 0.5 * 0.3 * 1000 * Rope().area * 1.8**2 < 1
    result = paper_run(2, "fando-nftsm")
    cruise = (result["t"] > 20) & (result["t"] < 28)
    pull = np.mean((result["F1"] - result["F2"])[cruise])
    assert pull == pytest.approx(490 + 0.5 * 0.3 * 1000 * 6 * 1.8**2, rel=1e-3)


def test_e3_the_rope_acts_on_the_drum_with_its_lever() -> None:
    """Printed after substitution, a force in newtons stands among torques: the drum would balance 25 % less."""
    torque, force = 0.8 / 36 * 3000, 3000.0
    assert drum_acceleration(0.0, force, torque, Winch()) == pytest.approx(0, abs=1e-9)
    assert (36 * torque - force) / 1.8 == pytest.approx((0.8 - 1) * 3000 / 1.8)


@pytest.mark.parametrize(("radius", "omega"), [(0.8, -2.0), (1.3, 2.0)])
def test_e3_as_printed_the_drum_makes_energy(radius: float, omega: float) -> None:
    """What the drum gains is what the rope gives: force times rope speed."""
    winch, force = Winch(drum_radius=radius), 3000.0
    given_by_rope = -force * radius * omega
    ours = winch.inertia * omega * drum_acceleration(omega, force, 0.0, winch)
    printed = winch.inertia * omega * (-force / winch.inertia)
    assert ours == pytest.approx(given_by_rope)
    assert printed > given_by_rope


def shed_cycles(disturbance: Disturbance, until: float) -> int:
    """Half cycles of the vortex force while the reference speeds up from rest at 0.1 m/s²."""
    t = np.linspace(0.01, until, 20_000)
    forces = [vortex_force(at, 0.1 * at, 2 * pi * 0.1 * 0.05 * at**2, disturbance, Vehicle()) for at in t]
    return int(np.sum(np.diff(np.sign(forces)) != 0))


def test_e4_frequency_times_time_sheds_twice_as_many_vortices_while_speeding_up() -> None:
    """Over 16.2 m at St/D = 0.1/m it must be 1.62 cycles: 3 changes of sign. Printed, it is 3.24: 6."""
    assert shed_cycles(Disturbance(vortex=True, integrated_phase=True), 18.0) == 3
    assert shed_cycles(Disturbance(vortex=True), 18.0) == 6


def test_e4_the_momentary_frequency_as_printed_is_not_strouhals() -> None:
    t, a, h = 10.0, 0.1, 1e-4
    strouhal = 2 * pi * 0.2 * (a * t) / 2
    printed = [2 * pi * 0.2 * (a * at) / 2 * at for at in (t - h, t + h)]
    assert (printed[1] - printed[0]) / (2 * h) == pytest.approx(2 * strouhal)


def test_e4_integrated_the_phase_is_the_way_over_diameter_and_strouhal() -> None:
    physical = Disturbance(vortex=True, integrated_phase=True)
    result = simulate(replace(case(4), disturbance=physical, simulation=Simulation(duration=20.0)))
    way = result.final_state["motion.plant.x"]
    assert result.final_state["motion.phase"] == pytest.approx(2 * pi * 0.2 / 2 * way, rel=1e-6)


def test_e5_the_reference_is_continuous() -> None:
    profile = Reference(kind="profile")
    for joint in (18.0, 29.0, 41.0):
        before, after = setpoint(joint, profile), setpoint(joint + 1e-9, profile)
        assert after.x == pytest.approx(before.x, abs=1e-8)
        assert after.v == pytest.approx(before.v, abs=1e-8)


def test_e5_as_printed_it_jumps_by_half_the_track() -> None:
    """1.8 t + 9 starts at 41.4 m where the first piece ends at 16.2 m, and runs past the track's 50 m."""
    profile = Reference(kind="profile")
    first_end, last_start = setpoint(18.0, profile).x, setpoint(29.0 + 1e-9, profile).x
    assert (1.8 * 18 + 9) - first_end == pytest.approx(25.2)
    assert (1.8 * 29 + 9) - last_start == pytest.approx(25.2)
    assert 1.8 * 29 + 9 > PLANT.track.length > setpoint(50.0, profile).x


SAMPLE_TIME, MASS = 1e-3, 1e4


def estimates(disturbance: float, *, printed: bool) -> Vector:
    """Estimates for a mass under a swinging force, by our observer or by the printed one in differences."""
    gains, state, e2, e2_before = ObserverGains(kf=0.0), ObserverState(), 0.0, 0.0
    d_hat, found = 0.0, []
    for k in range(2000):
        acceleration = 1000 * sin(2 * pi * 5 * k * SAMPLE_TIME) / MASS
        if printed:
            measured = (e2 - e2_before) / SAMPLE_TIME
            d_hat += (1 - exp(-gains.l0 * SAMPLE_TIME)) * (measured - acceleration - d_hat)
        else:
            now = estimate_disturbance(state, e2, gains, SAMPLE_TIME)
            state = remember(now, e2, acceleration)
            d_hat = now.d_hat
        found.append(d_hat)
        e2_before, e2 = e2, e2 + SAMPLE_TIME * (acceleration + disturbance)
    return np.array(found)


def test_e6_no_sensor_measures_an_acceleration() -> None:
    assert {field.name for field in fields(Measurement)} == {
        *("x", "v", "F1", "F2"),
        *("omega_1", "omega_2", "theta_1", "theta_2"),
    }


def test_e6_a_difference_of_speeds_belongs_to_the_force_of_the_sample_before() -> None:
    """Printed, e2' meets the force of the same instant: read as differences, a swinging force looks like waves."""
    assert np.abs(estimates(0.0, printed=False)).max() < 1e-12
    assert np.abs(estimates(0.0, printed=True)).max() > 2e-4


def test_e6_an_acceleration_from_the_nominal_model_teaches_nothing() -> None:
    """The only other source of e2' is the model itself: then the innovation is -d_hat, whatever the sea does."""
    d_hat = 0.0
    for k in range(2000):
        modelled = 1000 * sin(2 * pi * 5 * k * SAMPLE_TIME) / MASS
        d_hat += 5 * SAMPLE_TIME * (modelled - modelled - d_hat)
    assert d_hat == 0
    assert estimates(0.2, printed=False)[-1] == pytest.approx(0.2, rel=1e-3)


@pytest.mark.parametrize("e2", [0.002, 0.05, 0.4, -0.4])
def test_e7_the_reaching_law_comes_with_a_factor(e2: float) -> None:
    """The paper's proof takes s' = -(eta s + k sat(s/phi)); its law gives p/(q beta) |e2|^(p/q-1) times that."""
    e1, r, beta = 0.1, 5 / 3, 0.05
    estimate = Estimate(e1, e2, 1000.0, 1000.0, 0.0, 0.0, 0.0, 0.0)
    u, _, s = Nftsm().control(0.0, 0.0, estimate, setpoint(0.0, Reference("profile", 1e-9)), CONTEXT)
    slope = (u - friction(e2, PLANT.vehicle) - drag(e2, PLANT.vehicle)) / MASS
    factor = r / beta * abs(e2) ** (r - 1)
    s_dot = e2 + factor * slope
    reaching = 0.05 * s + 0.5 * min(max(s / 0.5, -1), 1)
    assert s_dot == pytest.approx(-factor * reaching, rel=1e-3)
    assert abs(s_dot + reaching) > 0.3 * abs(reaching)


UNITS = {
    "beta": (2 / 3, 0, -5 / 3),
    "eta": (0, 0, -2),
    "k": (1, 0, -2),
    "phi": (1, 0, 0),
    "smoothing": (1, 0, -1),
}
"""Exponents of length, mass and time of the gains."""


def force_in(scales: tuple[float, float, float], auxiliary: AuxiliaryGains) -> float:
    """The law's force in newtons, worked out in other units: so many to the metre, the kilogram and the second."""

    def converted(value: float, exponents: tuple[float, float, float]) -> float:
        return value * np.prod([scale**exponent for scale, exponent in zip(scales, exponents, strict=True)])

    gains = {name: converted(getattr(NftsmGains(), name), exponents) for name, exponents in UNITS.items()}
    preload, lower, upper = (converted(value, (1, 1, -2)) for value in (2000.0, 200.0, 6e8))
    law = Nftsm(replace(NftsmGains(), **gains), auxiliary)
    mass = converted(MASS, (0, 1, 0))
    smooth = replace(PLANT, vehicle=Vehicle(mass=mass, drag_coefficient=0.0, friction_coefficient=0.0))
    estimate = Estimate(converted(0.1, (1, 0, 0)), converted(-0.3, (1, 0, -1)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    point = setpoint(0.0, Reference("profile", 1e-12))
    Z_a, d_hat = converted(50.0, (1, 1, -1)), converted(0.02, (1, 0, -2))
    context = Context(smooth, Limits(preload, lower, upper), converted(SAMPLE_TIME, (0, 0, 1)))
    u, _, _ = law.control(Z_a, d_hat, estimate, point, context)
    return u / converted(1.0, (1, 1, -2))


IN_SI, IN_MM_G_MS = (1.0, 1.0, 1.0), (1e3, 1e3, 1e3)


def test_e8_with_two_gains_the_force_does_not_depend_on_the_units() -> None:
    ours = force_in(IN_SI, AuxiliaryGains(gamma=0.01, gamma_force=0.01))
    other = force_in(IN_MM_G_MS, AuxiliaryGains(gamma=0.01 / 1e3, gamma_force=0.01 / 1e3))
    both = force_in((1e3, 1.0, 1e3), AuxiliaryGains(gamma=0.01, gamma_force=0.01 / 1e3))
    assert both == pytest.approx(ours, rel=1e-6)
    assert other == pytest.approx(ours, rel=1e-6)


@pytest.mark.parametrize("gamma", [0.01, 0.01 / 1e3], ids=["as m/(N s^2)", "as 1/s"])
def test_e8_one_gamma_for_both_makes_the_force_depend_on_the_units(gamma: float) -> None:
    """In millimetres, kilograms and milliseconds one number cannot be right in the surface and in the force."""
    ours = force_in(IN_SI, AuxiliaryGains(gamma=0.01, gamma_force=0.01))
    printed = force_in((1e3, 1.0, 1e3), AuxiliaryGains(gamma=gamma, gamma_force=gamma))
    assert abs(printed / ours - 1) > 1e-3


def test_e8_each_gamma_has_its_own_unit() -> None:
    gains = describe(AuxiliaryGains)
    assert (gains["gamma"].quantity.unit, gains["gamma_force"].quantity.unit) == ("m/(N s^2)", "1/s")


def test_e9_as_printed_the_torque_equation_has_no_solution() -> None:
    """tau = (R/G) F_d + (J/G) omega' feeds the acceleration back to itself with gain one."""
    winch, command, force = Winch(), 3000.0, 2900.0

    def acceleration(assumed: float) -> float:
        torque = 0.8 / 36 * command + winch.inertia / 36 * assumed
        return drum_acceleration(0.0, force, torque, winch)

    assert acceleration(1.0) - acceleration(0.0) == pytest.approx(1)
    assert acceleration(5.0) - 5.0 == pytest.approx(0.8 * (command - force) / winch.inertia)


def test_e9_the_reference_acceleration_breaks_the_loop() -> None:
    _, torque, _ = winch_step(WinchState(), 3000.0, 3000.0, DrumMotion(alpha_d=2.0), Winch(), WinchGains(), CONTEXT)
    assert drum_acceleration(0.0, 3000.0, torque, Winch()) == pytest.approx(2)


def tension_after(seconds: float, gains: WinchGains) -> float:
    """Tension of a rope on a fixed vehicle, commanded to 3 kN by a controller that takes the drum for 2 % smaller."""
    winch, rope, nominal = Winch(), Rope(), Winch(drum_radius=0.784)
    state, theta, omega = WinchState(), 2900 / stiffness(25.0, rope) / 0.8, 0.0
    force = 2900.0
    for _ in range(round(seconds / 1e-3)):
        state, torque, _ = winch_step(state, 3000.0, force, DrumMotion(), nominal, gains, CONTEXT)
        for _ in range(5):
            force = one_sided(0.8 * theta, rope.tension(0.8 * theta, 0.8 * omega, 25.0))
            omega += 2e-4 * drum_acceleration(omega, force, torque, winch)
            theta += 2e-4 * omega
    return force


def test_e10_the_tension_error_is_command_minus_tension() -> None:
    """Printed the other way round, what is missing is taken off: the tension drifts away ever faster."""
    assert tension_after(4.0, WinchGains()) == pytest.approx(3000, abs=5)
    assert tension_after(4.0, WinchGains(kp=-5e-4, ki=-2e-2)) < 2000


@given(st.floats(-5800, 5800))
def test_e11_the_limits_treat_both_ropes_alike(u_sat: float) -> None:
    F1, F2 = tension_commands(u_sat, Limits())
    assert tension_commands(-u_sat, Limits()) == pytest.approx((F2, F1))
    assert max(F1, F2) <= 6000


def test_e11_as_printed_a_weaker_winch_2_is_asked_for_too_much() -> None:
    """Printed, F_2d is compared with F_1max: between F_2max and F_1max nothing limits it."""
    F1_max, F2_max, F2_d = 6000.0, 4000.0, 5000.0
    printed = F2_max if F2_d > F1_max else F2_d
    assert printed > F2_max
    weaker = Limits(preload=2000.0, tension_max=F2_max)
    assert tension_commands(-4000.0, weaker)[1] <= F2_max


def test_a2_ropes_that_push_would_hold_a_vehicle_between_slack_ropes() -> None:
    """Both drums pay out a millimetre: real ropes hang loose, the paper's push the vehicle from both sides."""
    loose = replace(REST, theta_1=(25 - 1e-3) / 0.8, theta_2=(-25 - 1e-3) / 0.8)
    assert tensions(loose, PLANT) == (0, 0)
    slopes = derivative(loose, Torques(0.0, 0.0), DisturbanceInputs(), Plant(rope_slack=False))
    assert min(slopes.omega_1, slopes.omega_2) > 100
