"""Logs that cannot be, each refused in one line that says what is wrong."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.diagnostics import check_log, other_reasons
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log
from dualwinch.toolboxes.identification.options import DEFAULTS
from dualwinch.toolboxes.identification.resample import sections_of
from tests.toolboxes.identification.conftest import logged, machine


def changed(**columns: np.ndarray) -> Log:
    whole = logged(machine())
    return replace(whole, columns={**whole.columns, **columns})


def columns(*names: str) -> tuple[np.ndarray, ...]:
    return tuple(logged(machine()).columns[name] for name in names)


def test_columns_that_never_change_are_refused() -> None:
    still = np.full_like(logged(machine()).t, 5.0)
    with pytest.raises(ConfigurationError, match="run: tau_1, tau_2: never change, and torques drive the fit"):
        check_log(changed(tau_1=still, tau_2=still), machine())
    check_log(changed(tau_2=still), machine())
    with pytest.raises(ConfigurationError, match=r"run: F1: is 5 in every row; name another column \(--column F1=NAME"):
        check_log(changed(F1=still), machine())


def test_units_that_cannot_be_are_refused() -> None:
    x, tau, theta, F1 = columns("x", "tau_1", "theta_1", "F1")
    for wrong in ({"x": 1e3 * x}, {"tau_1": 1e3 * tau}, {"theta_1": np.degrees(theta)}, {"F1": 1e3 * F1}):
        (name,) = wrong
        message = rf"run: {name} = \S+: must be \S+ to \S+ on this machine; is it in another unit \(--column {name}="
        with pytest.raises(ConfigurationError, match=message):
            identify([changed(**wrong)], ["plant.vehicle.mass"], machine())
    check_log(logged(machine()), machine())


@pytest.mark.parametrize(
    ("name", "by", "words"),
    [
        ("v", 1e3, r"v moves 1e\+03 times as far as x: is it in mm/s \(--column v=NAME:mm/s\)"),
        ("v", -1.0, r"v moves -1 times as far as x: is it in -m/s"),
        ("theta_2", 1 / (2 * np.pi), "theta_2 moves 0.159 times as far as x: is it in rev"),
        ("theta_1", 2.5, "theta_1 moves 2.5 times as far as x: is it in another unit, or of the motor"),
        ("tau_1", -1.0, "tau_1 holds -.* and F1 reads .*: is tau_1 of the opposite sign"),
        ("tau_2", 1e-3, r"tau_2 holds .* N on average.*: is tau_2 in kN m \(--column tau_2=NAME:kN m\)"),
    ],
)
def test_the_column_that_does_not_fit_the_others_is_named(name: str, by: float, words: str) -> None:
    with pytest.raises(ConfigurationError, match=f"run: {words}"):
        check_log(changed(**{name: by * columns(name)[0]}), machine())


def test_times_in_other_units_are_named() -> None:
    log = logged(machine())
    with pytest.raises(ConfigurationError, match=r"v moves 1e\+03 times as far as x: is t in ms \(--column t=NAME:ms"):
        check_log(replace(log, t=1e3 * log.t), machine())


def test_torques_that_change_faster_than_they_are_logged_are_named() -> None:
    log = logged(machine())
    slow = log.rows(slice(None, None, 5))
    sections = sections_of([slow], machine())
    assert "or its torques change faster than they were logged, every 5 ms" in other_reasons(
        [replace(sections[0], inputs=sections[0].inputs * [1, 30, 30, 1, 1, 1] - [0, 400, 400, 0, 0, 0])], machine()
    )
    assert other_reasons(sections_of([log], machine()), machine()) == "or its torques are late"


@pytest.mark.parametrize(
    ("key", "gone"),
    [
        ("plant.winch_1.ripple_angle", ()),
        pytest.param("sensors.load_cell_zero_1", ("F1",), marks=pytest.mark.slow),
        pytest.param("disturbance.strouhal", (), marks=pytest.mark.slow),
    ],
)
def test_a_key_that_other_values_fix_is_refused(key: str, gone: tuple[str, ...]) -> None:
    """No ripple has no angle, no load cell no zero; vortices that are off shed at no frequency."""
    calm = machine(disturbance__vortex=False, simulation__duration=8.0)
    whole = logged(calm)
    log = replace(whole, columns={name: each for name, each in whole.columns.items() if name not in gone})
    with pytest.raises(ConfigurationError, match=f"--fit {key}: nothing in these logs depends on it"):
        identify([log], ["plant.vehicle.mass", key], calm)


WORDS = (
    r"run: (an unrecorded force of \S+ N on the vehicle would|unrecorded torques of \S+ N m would|"
    r"\w+: its residual is \S+|\S+ = \S+ is far from what was expected).*it is of another machine"
)


@pytest.mark.slow
def test_a_refusal_of_a_plain_fit_says_that_alternatives_may_explain_the_log() -> None:
    truth = {f"plant.winch_{end}.drum_radius": 0.6 for end in (1, 2)}
    log = logged(override(machine(simulation__duration=4.0), truth))
    with pytest.raises(
        ConfigurationError, match=f"{WORDS}.*; without --plain, alternatives to that machine are compared"
    ):
        identify([log], ["plant.vehicle.mass"], machine(), plain=True)


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "duration"),
    [
        ({"plant.winch_1.gear_ratio": 24.0, "plant.winch_2.gear_ratio": 24.0}, 20.0),
        *(
            pytest.param({f"plant.{key.format(end)}": value for end in (1, 2)}, 4.0, marks=pytest.mark.slow)
            for key, value in {"winch_{}.drum_radius": 0.6, "winch_{}.inertia": 20.0, "rope_{}.modulus": 3e10}.items()
        ),
    ],
)
def test_a_log_of_another_machine_is_refused_with_what_is_left(truth: dict[str, float], duration: float) -> None:
    """Which of its four signs shows first, a model that is far off decides, and not what is off.

    Few steps and delays: searches for a machine that does not exist go on to their largest number.
    """
    nominal = machine(simulation__duration=duration)
    few = replace(DEFAULTS, search=replace(DEFAULTS.search, max_iterations=12, max_delay_samples=2))
    with pytest.raises(ConfigurationError, match=WORDS):
        identify([logged(override(nominal, truth))], ["plant.vehicle.mass"], nominal, options=few)


@pytest.mark.nightly
@pytest.mark.slow
def test_friction_of_the_drums_that_stands_for_another_gear_is_refused_unless_it_is_accepted() -> None:
    log = logged(override(machine(), {"plant.winch_1.gear_ratio": 24.0, "plant.winch_2.gear_ratio": 24.0}))
    refusal = r"run: plant.winch_\d.coulomb_friction = \S+ is far from .*\(--fit plant.winch_\d.coulomb_friction\)"
    with pytest.raises(ConfigurationError, match=refusal):
        identify([log], ["plant.vehicle.mass"], machine())
    accepted = identify([log], ["plant.vehicle.mass"], machine(), unrecorded=0.9)
    assert any("may stand for something that the model lacks" in note for note in accepted.notes)


@pytest.mark.slow
def test_a_share_that_is_given_lets_such_a_log_pass_and_says_what_the_model_lacks() -> None:
    log, gear = (
        logged(override(machine(), {"plant.winch_1.gear_ratio": 24.0, "plant.winch_2.gear_ratio": 24.0})),
        "torques",
    )
    with pytest.raises(ConfigurationError, match=r"run: unrecorded torques of .* \(--unrecorded \d+% accepts it\)"):
        identify([log], ["plant.vehicle.mass"], machine(), plain=True)
    found = identify([log], ["plant.vehicle.mass"], machine(), unrecorded=0.9, plain=True)
    assert any(f"{gear} of" in note and "the model lacks something" in note for note in found.notes)
    assert "the model lacks something" in repr(found)
    with pytest.raises(ConfigurationError, match="unrecorded = 0: must be > 0"):
        identify([log], ["plant.vehicle.mass"], machine(), unrecorded=0)


def by(**factors: float) -> Log:
    """The log, with some columns times a factor."""
    log = logged(machine())
    columns = {name: factors.get(name, 1.0) * values for name, values in log.columns.items()}
    return replace(log, t=factors.get("t", 1.0) * log.t, columns=columns)


def only(log: Log, *names: str) -> Log:
    return replace(log, columns={name: log.columns[name] for name in ("tau_1", "tau_2", *names)})


def marked(name: str, value: float) -> Log:
    values = columns(name)[0].copy()
    values[[70, 90]] = value
    return changed(**{name: values})


@pytest.mark.parametrize(
    ("log", "words"),
    [
        (
            lambda: only(by(t=1e3), "x"),
            r"t: has a row every 1 s: must be 2e-06 to 0.5 s; .*--column t=NAME:ms\)",
        ),
        (lambda: only(by(t=1e6), "x"), r"t: has a row every 1e\+03 s: .*NAME:us"),
        (lambda: only(by(t=1 / 3600), "x"), r"t: has a row every 2.78e-07 s: .*NAME:h"),
        (lambda: by(t=1 / 60), r"v moves 0.0167 times as far as x: is t in min \(--column t=NAME:min\)\?"),
        (lambda: by(x=0.01), r"x moves 0.01 times as far as theta_1: is"),
        (
            lambda: changed(v=np.sin(40 * logged(machine()).t), theta_1=-columns("theta_1")[0]),
            "theta_1 moves -1 times as far as",
        ),
        (lambda: only(by(x=-0.1, v=0.1), "x", "v"), r"v moves -1 times as far as x: is it in -m/s .* or x in -m "),
        (
            lambda: marked("x", -9999),
            r"x = -9999 in row 71 \(t = 0.07 s\) and 1 others: must be .* a mark for a gap \(leave",
        ),
        (
            lambda: marked("v", 1e30),
            r"v = 1e\+30 in row 71 .*: must be -50 to 50 on this machine; is it a mark for a gap",
        ),
        (lambda: marked("omega_1", -9999), r"omega_1 = -9999 in row 71"),
        (
            lambda: marked("F1", -9999),
            r"F1 = -9999 in row 71 \(t = 0.07 s\) and 1 others: must be -1.2e\+03 to .* a mark for a gap",
        ),
    ],
)
def test_times_signs_and_marks_of_gaps_are_named(log: Callable[[], Log], words: str) -> None:
    with pytest.raises(ConfigurationError, match=f"run: {words}"):
        check_log(log(), machine())


def test_columns_that_changed_places_are_named() -> None:
    F1, F2 = columns("F1", "F2")
    with pytest.raises(ConfigurationError, match=r"tau_1 holds .* and F1 reads .*: have F1 and F2 .*changed places\?"):
        check_log(changed(F1=F2, F2=F1), machine())


def test_sides_that_changed_places_are_named_although_they_pull_alike_on_average() -> None:
    """There and back again, under a preload that is far above the drag."""
    there_and_back = {"reference__kind": "way-points", "reference__points": (10.0, 0.0), "reference__speed": 1.0}
    nominal = machine(**there_and_back, reference__acceleration=0.5, simulation__duration=25.0)
    log = logged(nominal)
    check_log(log, nominal)
    for one, other in (("tau_1", "tau_2"), ("F1", "F2")):
        swapped = replace(log, columns={**log.columns, one: log.columns[other], other: log.columns[one]})
        with pytest.raises(
            ConfigurationError, match=r"F1 reads less than F2: have F1 and F2 or tau_1 and tau_2 changed"
        ):
            check_log(swapped, nominal)


def test_a_load_cell_that_swings_below_zero_marks_no_gaps() -> None:
    """Its lowest readings have neighbours, and do not stand out."""
    (F1,) = columns("F1")
    swing = F1.copy()
    swing[1000:1200] -= (F1[1000:1200] + 1500.0) * np.sin(np.linspace(0, np.pi, 200))
    assert swing.min() < -1400
    check_log(changed(F1=swing), machine())


def test_a_pause_is_no_way() -> None:
    log = logged(machine())
    late = np.arange(len(log.t)) >= len(log.t) // 2
    check_log(replace(log, t=log.t + 600.0 * late), machine())


def test_a_log_without_a_number_in_its_position_is_refused_and_what_was_noticed_is_said() -> None:
    zero = np.zeros_like(logged(machine()).t)
    gap = zero + np.nan
    with pytest.raises(ConfigurationError, match="run: x: has no value in any row: must have a position or an encoder"):
        only(changed(x=gap), "x", "v")
    check_log(changed(x=gap, F1=gap), machine())
    still = replace(changed(tau_1=zero, tau_2=zero), notes=("run: 9 of 10 are words",))
    with pytest.raises(ConfigurationError, match=r"torques drive the fit \(noticed: 9 of 10 are words\)"):
        check_log(still, machine())
