"""Shaping of tension commands, against SciPy's linear systems and the plant."""

import numpy as np
import pytest
from scipy.signal import TransferFunction, cont2discrete, dlsim

from dualwinch.controllers.coordinations.command_shaping import DrumResonance, ShapedCommand, drum_resonance, shaped
from dualwinch.controllers.coordinations.differential_tension import DifferentialTension
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.paper import case

T = 1e-3


def filtered(commands: np.ndarray, drum: DrumResonance, shaping: float) -> np.ndarray:
    state, outputs = ShapedCommand(), []
    for number, command in enumerate(commands):
        state, output = shaped(state, float(command), drum, shaping, T, float(number > 0))
        outputs.append(output)
    return np.array(outputs)


@pytest.mark.parametrize(("frequency", "damping", "shaping"), [(20.0, 0.05, 0.5), (46.0, 0.33, 0.8), (60.0, 0.2, 1.2)])
def test_a_drum_follows_the_shaped_command_with_the_chosen_damping(
    frequency: float, damping: float, shaping: float
) -> None:
    """A step through the filter and a drum with its own poles, and through one with the chosen poles, by SciPy."""
    t = T * np.arange(1500)
    commands = np.where(t < 0.1, 1000.0, 1400.0)
    force = filtered(commands, DrumResonance(frequency, damping), shaping)

    def followed(inputs: np.ndarray, ratio: float) -> np.ndarray:
        system = TransferFunction([frequency**2], [1.0, 2 * ratio * frequency, frequency**2]).to_ss()
        discrete = cont2discrete((system.A, system.B, system.C, system.D), T)
        return dlsim(discrete, inputs - 1000.0)[1][:, 0]

    wanted = followed(commands, shaping)
    assert np.abs(followed(force, damping) - wanted).max() < 0.06 * 400
    assert np.abs(followed(commands, damping) - wanted).max() > 0.1 * 400
    assert force[0] == 1000
    assert force[-1] == pytest.approx(1400, rel=1e-6)


def test_no_frequency_is_amplified() -> None:
    drum = DrumResonance(46.0, 0.2)
    for hertz in (1.0, 5.0, 46 / (2 * np.pi), 10.0, 40.0, 200.0):
        wave = np.sin(2 * np.pi * hertz * T * np.arange(6000))
        assert np.abs(filtered(wave, drum, 0.7)[3000:]).max() <= 1 + 1e-9


def test_a_drum_that_is_damped_well_enough_leaves_the_command() -> None:
    commands = 1000 + 50 * np.sin(30 * T * np.arange(200))
    assert filtered(commands, DrumResonance(30.0, 0.9), 0.6) == pytest.approx(commands, abs=1e-12)


def test_the_resonance_is_that_of_a_mass_on_a_spring() -> None:
    """Poles of ``m x'' + c x' + k x = 0`` with Table 1's drum on a rope of 25 m, and a motor that opposes its speed."""
    plant = Plant()
    mass, spring, damper = 1.8 / 0.8**2, 8e10 * 4.52e-4 / 25.0, 1000 + 20.0 * 36 / 0.8**2
    poles = np.linalg.eigvals([[0, 1], [-spring / mass, -damper / mass]])
    drum = drum_resonance(plant.sides[0], 500.0, 25.0, plant.track, 20.0)
    assert drum.frequency == pytest.approx(float(np.abs(poles[0])))
    assert drum.damping == pytest.approx(float(-poles[0].real / np.abs(poles[0])))


def test_without_shaping_there_is_no_state_and_the_torque_is_as_before() -> None:
    assert WinchGains().initial_state().shaped is NO_STATE
    plain, shaping = (DifferentialTension(*2 * (WinchGains(shaping=size),)) for size in (0.0, 0.8))
    context = Context(Plant(), case(4).controller.limits, T)
    estimate, setpoint = Estimate(25.0, 0.0, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0), Setpoint(25.0, 0.0, 0.0)
    torques = [each.step(each.initial_state(), 0.0, estimate, setpoint, context)[1] for each in (plain, shaping)]
    assert torques[0] == torques[1]
