"""What is learnt of an encoder: signs and sizes against drums wound by hand, and which sensor it trusts."""

import math

import numpy as np
import pytest

from dualwinch.controllers.estimators.encoder_calibration import (
    Drum,
    DrumGains,
    EncoderKnowledge,
    EncoderPosition,
    Reading,
    TrustGains,
    calibrate,
    fault_odds,
    informed_errors,
    learnt_errors,
    learnt_names,
    regressors,
    tared,
    unknown_errors,
)
from tests.tiers import all_but

T, SIGMA, RADIUS = 1e-3, 6e-4, 0.8
GAINS, TRUST = DrumGains(), TrustGains()
ALL = DrumGains(give=5e-7, sag=0.7)
NAMES = learnt_names(GAINS)
TRUE = {"scale": 1.5e-3, "layers": 4e-6, "zero": -1.2e-3, "excess": 0.07, "sine": 1.1e-4, "cosine": -0.8e-4}
PULL, SAG = 1500.0, 2e-4
"""Tension in N of a rope that is stretched by 3 mm, and its nominal shortening by its sag in m."""


def drum(x: float, direction: float, stretch: float, errors: dict[str, float]) -> Drum:
    """What a drum shows with the vehicle at x: rope in m is R(1 + scale) theta + layers theta²/(4 pi) + run-out."""
    pull = PULL * stretch / 3e-3
    sag = SAG * (PULL / pull) ** 2 if "sag_excess" in errors else 0.0
    wanted, theta = direction * x + (1 + errors["excess"]) * stretch, direction * x / RADIUS
    wanted += errors.get("give", 0.0) * pull - (1 + errors.get("sag_excess", 0.0)) * sag
    for _ in range(60):
        across = errors["sine"] * math.sin(theta) + errors["cosine"] * (math.cos(theta) - 1)
        theta = (wanted + across - errors["layers"] / (4 * math.pi) * theta**2) / (RADIUS * (1 + errors["scale"]))
    shown = theta + errors["zero"] / RADIUS
    return Drum(direction, RADIUS * shown, shown, stretch, sag, pull, 1.0)


def stretch_at(number: int) -> float:
    return 3e-3 + 1e-3 * math.sin(0.01 * number)


def after(
    readings: np.ndarray,
    positions: np.ndarray,
    direction: float,
    errors: dict[str, float],
    gains: DrumGains = GAINS,
) -> tuple[EncoderKnowledge, EncoderPosition]:
    known, position = unknown(gains), EncoderPosition(0.0, 0.0, 0.0, 0.0)
    for number, (reading, x) in enumerate(zip(readings.tolist(), positions.tolist(), strict=True)):
        shown = drum(x, direction, stretch_at(number), errors)
        known = tared(known, shown, 0.0, gains, float(number == 0))
        known, position = calibrate(known, shown, Reading(reading, 1.0, SIGMA), gains, TRUST, T)
    return known, position


def unknown(gains: DrumGains = GAINS) -> EncoderKnowledge:
    return unknown_errors(gains)


@pytest.mark.slow
def test_gathered_readings_count_as_much_as_one_by_one() -> None:
    random = np.random.default_rng(3)
    positions = np.linspace(0, 2, 4001)
    readings = positions + SIGMA * random.standard_normal(len(positions))
    found = {}
    for interval in (1, 4, 8):
        known, position = unknown(), EncoderPosition(0.0, 0.0, 0.0, 0.0)
        for number, (reading, x) in enumerate(zip(readings.tolist(), positions.tolist(), strict=True)):
            shown, due = drum(x, 1.0, stretch_at(number), TRUE), number % interval == 0
            known = tared(known, shown, 0.0, GAINS, float(number == 0))
            known, position = calibrate(known, shown, Reading(reading, 1.0, SIGMA), GAINS, TRUST, T, due)
            assert due or position.shift == 0
        found[interval] = learnt_errors(known, GAINS)
    for interval in (4, 8):
        for name, (value, spread) in found[interval].items():
            assert value == pytest.approx(found[1][name][0], abs=0.1 * spread), name
            assert spread == pytest.approx(found[1][name][1], rel=0.01), name


@pytest.mark.parametrize("direction", all_but([1.0], [1.0, -1.0]))
def test_every_error_is_found_with_its_sign(direction: float) -> None:
    positions = np.linspace(0, 40, 8000)
    known, position = after(positions, positions, direction, TRUE)
    for name, (value, spread) in learnt_errors(known, GAINS).items():
        assert abs(value - TRUE[name]) < spread, name
    assert position.x == pytest.approx(positions[-1], abs=5e-6)
    assert position.odds == 0


@pytest.mark.parametrize("direction", all_but([-1.0], [1.0, -1.0]))
def test_what_a_winch_gives_and_a_sag_are_found_with_their_signs(direction: float) -> None:
    """Give and compliance are told apart by the length they go with, which changes along the track."""
    true = TRUE | {"give": 4e-7, "sag_excess": -0.5}
    positions = np.linspace(0, 40, 8000)
    known, position = after(positions, positions, direction, true, ALL)
    found = learnt_errors(known, ALL)
    assert (
        tuple(found)
        == learnt_names(ALL)
        == ("scale", "layers", "zero", "excess", "give", "sag_excess", "sine", "cosine")
    )
    for name, (value, spread) in found.items():
        assert abs(value - true[name]) < spread, name
    assert position.x == pytest.approx(positions[-1], abs=5e-6)


def test_at_rest_the_scale_stays_as_uncertain_as_it_was() -> None:
    random = np.random.default_rng(5)
    known, position = after(SIGMA * random.standard_normal(3000), np.zeros(3000), 1.0, TRUE)
    spread = learnt_errors(known, GAINS)
    assert spread["scale"][1] == pytest.approx(GAINS.scale, rel=1e-3)
    assert spread["zero"][1] < GAINS.zero / 5
    assert position.x == pytest.approx(0, abs=4 * SIGMA / math.sqrt(3000))


