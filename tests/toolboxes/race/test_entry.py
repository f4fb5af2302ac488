"""Who takes part: kinds that are asked for, combinations, names that tell them apart, and ablations."""

import numpy as np
import pytest

from dualwinch.controllers.laws.nftsm import NftsmGains, odd_power
from dualwinch.controllers.registry import ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.race.entries import (
    CONSTANT_GAIN,
    LINEAR_SURFACE,
    NO_ANTI_SATURATION,
    PAPER_LAW,
    RaceEntry,
    ablations,
    combinations,
    kinds,
    names,
)
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.tuning_problem import tuning_problem


def test_kinds_are_all_or_some_or_the_usual_one_each_once() -> None:
    assert kinds("all", POSITION_LAWS, ["adrc"]) == list(POSITION_LAWS)
    assert kinds(None, ESTIMATORS, ["kalman"]) == ["kalman"]
    assert kinds(["adrc", "nftsm", "adrc"], POSITION_LAWS, []) == ["adrc", "nftsm"]
    assert kinds(["adrc", "all"], POSITION_LAWS, []) == ["adrc", *(kind for kind in POSITION_LAWS if kind != "adrc")]
    with pytest.raises(ConfigurationError, match="unknown position law 'adcr'; did you mean 'adrc'"):
        kinds(["adcr"], POSITION_LAWS, [])
    with pytest.raises(ConfigurationError, match=r"no kind is given; known: fando-nftsm, .*, or all"):
        kinds([], POSITION_LAWS, ["adrc"])


def test_names_say_what_most_do_not_have() -> None:
    one = combinations(["adrc", "nftsm"], ["kalman"], ["master-slave"])
    assert list(names(one).values()) == ["adrc", "nftsm"]
    more = combinations(["adrc"], ["kalman", "none"], ["master-slave"])
    assert list(names(more).values()) == ["adrc, kalman", "adrc, none"]
    both = [*combinations(["adrc"], ["kalman", "none"], ["master-slave", "force-position"]), *one]
    assert names(both)[both[1].key] == "adrc, force-position"
    assert names(both)[both[2].key] == "adrc, none"
    different = {entry.key: entry for entry in both}
    assert (
        len(set(names(list(different.values())).values())) == len({entry.stem for entry in both}) == len(different) == 5
    )
    assert all(set(entry.stem) <= set("abcdefghijklmnopqrstuvwxyz0123456789+-") for entry in both)


def of(entry: RaceEntry) -> TuningProblem:
    settings = [f"{key}={value}" for key, value in entry.values.items()]
    return tuning_problem(ensemble="sea", settings=settings, excluded=entry.excluded)


def test_ablations_are_settings_that_are_held() -> None:
    entries = {entry.variant: entry for entry in ablations("kalman", "differential-tension") if entry.variant}
    assert set(entries) == {CONSTANT_GAIN, NO_ANTI_SATURATION, LINEAR_SURFACE}
    whole = of(RaceEntry(PAPER_LAW, "kalman", "differential-tension"))
    for entry in entries.values():
        problem = of(entry)
        assert not set(entry.excluded) & set(problem.space.keys)
        assert set(problem.space.keys) == set(whole.space.keys) - set(entry.excluded)
        values = leaves(problem.tuned(problem.start))
        assert {key: values[key] for key in entry.settings} == entry.settings
        prepare(problem.experiment)


def test_a_constant_gain_is_constant_and_without_anti_saturation_its_state_does_not_count() -> None:
    """On motors that are too weak, so that there is something to saturate."""
    entries = {entry.variant: entry for entry in ablations("none", "differential-tension") if entry.law == PAPER_LAW}
    weak = {"controller.coordination.tension_max": 1100.0, "simulation.duration": 10.0}

    def run(variant: str, **more: float) -> Result:
        return simulate(override(Experiment(), weak | entries[variant].values | more))

    fast = {"controller.auxiliary.k_a": 50.0}
    assert np.ptp(run(CONSTANT_GAIN)["L1"]) == 0 < np.ptp(run("")["L1"])
    assert np.array_equal(run(NO_ANTI_SATURATION)["u"], run(NO_ANTI_SATURATION, **fast)["u"])
    assert not np.array_equal(run("")["u"], run("", **fast)["u"])


def test_the_linear_surface_is_linear_within_three_hundredths_of_a_per_cent() -> None:
    (entry,) = (each for each in ablations("none", "differential-tension") if each.variant == LINEAR_SURFACE)
    ratio = entry.settings["controller.nftsm.p"] / entry.settings["controller.nftsm.q"]
    smoothing = NftsmGains().smoothing
    errors = np.geomspace(smoothing, 1.0, 50).tolist()
    for exponent in (ratio, 2 - ratio):
        powers = [float(odd_power(error, exponent, smoothing)) for error in errors]
        assert powers == pytest.approx(errors, rel=3e-4)
