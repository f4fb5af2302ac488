"""Derivatives of any column by any continuous number, against central differences of complete runs, same draws."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.signals import Signal
from dualwinch.simulation.batch.sensitivities import Sensitivities, check_differentiable, sensitivities
from dualwinch.simulation.exogenous.signals import check_shaped, shaped_by
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import parameters_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.tiers import all_but
from tests.tolerances import close

COLUMNS = ("x", "v", "omega_2", "e", "F1", "F2", "u", "d_true", "tau_1", "torque_2", "x_read", "F1_read", "d_est")

EVERYTHING = {
    "simulation": {"duration": 2.0, "integrator": "exponential", "jitter": 1e-4, "readings": True},
    "controller": {"estimator": "kalman", "coordination.preload": 5000.0},
    "disturbance": {"current_sigma": 0.08, "current_limit": 0.06, "normal_force_sigma": 0.1},
    "sensors": {"position_noise": 1e-4, "speed_noise": 1e-3, "tension_noise": 3.0, "position_drift": 1e-3}
    | {"position_drift_time": 3.0, "position_bias": 2e-3, "load_cell_error_1": 0.01, "load_cell_zero_2": 20.0}
    | {"encoder_zero_1": 1e-3},
    "actuator": {"kind": "motor"},
    "plant.vehicle": {"added_mass": 500.0},
    "plant.winch_1": {"radius_error": 2e-3, "eccentricity": 1e-2, "torque_error": 0.02, "torque_ripple": 0.1}
    | {"layer_thickness": 2e-2, "coulomb_friction": 20.0, "viscous_friction": 5.0},
    "plant.creep_1": {"elongation": 1e-2, "time": 5.0},
}
"""An experiment in which next to everything acts, and nothing has a kink: no torque is limited, one integrator."""


@cache
def everything() -> Experiment:
    changes = {f"{table}.{name}": value for table, given in EVERYTHING.items() for name, value in given.items()}
    experiment = override(case(4), changes)
    force = Signal.from_arrays([0.0, 10.0], [200.0, 600.0], unit="N")
    return replace(experiment, disturbance=replace(experiment.disturbance, force=force))


def numbers_of(experiment: Experiment) -> dict[str, float]:
    """Every number that the run changes with and that is not 0, gains and beliefs apart; a few of those."""
    own = {key: value for key, value in leaves(experiment).items() if shaped_by(key)}
    given = parameters_of(experiment) | own
    chosen = ("controller.nftsm.beta", "controller.kalman", "nominal.vehicle.mass", "controller.coordination.preload")
    known: dict[str, float] = {}
    for key, value in given.items():
        if not value or (key.startswith(("controller.", "nominal.")) and not key.startswith(chosen)):
            continue
        try:
            check_differentiable([key], experiment)
            check_shaped(experiment, key)
        except ConfigurationError:
            continue
        known[key] = value
    return known


NUMBERS = numbers_of(everything())

FEW = (
    "plant.vehicle.mass",
    "plant.vehicle.drag_coefficient",
    "plant.track.length",
    "plant.rope_1.modulus",
    "plant.rope_2.damping",
    "plant.winch_1.drum_radius",
    "plant.winch_1.eccentricity",
    "plant.winch_1.torque_ripple",
    "plant.winch_2.inertia",
    "plant.creep_1.elongation",
    "nominal.vehicle.mass",
    "controller.kalman.bandwidth",
    "controller.coordination.preload",
    "disturbance.vortex_amplitude",
    "disturbance.current_sigma",
    "disturbance.force.scale",
    "sensors.position_bias",
    "sensors.load_cell_zero_2",
    "actuator.motor.time_constant",
    "simulation.jitter",
)
"""Numbers of every kind; the code of the derivatives by all is three times as large."""


def moved(key: str, value: float) -> Result:
    """A complete run with another number; the controller assumes the same plant."""
    experiment = everything()
    if not key.startswith("nominal."):
        return simulate(override(experiment, {key: value}), nominal=experiment.plant)
    plant = override(experiment, {key.replace("nominal.", "plant."): value}).plant
    return simulate(experiment, nominal=plant)


@cache
def derivatives(names: tuple[str, ...]) -> Sensitivities:
    return sensitivities(list(names), [[NUMBERS[name] for name in names]], [everything()], columns=COLUMNS)


@pytest.fixture(scope="module")
def few() -> Sensitivities:
    return derivatives(FEW)


STEPS = (1e-4, 1e-5, 1e-3, 1e-6, 1e-2)
"""Relative steps of central differences. Rounding spoils the small ones where little changes, curvature the large."""

CLOSE = 5e-4
"""How far derivatives may be from the best of the differences, over their largest."""


def furthest(key: str, found: Sensitivities, columns: tuple[str, ...] = COLUMNS) -> dict[str, float]:
    """How far derivatives are from the best of the differences, over their largest, by column."""
    value, number = NUMBERS[key], list(found.names).index(key)
    apart = {column: [np.inf] for column in columns}
    for step in STEPS:
        upper, lower = moved(key, value * (1 + step)), moved(key, value * (1 - step))
        for column in columns:
            quotient = (upper[column] - lower[column]) / (2 * step * value)
            slope = found.column_slopes[column][0, 0, :, number]
            apart[column].append(np.abs(quotient - slope).max() / (np.abs(slope).max() or 1.0))
        if all(min(of_column) < CLOSE for of_column in apart.values()):
            break
    return {column: min(of_column) for column, of_column in apart.items()}


@pytest.mark.parametrize("key", all_but(FEW, NUMBERS))
def test_columns_move_as_complete_runs_do(key: str) -> None:
    for column, apart in furthest(key, derivatives(FEW if key in FEW else tuple(NUMBERS))).items():
        assert apart < CLOSE, column


@pytest.mark.slow
def test_nothing_that_is_asked_for_is_zero_throughout() -> None:
    """But for what is multiplied by zero."""
    whole = derivatives(tuple(NUMBERS))
    still = {name for name, slopes in zip(whole.names, whole.slopes[0, 0].T, strict=True) if not slopes.any()}
    without = {"plant.vehicle.height", "plant.winch_2.layer_laps", "plant.winch_2.ripple_waves", "plant.creep_2.time"}
    ropes_without_mass = {f"plant.rope_{side}.{name}" for side in (1, 2) for name in ("shortest_mass", "diameter")}
    without |= ropes_without_mass | {f"plant.winch_{side}.transmission_waves" for side in (1, 2)}
    without |= {"plant.vehicle.stribeck_velocity", "plant.track.wavelength", "sensors.load_cell_drift_time"}
    without |= {f"plant.rope_{side}.hysteresis_strain" for side in (1, 2)} | {"actuator.motor.thermal_time"}
    assert still == without


def test_the_columns_are_those_of_the_run(few: Sensitivities) -> None:
    run = simulate(everything())
    for column in COLUMNS:
        assert close(few.columns[column][0, 0], run[column], rel=1e-9, abs=1e-9 * np.abs(run[column]).max())
    assert np.abs(few.errors - few.columns["e"]).max() < 1e-15
    assert close(few.slopes, few.column_slopes["e"], rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("key", ["plant.vehicle.mass", "sensors.position_bias", "disturbance.force.scale"])
def test_figures_of_merit_move_as_those_of_complete_runs(key: str, few: Sensitivities) -> None:
    value, gradients = NUMBERS[key], few.gradients
    for metric in ("mse", "mae", "energy", "continuous_load", "peak_tension"):
        ours = gradients[metric][0, 0, few.names.index(key)]
        ends = [[moved(key, value * (1 + sign * step)).metrics[metric] for sign in (1, -1)] for step in STEPS]
        quotients = [(upper - lower) / (2 * step * value) for step, (upper, lower) in zip(STEPS, ends, strict=True)]
        assert np.abs(np.array(quotients) / ours - 1).min() < 1e-4, metric


MASSES = ("plant.vehicle.mass", "nominal.vehicle.mass")
FORCE_AND_WAY = ("F1", "x")
"""Columns of several tests, which are compiled once."""


@cache
def smooth() -> Experiment:
    """Case 4, by one integrator."""
    return override(case(4), {"simulation.duration": 2.0, "simulation.integrator": "exponential"})


def test_changing_the_machine_and_its_nominal_plant_adds_up() -> None:
    experiment = smooth()
    found = sensitivities(MASSES, [[1e4, 1e4]], [experiment], columns=FORCE_AND_WAY)
    upper, lower = (simulate(override(experiment, {"plant.vehicle.mass": 1e4 * (1 + h)})) for h in (1e-5, -1e-5))
    slope = found.column_slopes["F1"][0, 0].sum(axis=1)
    assert np.abs((upper["F1"] - lower["F1"]) / 0.2 - slope).max() < 1e-3 * np.abs(slope).max()


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["adaptive", "rk4"])
def test_other_integrators(integrator: str) -> None:
    experiment = override(case(4), {"simulation.duration": 2.0, "simulation.integrator": integrator})
    names = ["plant.rope_1.modulus", "plant.winch_2.drum_radius"]
    values = np.array([parameters_of(experiment)[name] for name in names])
    found = sensitivities(names, [values], [experiment], columns=["F2"])
    for number, (name, value) in enumerate(zip(names, values, strict=True)):
        slope, apart = found.column_slopes["F2"][0, 0, :, number], []
        for step in STEPS:
            changes = [{name: value * (1 + sign * step)} for sign in (1, -1)]
            upper, lower = (
                simulate(override(experiment, change), nominal=experiment.plant)["F2"] for change in changes
            )
            apart.append(np.abs((upper - lower) / (2 * step * value) - slope).max() / np.abs(slope).max())
        assert min(apart) < 1e-3, name


VARIED = ("plant.vehicle.mass", "plant.winch_1.radius_error", "sensors.position_noise", "disturbance.current_sigma")


@pytest.mark.slow
@settings(deadline=None, max_examples=10)
@given(values=st.lists(st.floats(0.5, 1.5), min_size=4, max_size=4), along=st.integers(0, 2**32))
def test_any_values_any_direction(values: list[float], along: int) -> None:
    """The derivative along a direction in all numbers at once."""
    experiment = override(everything(), {"disturbance.current_limit": 1.0, "simulation.duration": 1.0})
    at = np.array([NUMBERS[key] for key in VARIED]) * values
    direction = np.random.default_rng(along).normal(size=4) * at

    def run(point: np.ndarray) -> np.ndarray:
        return simulate(override(experiment, dict(zip(VARIED, point.tolist(), strict=True))), nominal=experiment.plant)[
            "x"
        ]

    slope = sensitivities(VARIED, [at], [experiment], columns=["x"]).column_slopes["x"][0, 0] @ direction
    apart = [np.abs((run(at + h * direction) - run(at - h * direction)) / (2 * h) - slope).max() for h in STEPS]
    assert min(apart) < 1e-4 * np.abs(slope).max()


def test_draws_of_an_ensemble_have_their_own_derivatives() -> None:
    smooth = {"sensors.position_resolution": 0.0, "sensors.encoder_counts": 0, "simulation.duration": 2.0}
    smooth |= {"controller.coordination.preload": 5000.0, "simulation.integrator": "exponential"}
    rig = load_ensemble("rig")
    rig = replace(rig, experiment=override(rig.experiment, smooth))
    scenarios, key = [rig.scenario(number, 7) for number in range(2)], "plant.winch_1.radius_error"
    found = sensitivities([key], [[1e-3]], scenarios, columns=["theta_1"])
    for number, scenario in enumerate(scenarios):
        ends = [override(scenario.experiment, {key: 1e-3 + change}) for change in (1e-6, -1e-6)]
        upper, lower = (simulate(end, nominal=scenario.nominal)["theta_1"] for end in ends)
        slope = found.column_slopes["theta_1"][0, number, :, 0]
        assert np.abs((upper - lower) / 2e-6 - slope).max() < 1e-3 * np.abs(slope).max()


SITE = {
    "plant.vehicle.stiction": 0.5,
    "plant.vehicle.stribeck_velocity": 0.02,
    "plant.vehicle.bristle_stiffness": 5e6,
    "plant.vehicle.bristle_damping": 1e5,
    "plant.track.tilt": 1e-3,
    "plant.track.waviness": 1e-3,
    "plant.rope_1.hysteresis": 14.0,
    "plant.rope_1.hysteresis_strain": 4e-6,
    "sensors.load_cell_time_constant": 3e-3,
}


@pytest.mark.slow
def test_friction_slope_and_lag_move_columns_as_complete_runs_do() -> None:
    experiment = override(case(4), {**SITE, "simulation.duration": 1.0, "simulation.substeps": 20})
    found = sensitivities(list(SITE), [list(SITE.values())], [experiment], columns=["x", "F1"])
    for number, (key, value) in enumerate(SITE.items()):
        for column in ("x", "F1"):
            slope, apart = found.column_slopes[column][0, 0, :, number], []
            for step in STEPS:
                ends = (override(experiment, {key: value * (1 + sign * step)}) for sign in (1, -1))
                upper, lower = (simulate(end, nominal=experiment.plant)[column] for end in ends)
                apart.append(np.abs((upper - lower) / (2 * step * value) - slope).max() / np.abs(slope).max())
            assert min(apart) < 5e-3, (key, column)


@pytest.mark.slow
def test_readings_in_steps_are_differentiated_without_their_steps() -> None:
    experiment = override(everything(), {"simulation.duration": 1.0, "sensors.position_resolution": 1e-3})
    found = sensitivities(["sensors.position_bias"], [[2e-3]], [experiment], columns=["x_read", "x"])
    assert np.abs(found.columns["x_read"] / 1e-3 - np.rint(found.columns["x_read"] / 1e-3)).max() < 1e-9
    assert close(found.column_slopes["x_read"], found.column_slopes["x"] + 1, abs=1e-12)


def test_what_ends_early_leaves_the_rest_open() -> None:
    wild = override(smooth(), {"controller.nftsm.eta": 1e300})
    found = sensitivities(MASSES, [[1e4, 1e4]], [wild], columns=FORCE_AND_WAY, stride=3)
    kept = len(found.columns["F1"][0, 0])
    assert kept == -(-smooth().samples // 3)
    assert found.outcomes[0, 0] == "diverged"
    assert np.isnan(found.columns["F1"][0, 0, -1])
    assert np.isnan(found.column_slopes["F1"][0, 0, -1]).all()


REFUSED = {
    "sensors.encoder_counts": "it quantises a reading",
    "sensors.position_resolution": "it quantises a reading",
    "sensors.outage_length": "outages begin and end with samples",
    "sensors.fault_start": "faults begin and end with samples",
    "disturbance.push.start": "overloads begin and end with samples",
    "sensors.outage": "it is a choice or a text",
    "controller.kind": "it is a choice or a text",
    "controller.nftsm.p": "it is a whole number",
    "controller.nominal.mass": "it sets the controller's nominal plant; use nominal.*",
    "disturbance.vortex": "it is a switch",
    "disturbance.force.times": "it is a list",
    "reference.cruise_until": "the reference is computed before a run",
    "simulation.sample_time": "it sets the instants of the samples",
    "simulation.seed": "it is a whole number",
    "simulation.delay_samples": "it is written into the compiled code",
}


@pytest.mark.parametrize(("key", "reason"), REFUSED.items())
def test_what_has_no_derivative_is_refused_with_the_reason(key: str, reason: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        sensitivities([key], [[1.0]], [everything()])
    assert str(caught.value) == f"no sensitivity to '{key}': {reason}"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("plant.vehicle.mas", 1e4, r"unknown parameter 'plant\.vehicle\.mas'; did you mean 'plant\.vehicle\.mass'\?"),
        ("plant.vehicle.mass", -1.0, r"parameters\[0\]: plant\.vehicle\.mass = -1: must be > 0"),
        (
            "disturbance.current_sigma",
            -1.0,
            r"parameters\[0\]: disturbance\.current_sigma = -1\.0: must be .* >= 0 m/s",
        ),
        ("disturbance.current_sigma", 0.0, r"disturbance\.current_sigma = 0: must be > 0 where it varies"),
        ("disturbance.current.scale", 1.0, r"disturbance\.current\.scale: must scale a signal that is given"),
        ("sensors.speed_noise", 0.1, r"sensors\.speed_noise = 0: must be > 0 where it varies"),
    ],
)
def test_wrong_input_is_named(key: str, value: float, message: str) -> None:
    experiment = override(everything(), {"sensors.speed_noise": 0.0})
    with pytest.raises(ConfigurationError, match=message):
        sensitivities([key], [[value]], [experiment])


def test_wrong_columns_and_shapes_are_named() -> None:
    names, values = MASSES, [[1e4, 1e4]]
    with pytest.raises(ConfigurationError, match=r"columns: unknown column 'F3'; did you mean 'F2'\?"):
        sensitivities(names, values, [smooth()], columns=["F3"])
    twice = sensitivities(names, values, [smooth()], columns=["F1", "F1", "x"], stride=500)
    assert twice.columns["x"].max() < 50 < twice.columns["F1"].min()
    with pytest.raises(ConfigurationError, match=r"parameters: shape \(1, 2\) must be \(n, 3\)"):
        sensitivities([*names, "disturbance.force.scale"], values, [everything()])
    with pytest.raises(ConfigurationError, match="names: must be at least one number"):
        sensitivities([], [[]], [everything()])
    with pytest.raises(ConfigurationError, match="scenarios: must be at least one experiment"):
        sensitivities(names, values, [])
