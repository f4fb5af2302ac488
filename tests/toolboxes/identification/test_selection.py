"""What hardly any user knows: estimated along where the described experiment leaves innovations coloured."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification import screening
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log
from dualwinch.toolboxes.identification.options import DEFAULTS, DataSheetOptions
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.screening import torque_lags
from dualwinch.toolboxes.identification.unknowns import nuisance_parameters, with_drum_friction, with_sea
from dualwinch.toolboxes.identification.vortices import shows_other_vortices, vortex_starts, with_vortex_origin
from tests.last_bit import SEEDS, perturbed
from tests.toolboxes.identification.conftest import SEA, logged, machine

KEYS = ("plant.vehicle.mass", "plant.vehicle.drag_coefficient", "plant.rope_*.modulus")

OFF = {
    "plant.winch_1.inertia": 1.95,
    "plant.winch_2.inertia": 1.65,
    "plant.rope_1.damping": 750.0,
    "plant.rope_2.damping": 1250.0,
    "plant.winch_1.coulomb_friction": 96.0,
    "plant.winch_2.coulomb_friction": 60.0,
    "disturbance.strouhal": 0.19,
    "simulation.delay_samples": 2,
}


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("described", [{}, {"disturbance.vortex": False}])
def test_parameters_are_right_although_much_else_is_off(described: dict[str, object]) -> None:
    right = override(machine(simulation__duration=30.0), OFF)
    log, nominal = logged(right), machine(simulation__duration=30.0)
    found = identify([replace(log, t=log.t + 1000.0)], KEYS, override(nominal, described))
    values = leaves(right)
    off = (found.values - [values[key] for key in found.keys]) / found.deviations
    assert np.abs(off).max() < 3
    assert found.converged
    assert set(found.along) == {*OFF, "disturbance.vortex_amplitude"} - {"simulation.delay_samples"}
    for key, (value, deviation) in found.along.items():
        assert value == pytest.approx(values[key], abs=4 * deviation)
    assert any("torques act 2 samples after they are logged" in note for note in found.notes)
    assert found.experiment.simulation.delay_samples == 1, "as described"
    assert found.experiment.disturbance.vortex == (not described)
    assert any(
        "vortices (disturbance.vortex), which the experiment does not describe" in note for note in found.notes
    ) == bool(described)


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("factor", [1 / 3, 3.0])
def test_parameters_are_right_although_the_described_sea_is_of_another_size(factor: float) -> None:
    right = override(machine(simulation__duration=40.0), {"plant.winch_1.coulomb_friction": 96.0})
    keys = ("plant.vehicle.mass", "plant.vehicle.drag_coefficient", "plant.vehicle.friction_coefficient")
    other = {key: factor * size for key, size in {**SEA, "disturbance.vortex_amplitude": 0.2}.items()}
    found = identify([logged(right)], keys, override(machine(simulation__duration=40.0), other))
    values = leaves(right)
    off = (found.values - [values[key] for key in keys]) / found.deviations
    assert np.abs(off).max() < 3
    assert (found.deviations < np.array([0.015, 0.08, 0.25]) * found.values).all()
    assert found.along["disturbance.vortex_amplitude"][0] == pytest.approx(0.2, rel=0.15)
    assert any(f"disturbance.normal_force_sigma = {0.1 * factor:.3g}, " in note for note in found.notes)


@pytest.mark.slow
def test_each_phase_has_the_estimates_so_far() -> None:
    """The first within a fit as described, long before alternatives are compared; progress never goes back."""
    right = override(machine(simulation__duration=5.0), {"simulation.delay_samples": 2})
    phases, shares = list[str](), list[float]()

    def progress(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        phases.append(phase)
        shares.append(fraction)

    key, alternatives = "plant.vehicle.mass", ["torque-delay"]
    accepted = {"alternatives": alternatives, "unrecorded": 10.0}  # a sample of delay is as large an unrecorded torque
    found = identify([logged(right)], key, machine(), progress=progress, **accepted)
    (later,) = {phase for phase in phases if phase.startswith("fitting with torque-delay")}
    assert f" · so far {key} = " in later
    estimate = float(later.split(" = ")[1].split(" ± ")[0])
    assert estimate == pytest.approx(found.values[0], rel=0.1)
    assert shares == sorted(shares)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_delay_of_the_torques_is_seen_in_the_load_cells(delay: int) -> None:
    log = logged(machine(simulation__delay_samples=delay, simulation__duration=5.0))
    significance = torque_lags(sections_of([log], Experiment()), order=8)
    assert np.argmax(significance) == delay
    assert significance[delay] > 3 * np.delete(significance, delay).max()


def test_a_log_without_load_cells_shows_no_delay() -> None:
    log = logged(machine(simulation__duration=5.0))
    columns = {name: values for name, values in log.columns.items() if not name.startswith("F")}
    assert not torque_lags(sections_of([replace(log, columns=columns)], Experiment()), order=8).any()


def far_off(amplitude: float = 0.2) -> tuple[Log, Experiment]:
    """A log whose vortices are of another Strouhal number than described, by two and a half periods at its end."""
    right = {"disturbance__strouhal": 0.168, "disturbance__vortex_amplitude": amplitude}
    return logged(machine(simulation__duration=40.0, **right)), machine(simulation__duration=40.0)


def test_searches_begin_where_smoothed_readings_show_vortices() -> None:
    log, nominal = far_off()
    ((strouhal, amplitude),) = vortex_starts([log], nominal, reach=0.04)
    assert strouhal == pytest.approx(0.168, abs=0.002)
    assert amplitude == pytest.approx(0.2, rel=0.3)
    assert len(vortex_starts([far_off(amplitude=0.02)[0]], nominal, reach=0.04)) > 1, "they hardly show"
    still = machine(reference__kind="uniform", reference__speed=1e-3)
    assert vortex_starts([logged(still)], still, reach=0.04) == []


def test_vortices_that_an_estimate_lacks_are_suspected() -> None:
    right = machine(disturbance__strouhal=0.21, disturbance__current_sigma=0.04)
    for nominal, other in ((right, False), (machine(), True), (machine(disturbance__vortex=False), True)):
        assert shows_other_vortices([logged(right)], nominal, 0.08) == other


@pytest.mark.nightly
@pytest.mark.slow
def test_a_sea_that_is_not_described_is_found_although_innovations_are_white() -> None:
    right = machine(plant__vehicle__mass=3300.0, disturbance__strouhal=0.21, simulation__duration=40.0)
    calm = dict.fromkeys(("disturbance.current_sigma", "disturbance.normal_force_sigma"), 0.0)
    nominal = override(right, {**calm, "disturbance.vortex": False, "disturbance.strouhal": 0.2})
    found = identify([logged(right)], KEYS, nominal)
    assert (np.abs(found.values - [3300.0, 0.3, 8e10, 8e10]) < 3 * found.deviations).all()
    assert found.along["disturbance.strouhal"][0] == pytest.approx(0.21, abs=0.002)


@pytest.mark.nightly
@pytest.mark.slow
def test_a_delay_that_arx_models_do_not_show_is_the_likeliest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they show each alike, a fit without the delay makes up for it by inertia and damping."""
    monkeypatch.setattr(screening, "torque_lags", lambda _sections, order: np.ones(order))
    short = machine(simulation__duration=8.0)
    right = override(short, OFF | {"simulation.delay_samples": 2})
    found = identify([logged(right)], ["plant.vehicle.mass", "plant.winch_*.inertia"], short)
    values = leaves(right)
    assert (np.abs(found.values - [values[key] for key in found.keys]) < 3 * found.deviations).all()
    assert any("torques act 2 samples after they are logged" in note for note in found.notes)


