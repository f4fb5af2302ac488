"""Vortices whose phase is integrated (E4): a light vehicle, on which they weigh as much as its own drag."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification import vortices
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log
from dualwinch.toolboxes.identification.predictor import predictor_structure, state_template
from dualwinch.toolboxes.identification.unknowns import AMPLITUDE, STROUHAL, nuisance_parameters
from dualwinch.toolboxes.identification.vortices import (
    likelier_phase,
    shows_other_vortices,
    vortex_starts,
    with_vortex_origin,
)
from tests.tiers import all_but
from tests.toolboxes.identification.conftest import logged, machine

KEYS = ("plant.vehicle.mass", "plant.vehicle.drag_coefficient")

TRUTH = np.array([2200.0, 0.8])

SHORT = {"simulation.duration": 20.0}

UNDESCRIBED = {"disturbance.vortex": False, "disturbance.integrated_phase": False, "plant.vehicle.mass": 2400.0}


def light(**settings: object) -> Experiment:
    """A vehicle of 2.2 t and a thin body, without a sea but for vortices."""
    own = {
        "plant.vehicle.mass": TRUTH[0],
        "plant.vehicle.drag_coefficient": TRUTH[1],
        "plant.vehicle.diameter": 1.2,
        "disturbance.current_sigma": 0.0,
        "disturbance.normal_force_sigma": 0.0,
        "disturbance.integrated_phase": True,
        "simulation.duration": 30.0,
    }
    return override(machine(), own | settings)


def cut(log: Log, since: float) -> Log:
    rows = log.t >= since
    return replace(log, t=log.t[rows], columns={name: values[rows] for name, values in log.columns.items()})


def test_they_are_states_of_the_filter_and_their_amplitude_is_no_parameter() -> None:
    names = set(leaves(state_template(predictor_structure(light()))))
    assert {"vortices.sine", "vortices.cosine"} <= names
    paper = override(light(), {"disturbance.integrated_phase": False})
    assert not any(name.startswith("vortices.") for name in leaves(state_template(predictor_structure(paper))))
    along = {each.key for each in nuisance_parameters((), light())}
    assert STROUHAL in along
    assert AMPLITUDE not in along
    assert AMPLITUDE in {each.key for each in nuisance_parameters((), paper)}


@pytest.mark.parametrize("since", all_but([9.0], [0.0, 9.0]), ids=["whole", "cut out of mid-run"])
def test_mass_and_drag_are_right_wherever_a_log_begins(since: float) -> None:
    found = identify([cut(logged(light()), since)], KEYS, light(**{"plant.vehicle.mass": 2400.0}))
    assert (np.abs(found.values - TRUTH) < 3 * found.deviations).all()
    assert (found.deviations < 0.02 * TRUTH).all()


@pytest.mark.parametrize("integrated", [True, False])
def test_smoothed_readings_show_which_kind_of_phase_vortices_have(*, integrated: bool) -> None:
    log = logged(light(**{"disturbance.integrated_phase": integrated}))
    for described in (light(), light(**{"disturbance.integrated_phase": False})):
        assert likelier_phase([log], described, 0.04) == integrated
        if described.disturbance.integrated_phase != integrated:
            assert shows_other_vortices([log], described, 0.04)
    assert not integrated or not shows_other_vortices([log], light(), 0.04)


@pytest.mark.parametrize("integrated", [True, False])
def test_a_log_that_is_too_short_to_tell_contradicts_no_described_phase(*, integrated: bool) -> None:
    """Seven seconds have fewer independent rows than an integrated phase has coefficients."""
    log, described = logged(light()), light(**{"disturbance.integrated_phase": integrated})
    short = log.rows((log.t >= 2.0) & (log.t < 9.0))
    regression = vortices.vortex_regression([short], described, 0.04, integrated=True)
    assert regression is not None
    assert np.isnan(regression.deviance)
    assert likelier_phase([short], described, 0.04) == integrated


def test_searches_begin_at_the_strouhal_number_and_amplitude_that_smoothed_readings_show() -> None:
    log = logged(light(**{"disturbance.strouhal": 0.19, "disturbance.vortex_amplitude": 0.3}))
    (strouhal, amplitude), *_ = vortex_starts([log], light(), 0.04)
    assert strouhal == pytest.approx(0.19, abs=0.002)
    assert amplitude == pytest.approx(0.3, rel=0.3)


def test_a_log_cut_out_of_mid_run_needs_no_origin() -> None:
    log = cut(logged(light()), 9.0).from_zero()
    for described in (light(), light(**{"disturbance.integrated_phase": False})):
        assert with_vortex_origin(log, described) == log


@pytest.mark.nightly
@pytest.mark.slow
def test_a_kind_of_phase_that_is_not_described_is_found() -> None:
    found = identify([logged(light(**SHORT, **{"disturbance.strouhal": 0.19}))], KEYS, light(**SHORT, **UNDESCRIBED))
    assert (np.abs(found.values - TRUTH) < 3 * found.deviations).all()
    assert found.along[STROUHAL][0] == pytest.approx(0.19, abs=0.002)
    assert any("the phase of the vortices is the integral of their frequency" in note for note in found.notes)


@pytest.mark.nightly
@pytest.mark.slow
def test_where_vortices_come_to_nothing_the_other_kind_of_phase_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weak ones hardly show in smoothed readings."""
    weak = {"disturbance.vortex_amplitude": 0.05, "disturbance.strouhal": 0.19}
    monkeypatch.setattr(vortices, "likelier_regression", vortices.vortex_regression)
    found = identify([logged(light(**SHORT, **weak))], KEYS, light(**SHORT, **UNDESCRIBED))
    assert (np.abs(found.values - TRUTH) < 3 * found.deviations).all()
    assert any("the phase of the vortices is the integral of their frequency" in note for note in found.notes)
