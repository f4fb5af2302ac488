"""The search space: what may be asked for, what it comes to, and what is refused."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.tuning.space import (
    ContinuousDimension,
    RatioDimension,
    Space,
    entry_from,
    space_from,
    space_of,
    space_to_record,
)
from dualwinch.tuning.tuning_problem import _entries
from tests.studies import MakeProblem

BETA, POWER = "controller.nftsm.beta", "controller.nftsm.p/q"


def space(*texts: str, kind: str = "fando-nftsm") -> Space:
    return space_of(dict(map(entry_from, texts)), case(4, kind))


TUNABLE = {key for key, leaf in describe(Experiment).items() if leaf.tunable}


@pytest.mark.parametrize(
    ("kind", "estimator"), [(kind, "kalman" if kind == "fando-nftsm" else "lowpass") for kind in POSITION_LAWS]
)
def test_every_search_range_is_allowed_and_holds_its_default(kind: str, estimator: str) -> None:
    """The metadata beside a gain must agree with its own bounds, else the default space would be refused."""
    experiment = override(case(4, kind), {"controller.estimator": estimator})
    gains = leaves(experiment)
    for key in TUNABLE & gains.keys():
        try:
            dimension = space_of({key: {}}, experiment).dimensions[0]
        except ConfigurationError as error:
            assert any(words in str(error) for words in ("has no effect", "is 0 at the start"))  # noqa: PT017
        else:
            assert dimension.holds(dimension.start(gains))


def test_gains_of_other_parts_are_no_dimensions() -> None:
    for key in TUNABLE - leaves(case(4)).keys():
        with pytest.raises(ConfigurationError, match="has no effect"):
            space_of({key: {}}, case(4))


def test_without_entries_every_standard_gain_in_use_is_searched_with_tied_winches() -> None:
    names = space_of({}, override(case(4), {"controller.estimator": "kalman"})).names
    assert {BETA, "controller.observer.l0", "controller.kalman.bandwidth", "controller.winch.kp"} <= set(names)
    assert not any(
        name.startswith(("controller.pid_cascade", "controller.winch_1", "controller.adrc")) for name in names
    )
    assert "controller.pid_cascade.kp1" in space_of({}, case(4, "pid-cascade")).names


def test_bounds_come_from_the_gain_and_can_be_overridden() -> None:
    assert space(BETA).dimensions == (
        ContinuousDimension(BETA, (BETA,), 0.005, 5.0, log=True, unit="m^(p/q-1)/s^(p/q)"),
    )
    assert space(f"{BETA}=0.01:0.1:linear").dimensions[0] == ContinuousDimension(
        BETA, (BETA,), 0.01, 0.1, log=False, unit="m^(p/q-1)/s^(p/q)"
    )
    assert space("controller.nftsm.smoothing=1e-6:1e-3:log").names == ("controller.nftsm.smoothing",)


def test_winches_are_tied_or_separate() -> None:
    tied = space("controller.winch.kp")
    assert tied.keys == ("controller.winch_1.kp", "controller.winch_2.kp")
    assert tied.parameters({"controller.winch.kp": 1e-4}) == [1e-4, 1e-4]
    assert space("controller.winch_1.kp", "controller.winch_2.kp").names == tied.keys


def test_a_table_stands_for_its_standard_gains() -> None:
    assert space("controller.nftsm").names == (
        BETA, "controller.nftsm.eta", "controller.nftsm.k", "controller.nftsm.phi",
    )  # fmt: skip


def test_pairs_are_whole_numbers_in_settings_and_sorted_by_ratio() -> None:
    pairs = space(f"{POWER}=9/5,11/9,5/3")
    assert isinstance(pairs.dimensions[0], RatioDimension)
    assert pairs.dimensions[0].choices == ("11/9", "5/3", "9/5")
    assert pairs.settings({POWER: "9/5"}) == {"controller.nftsm.p": 9, "controller.nftsm.q": 5}
    assert pairs.start(leaves(case(4))) == {POWER: "5/3"}
    assert pairs.nearest({POWER: "7/5"}) == {POWER: "11/9"}


@given(st.lists(st.floats(0, 1), min_size=4, max_size=4))
def test_points_are_within_bounds_and_survive_encoding(shares: list[float]) -> None:
    searched = space(BETA, "controller.winch.kd", POWER, "controller.coordination.preload=900:1100")
    point = searched.decoded(shares)
    for dimension in searched.dimensions:
        assert dimension.holds(point[dimension.name])
    again = searched.decoded(searched.encoded(point))
    assert searched.parameters(again) == pytest.approx(searched.parameters(point), rel=1e-12, abs=1e-18)


def test_a_space_survives_its_record_and_says_how_another_differs() -> None:
    ours = space(BETA, POWER)
    assert space_from(space_to_record(ours)) == ours
    assert ours.difference(ours) == ""
    other = space(f"{BETA}=0.01:5:log", "controller.observer.l0")
    difference = other.difference(ours)
    assert "controller.observer.l0 only here" in difference
    assert f"{POWER} only there" in difference
    assert f"{BETA} is 0.01 to 5" in difference


def test_a_file_gives_entries(tmp_path: Path) -> None:
    file = tmp_path / "space.toml"
    file.write_text(
        f'[space]\n{BETA} = {{ lower = 0.01, upper = 1.0 }}\ncontroller.observer.l0 = true\n"{POWER}" = ["7/5"]\n'
    )
    entries = _entries([str(file), f"{BETA}=0.02:2"])
    assert entries == {BETA: {"lower": 0.02, "upper": 2.0}, "controller.observer.l0": {}, POWER: ["7/5"]}
    file.write_text("[spaec]\n")
    with pytest.raises(ConfigurationError, match="must contain one table"):
        _entries([str(file)])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("controller.nftsm.bta", "unknown gain 'controller.nftsm.bta'; did you mean 'controller.nftsm.beta'?"),
        ("plant.vehicle.mass=1:2", "unknown gain 'plant.vehicle.mass'"),
        ("controller.pid_cascade.kp1", "has no effect with controller.kind = 'fando-nftsm'"),
        ("controller.kalman.bandwidth", "has no effect"),
        (f"{BETA}=5:1", "lower = 5 must be < upper = 1"),
        (f"{BETA}=-1:1:log", "must be > 0 on a log scale"),
        (f"{BETA}=-1:1:linear", "bound -1 must be > 0"),
        (f"{BETA}=1", "must be NAME=LOWER:UPPER"),
        (f"{BETA}=1:inf", "bounds must be finite numbers"),
        (f"{BETA}=1:2:cubic", "the scale must be log or linear"),
        ("controller.coordination.tension_min", "has no bounds of its own"),
        (f"{POWER}=4/3", "'4/3' must be two odd numbers"),
        (f"{POWER}=3/5", "'3/5' must be two odd numbers"),
        ("controller.pid_cascade", "space: is empty"),
    ],
)
def test_wrong_entries_are_one_line(text: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        space(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_gain_that_is_left_out_at_zero_needs_a_start_above_zero() -> None:
    damping = "controller.winch_1.damping"
    message = "space: {0}: is 0 at the start, where the loop leaves it out; set it above 0 first, e.g. {1}"
    with pytest.raises(ConfigurationError) as caught:
        space(f"{damping}=1:100:log")
    assert str(caught.value) == message.format(damping, f"--set {damping}=10")
    with pytest.raises(ConfigurationError) as caught:
        space("controller.winch.damping=1:100:log")
    sets = f"--set {damping}=10 --set controller.winch_2.damping=10"
    assert str(caught.value) == message.format("controller.winch.damping", sets)
    entries = dict([entry_from(f"{damping}=1:100:log")])
    assert space_of(entries, override(case(4), {damping: 10.0})).names == (damping,)


def test_one_key_in_two_dimensions_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"winch_1\.kp is in both"):
        space("controller.winch.kp", "controller.winch_1.kp")


def test_a_start_outside_of_the_space_is_refused(make_problem: MakeProblem) -> None:
    with pytest.raises(ConfigurationError, match=r"infeasible start: controller\.nftsm\.beta = 0\.05 is outside"):
        make_problem(space=[f"{BETA}=0.1:5:log"])
    moved = make_problem(space=[f"{BETA}=0.1:5:log"], settings=["simulation.duration=0.1", f"{BETA}=0.2"])
    assert moved.start == {BETA: 0.2}
    assert moved.paper_point == {BETA: 0.1}  # the paper's 0.05, as near as the space allows


def test_bounds_that_do_not_go_together_are_refused_before_the_search(make_problem: MakeProblem) -> None:
    space = ["controller.coordination.preload=800:10000", "controller.coordination.tension_min=100:500"]
    with pytest.raises(ConfigurationError, match=r"space: inconsistent bounds: .*preload = 800: must be > 1000"):
        make_problem(space=space).check()
    make_problem(space=[space[0], "controller.coordination.tension_min=100:399"]).check()