@pytest.mark.slow
def test_a_drum_of_twice_the_described_inertia_is_another_one_and_no_other_machine() -> None:
    short = machine(simulation__duration=6.0)
    log = logged(override(short, {"plant.winch_1.inertia": 3.6}))
    found = identify([log], ["plant.vehicle.mass"], short, alternatives=["winches-and-ropes", "torque-delay"])
    assert abs(found.values[0] - 1e4) < 3 * found.deviations[0] < 1000
    inertia, deviation = found.along["plant.winch_1.inertia"]
    assert abs(inertia - 3.6) < 4 * deviation < 0.1
    (note,) = (note for note in found.notes if "from what was expected" in note)
    assert note.startswith(f"plant.winch_1.inertia = {inertia:.4g} is far from what was expected, 1.8 ± 0.54 kg m^2: ")


@pytest.mark.slow
def test_a_log_cut_out_of_a_run_is_fitted_by_encoders_alone() -> None:
    whole = logged(machine(simulation__duration=40.0)).from_zero()
    cut = whole.rows(whole.t >= 20.0)
    cut = replace(cut, columns={name: cut.columns[name] for name in ("tau_1", "tau_2", "theta_1", "theta_2")})
    found = identify([cut], ["plant.vehicle.mass"], machine())
    assert abs(found.values[0] - 1e4) < 3 * found.deviations[0] < 1000
    assert any("begins under way" in note for note in found.notes)


@pytest.mark.slow
def test_a_log_with_a_gap_is_fitted_in_parts() -> None:
    whole = logged(machine())
    torques = {name: np.where(abs(whole.t - 8.0) < 1.0, np.nan, whole.columns[name]) for name in ("tau_1", "tau_2")}
    gap = replace(whole, columns={**whole.columns, **torques})
    found = identify([gap], ["plant.vehicle.mass"], machine())
    assert len(found.logs) == 2
    assert abs(found.values[0] - 1e4) < 3 * found.deviations[0] < 500
    rare = {name: np.where(np.arange(len(whole.t)) % 500, np.nan, whole.columns[name]) for name in ("tau_1", "tau_2")}
    with pytest.raises(ConfigurationError, match=r"gaps of more than 0\.1 s leave no 200 rows in a row"):
        identify([replace(whole, columns={**whole.columns, **rare})], ["plant.vehicle.mass"], machine())