def test_the_start_sets_the_zero() -> None:
    errors = dict.fromkeys(NAMES, 0.0) | {"zero": 0.1}
    known = tared(unknown(), drum(0.0, 1.0, 3e-3, errors), 0.0, GAINS, 1.0)
    values = learnt_errors(known, GAINS)
    assert values["zero"] == (pytest.approx(0.1), pytest.approx(GAINS.zero))
    assert tared(known, drum(0.0, 1.0, 3e-3, errors | {"zero": 0.2}), 0.0, GAINS, 0.0) == known


def test_a_zero_that_position_and_rope_at_the_start_may_explain_is_none() -> None:
    stretch, none = 3e-3, dict.fromkeys(NAMES, 0.0)
    explained = GAINS.tare + 2 * GAINS.compliance * stretch
    for share, set_to in ((0.99, 0.0), (1.01, 1.01 * explained)):
        for sign in (-1, 1):
            errors = none | {"zero": sign * share * explained}
            known = tared(unknown(), drum(0.0, 1.0, stretch, errors), 0.0, GAINS, 1.0)
            assert known.tare == pytest.approx(sign * set_to)


@pytest.mark.parametrize("zero", [-1e-3, 1e-2])
def test_how_far_off_the_start_found_the_zero_is_no_reason_to_trust_the_noise(zero: float) -> None:
    """Of a drum without other errors no more is learnt than of one whose zero is right, noise for noise."""
    none, noise = dict.fromkeys(NAMES, 0.0), np.random.default_rng(2).standard_normal(2000)
    positions = np.linspace(0, 2, 2000)
    right, wrong = (
        after(positions + SIGMA * noise, positions, 1.0, none | {"zero": offset})[1].x for offset in (0.0, zero)
    )
    assert wrong == pytest.approx(right, abs=1e-9)


def test_an_outlier_teaches_nothing_and_a_silent_sensor_takes_no_knowledge_away() -> None:
    positions = np.linspace(0, 4, 2000)
    known, _ = after(positions, positions, 1.0, TRUE)
    shown = drum(4.0, 1.0, 3e-3, TRUE)
    outlier, position = calibrate(known, shown, Reading(5.0, 1.0, SIGMA), GAINS, TRUST, T)
    fading = math.exp(-T / GAINS.memory)
    assert position.used == 0
    assert np.array(outlier.errors.estimate) == pytest.approx(np.array(known.errors.estimate), rel=1e-3)
    assert np.array(outlier.errors.information) == pytest.approx(fading * np.array(known.errors.information))
    silent, position = calibrate(known, shown, Reading(4.0, 0.0, SIGMA), GAINS, TRUST, T)
    assert np.array_equal(silent.errors.estimate, known.errors.estimate)
    assert np.array_equal(silent.errors.information, known.errors.information)
    assert (silent.residual, position.used) == (known.residual, 0)


def test_readings_that_stay_away_show_a_fault_and_are_trusted_in_the_end() -> None:
    """The encoder has jumped by 10 mm: suspect within a tenth of a second, learnt anew within a second or so."""
    positions = np.linspace(0, 4, 2000)
    known, position = after(positions, positions, 1.0, TRUE)
    jumped, odds = TRUE | {"zero": TRUE["zero"] + 0.01}, []
    for _ in range(2000):
        shown = drum(4.0, 1.0, 3e-3, jumped)
        known, position = calibrate(known, shown, Reading(4.0, 1.0, SIGMA), GAINS, TRUST, T)
        odds.append(float(position.odds))
    assert odds[0] == 0
    assert max(odds[:100]) > 5
    assert odds[-1] == 0
    assert position.x == pytest.approx(4.0, abs=SIGMA / 3)


def test_a_fault_begins_where_a_single_reading_could_not_be_so_far_off() -> None:
    assert fault_odds(0.99, 0.0) == fault_odds(-1.9, 3.0) == 0
    assert fault_odds(-1.3, 0.0) == pytest.approx(1)
    assert fault_odds(2.6, 3.0) == pytest.approx(4)


def test_regressors_are_in_deviations_of_a_reading() -> None:
    row = regressors(Drum(1.0, 8.0, 10.0, 3e-3, 2e-4, 1500.0, 1.0), GAINS, SIGMA)
    sizes = np.array([2e-3 * -8.0, 5e-6 * -(100 / (4 * np.pi)), 2e-3, 0.06 * 3e-3, 1e-4 * np.sin(10), -1e-4])
    sizes[-1] *= 1 - np.cos(10)
    assert np.array(row) == pytest.approx(sizes / SIGMA)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_an_encoder_whose_errors_are_known_has_the_exact_position_everywhere(direction: float) -> None:
    errors = TRUE | {"give": 4e-7, "sag_excess": 0.4}
    here = Reading(12.0, 1.0, SIGMA)
    known = informed_errors(unknown(ALL), drum(12.0, direction, 3e-3, errors), errors, here, ALL)
    for x, stretch in ((12.0, 3e-3), (3.0, 4e-3), (40.0, 2e-3)):
        _, position = calibrate(known, drum(x, direction, stretch, errors), Reading(x, 1.0, SIGMA), ALL, TRUST, T)
        assert position.x == pytest.approx(x, abs=5e-6), "second order in the errors"
        assert abs(position.shift) < 1e-9
        assert position.odds == 0
    found = learnt_errors(known, ALL)
    assert found["zero"][0] == pytest.approx(errors["zero"], abs=5e-6)
    assert all(spread < 1e-5 * ALL.compliance for name, (_, spread) in found.items() if name == "excess")
