"""Designed gains: critically damped for small and for large speed errors, by the law's own force."""

import math
from dataclasses import replace

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.design import formula_design, limits_of, timing_of, with_designed_parts
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.controllers.presets.designed import LAG_RATIO, Shares
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import Rope
from dualwinch.model.vehicle import inertia
from dualwinch.simulation.experiment import Experiment

LAGGING = dw.override(dw.case(4), {"actuator.kind": "motor", "actuator.motor.time_constant": 0.02})


def feedback(experiment: Experiment, e1: float, e2: float) -> float:
    """Acceleration in m/s² by which the law answers errors of position and speed, friction and drag apart."""
    controller, plant = experiment.controller, experiment.plant
    context = Context(plant, controller.limits, 1e-3)

    def force(x: float) -> float:
        estimate = Estimate(x=x, v=0.0, F1=0.0, F2=0.0, omega_1=0.0, omega_2=0.0, theta_1=0.0, theta_2=0.0)
        law = controller.law
        _, output = law.step(law.initial_state(), estimate, Setpoint(0.0, -e2, 0.0), context)
        return float(output.u)

    return (force(e1) - 0.0) / float(inertia(plant.vehicle))


def test_the_law_is_critically_damped_at_small_errors() -> None:
    machine = formula_design(with_designed_parts(LAGGING))
    bandwidth = limits_of(machine)[0].bandwidth
    assert bandwidth == pytest.approx(1 / (LAG_RATIO * timing_of(machine).lag)), "the lag of the drives is the limit"
    assert feedback(machine, 1e-7, 0.0) == pytest.approx(-(bandwidth**2) * 1e-7, rel=1e-3)
    assert feedback(machine, 0.0, 1e-6) == pytest.approx(-2 * bandwidth * 1e-6, rel=1e-3)


def test_the_law_is_no_steeper_at_large_speed_errors() -> None:
    """The first harmonic of the force for a sinusoidal speed error, by quadrature; the boundary layer is widened."""
    machine = formula_design(with_designed_parts(LAGGING))
    law = machine.controller.law
    assert isinstance(law, FandoNftsm)
    unlimited = replace(law.nftsm, k=1e3 * law.nftsm.k, phi=1e3 * law.nftsm.phi)
    machine = replace(machine, controller=replace(machine.controller, law=replace(law, nftsm=unlimited)))
    bandwidth = limits_of(machine)[0].bandwidth
    angles = (np.arange(200) + 0.5) * math.pi / 200
    for amplitude in np.geomspace(1e-3, 0.3, 8):
        harmonic = [feedback(machine, 0.0, amplitude * math.sin(angle)) * math.sin(angle) for angle in angles]
        assert -2 * np.mean(harmonic) / amplitude < 2.05 * bandwidth, amplitude


def test_the_damping_fades_where_its_lag_is_a_quarter_of_the_drums_period() -> None:
    """On massless ropes, whose stiffness is EA over the length; a longer fading range than that of the design stays."""
    stiff = {f"plant.winch_{side}.inertia": 90.0 for side in (1, 2)}
    machine = with_designed_parts(dw.override(LAGGING, stiff))
    faded = leaves(formula_design(machine, Shares(fading=True)))
    length = faded["controller.winch_1.fade"] * machine.plant.track.length
    winch, rope = machine.plant.winch_1, machine.plant.rope_1
    assert isinstance(rope, Rope)
    mass = (winch.inertia + winch.rotor_inertia * winch.gear_ratio**2) / winch.drum_radius**2
    period = 2 * math.pi * math.sqrt(mass * length / (rope.modulus * rope.area))
    assert period == pytest.approx(4 * timing_of(machine).lag, rel=1e-3)
    assert leaves(formula_design(machine))["controller.winch_1.fade"] == leaves(machine)["controller.winch_1.fade"]
    widely = dw.override(machine, {"controller.winch_1.fade": 2 * faded["controller.winch_1.fade"]})
    assert leaves(formula_design(widely, Shares(fading=True)))["controller.winch_1.fade"] == pytest.approx(
        2 * faded["controller.winch_1.fade"]
    )


def test_half_of_the_way_to_other_shares_is_a_geometric_mean() -> None:
    half = Shares(bandwidth=0.49, damping=0.7).towards(Shares(fading=True))
    assert half.named == pytest.approx({"bandwidth": 0.7, "damping of the drums": 0.7**0.5, "integral action": 1.0})
    assert not half.fading, "the machine of the first asks for none"