@pytest.mark.nightly
@pytest.mark.slow
def test_several_optima_are_found_and_said() -> None:
    log, nominal = far_off()
    keys, priors = ("plant.vehicle.mass", "disturbance.strouhal"), {"disturbance.strouhal": (0.2, 0.02)}
    found = identify([log], keys, nominal, priors=priors)
    assert found.interval("plant.vehicle.mass")[0] < 1e4 < found.interval("plant.vehicle.mass")[1]
    assert found.values[1] == pytest.approx(0.168, abs=5e-4)
    assert len(found.optima) == 1
    every = replace(DEFAULTS, search=replace(DEFAULTS.search, considerable=100.0))
    several = identify([log], keys, nominal, priors=priors, options=every)
    assert len(several.optima) > 1
    assert several.optima[1].deviance > 100
    assert any("distinct optima; the second is less likely" in note for note in several.notes)
    np.testing.assert_allclose(several.values, found.values, atol=0.1 * found.deviations.min(), rtol=1e-4)


def test_a_log_cut_out_of_a_run_has_the_time_of_its_vortices() -> None:
    log = logged(machine(disturbance__strouhal=0.19, simulation__duration=35.0))
    for begins in (5.0, 12.0):
        cut = log.rows(log.t >= begins).from_zero()
        found = with_vortex_origin(cut, machine())
        assert found.t[0] == pytest.approx(begins, abs=0.8), "within what another Strouhal number makes up for"
        assert "begins under way" in found.notes[-1]
    assert with_vortex_origin(log, machine()) is log, "it begins at rest"
    calm = logged(machine(disturbance__vortex=False))
    calm = calm.rows(calm.t >= 7).from_zero()
    assert with_vortex_origin(calm, machine(disturbance__vortex=False)).t[0] == 0


@pytest.mark.nightly
@pytest.mark.slow
def test_a_log_cut_out_of_a_run_gives_right_parameters() -> None:
    right = machine(simulation__duration=40.0)
    log = logged(right)
    found = identify([log.rows(log.t >= 12)], KEYS, override(right, {"plant.vehicle.mass": 1.05e4}))
    off = (found.values - [leaves(right)[key] for key in found.keys]) / found.deviations
    assert np.abs(off).max() < 3
    assert any("begins under way" in note for note in found.notes)


def test_what_is_estimated_along_is_what_no_key_names_and_the_experiment_has() -> None:
    nominal = with_drum_friction(Experiment())
    assert nominal.plant.winch_1.coulomb_friction == pytest.approx(0.02 * 0.8 * 6000)
    keys = [each.key for each in nuisance_parameters(["plant.winch_1.inertia"], nominal)]
    assert "plant.winch_2.inertia" in keys
    assert "plant.winch_1.inertia" not in keys
    assert "disturbance.strouhal" not in keys
    sea = with_sea(nominal)
    assert "disturbance.strouhal" in [each.key for each in nuisance_parameters([], sea)]
    assert with_sea(sea) == sea
    assert with_drum_friction(nominal) == nominal


@pytest.mark.nightly
@pytest.mark.slow
def test_torques_that_chatter_and_are_logged_at_200_hz() -> None:
    """The paper's controller makes them, from the position's noise; a few of them are logged."""
    right = override(machine(simulation__duration=30.0), OFF)
    log = logged(right)
    every = log.rows(slice(None, None, 5))
    # what the log tells, without the share of data sheets in the deviation: 2 % of the motors' constants alone
    perfect = replace(DEFAULTS, data_sheet=DataSheetOptions(**dict.fromkeys(vars(DEFAULTS.data_sheet), 0.0)))
    found = identify([every], KEYS, machine(simulation__duration=30.0), options=perfect)
    values = leaves(right)
    off = (found.values - [values[key] for key in found.keys]) / found.deviations
    assert np.abs(off).max() < 3
    assert found.deviations[0] < 0.03 * found.values[0]
    assert any("changed more often than they were logged" in note for note in found.notes)
    assert any("torques act 2 samples after they are logged" in note for note in found.notes)
    with pytest.raises(ConfigurationError, match=r"has a row every 10 ms, its torques change in between"):
        identify([log.rows(slice(None, None, 10))], KEYS, machine(simulation__duration=30.0))


@pytest.mark.nightly
@pytest.mark.slow
def test_the_choice_of_a_model_does_not_hang_on_the_last_bit() -> None:
    right = machine(sensors__speed_noise=5e-4, simulation__duration=6.0)
    log, nominal = logged(right), override(right, {"plant.vehicle.mass": 1.05e4})
    keys = ("plant.vehicle.mass", "plant.rope_*.modulus")
    kinds = [each.alternatives for each in identify(log, keys, nominal, workers=1).models]
    for seed in SEEDS:
        moved = replace(log, columns=perturbed(dict(log.columns), seed))
        assert [each.alternatives for each in identify(moved, keys, nominal, workers=1).models] == kinds
