"""Values by key: set where they belong, refused in one line where they do not."""

from typing import Any

import pytest

from dualwinch.config.experiment_file import assigned
from dualwinch.config.plugins import register
from dualwinch.config.toml_text import parse_assignment
from dualwinch.controllers.coordinations.force_position import ForcePosition
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.controllers.laws.nftsm import Nftsm, NftsmGains
from dualwinch.controllers.limits import Limits
from dualwinch.model.disturbance import Disturbance, given_signals
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe, owners
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import KEYS_OF_KIND
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import describe_choices, known_keys, leaf_of, override, with_settings
from tests.own_metrics import Room


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("plant.vehicle.mas=3", "did you mean 'plant.vehicle.mass'"),
        ("mass=3", "did you mean 'plant.vehicle.mass'"),
        ("plant.vehicle=3", "plant.vehicle is a table"),
        ("completely.different=1", "unknown key 'completely.different'; the nearest of "),
        ("foo=1", "; dualwinch config prints all"),
        ("plant.vehicle.mass=-1", "plant.vehicle.mass = -1: must be a finite number > 0 kg"),
        ("plant.vehicle.mass=nan", "finite number > 0"),
        ("plant.vehicle.mass=inf", "finite number > 0"),
        ("plant.vehicle.mass=1979-05-27", "plant.vehicle.mass = 1979-05-27: must be a finite number > 0 kg"),
        ("plant.vehicle.mass=07:32:00", "plant.vehicle.mass = 07:32:00: must be a finite number > 0 kg"),
        ("plant.vehicle.mass=heavy", "finite number > 0"),
        ("plant.vehicle.mass=true", "finite number > 0"),
        ("plant.vehicle.mass=[1]", "finite number > 0"),
        ("controller.nftsm.p=5.0", "whole number >= 3"),
        ("simulation.sample_time=0", "> 0 and <= 0.1 s"),
        ("simulation.duration=-3", "simulation.duration = -3: must be a finite number > 0 s"),
        ("simulation.substeps=0", ">= 1 and <= 256"),
        ("reference.kind=unform", '"uniform" or "profile"'),
        ("controller.kind=pid", '"fando-nftsm" or "nftsm" or "pid-cascade"'),
        ("disturbance.vortex=1", "true or false"),
        ("just words", "key=value"),
        ("controller.adrc.control_bandwidth=-7", "controller.adrc.control_bandwidth = -7: must be a finite number"),
    ],
)
def test_wrong_input_is_one_line_that_helps(assignment: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        override(Experiment(), dict([parse_assignment(assignment)]))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_another_law_keeps_what_both_share() -> None:
    """And has its own gains for the rest; back again, what was not shared is at its default."""
    tuned = {"controller.nftsm.beta": 0.2, "controller.auxiliary.k_a": 3, "controller.observer.l0": 9}
    fando = override(case(4), tuned | {"controller.coordination.preload": 3000})
    plain = override(fando, {"controller.kind": "nftsm"})
    assert plain.controller.law == Nftsm(NftsmGains(beta=0.2), AuxiliaryGains(k_a=3.0))
    assert plain.controller.limits == Limits(preload=3000.0)
    again = leaves(override(plain, {"controller.kind": "fando-nftsm"}))
    assert (again["controller.nftsm.beta"], again["controller.observer.l0"]) == (0.2, 5.0)
    assert override(fando, {"controller.kind": "adrc"}).controller.law == Adrc()


def test_another_coordination_keeps_the_gains_of_the_winches() -> None:
    tuned = override(case(4), {"controller.winch_1.kp": 1e-3, "controller.winch_2.kd": 1e-6})
    changed = override(tuned, {"controller.coordination.kind": "force-position", "controller.force_position.band": 50})
    assert changed.controller.coordination == ForcePosition(50.0, WinchGains(kp=1e-3), WinchGains(kd=1e-6))


def test_another_estimator_keeps_the_filters_gains() -> None:
    tuned = override(case(4), {"controller.estimator": "kalman", "controller.kalman.bandwidth": 33})
    changed = override(tuned, {"controller.estimator": "calibrating-kalman"})
    assert leaves(changed)["controller.kalman.bandwidth"] == 33
    assert leaves(changed)["controller.calibration.memory"] == 60


def test_a_part_and_its_gains_may_be_set_at_once_in_any_order() -> None:
    values = {"controller.adrc.control_bandwidth": 7, "controller.kind": "adrc"}
    for given in (values, dict(reversed(values.items()))):
        assert override(case(4), given).controller.law == Adrc(7.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"controller.adrc.control_bandwidth": 7},
            'controller.adrc.control_bandwidth: belongs to controller.kind = "adrc", here it is "fando-nftsm"',
        ),
        (
            {"controller.kind": "adrc", "controller.nftsm.beta": 0.1},
            'controller.nftsm.beta: belongs to controller.kind = "fando-nftsm" or "nftsm", here it is "adrc"',
        ),
        (
            {"controller.kalman.bandwidth": 7},
            (
                'controller.kalman.bandwidth: belongs to controller.estimator = "kalman" or "calibrating-kalman" or '
                '"self-calibrating-kalman", here it is "lowpass"'
            ),
        ),
        (
            {"controller.coordination.kind": "master-slave", "controller.winch_1.kp": 1e-3},
            (
                'controller.winch_1.kp: belongs to controller.coordination.kind = "differential-tension" or '
                '"proportional-tension" or "scheduled-preload" or "force-position", here it is "master-slave"'
            ),
        ),
    ],
)
def test_a_gain_of_a_part_that_is_not_chosen_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        override(case(4), values)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("number", "values", "key", "kind", "here"),
    [
        (4, {"reference.points": [10.0, 20.0]}, "points", "way-points", "profile"),
        (4, {"reference.file": "motion.csv"}, "file", "file", "profile"),
        (1, {"reference.accelerate_until": 3.0}, "accelerate_until", "profile", "uniform"),
        (4, {"reference.kind": "way-points", "reference.column": "x"}, "column", "file", "way-points"),
    ],
)
def test_a_value_of_another_kind_of_motion_is_refused(
    number: int, values: dict[str, Any], key: str, kind: str, here: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        override(case(number), values)
    assert str(caught.value) == f'reference.{key}: belongs to reference.kind = "{kind}", here it is "{here}"'


def test_defaults_of_other_kinds_of_motion_are_accepted() -> None:
    given = leaves(case(4)).items()
    values = {key: value for key, value in given if key.startswith("reference.") and value is not None}
    assert override(case(4), values).reference == case(4).reference


def test_gains_that_do_not_count_are_told() -> None:
    values = {"controller.adrc.control_bandwidth": 7, "controller.nftsm.beta": 0.1}
    experiment, idle = with_settings(case(4), values)
    assert idle == ["controller.adrc.control_bandwidth"]
    assert experiment == override(case(4), {"controller.nftsm.beta": 0.1})


def test_all_keys_are_settable_where_they_count() -> None:
    """With another value than the default where there is one: it arrives, and nothing else changes.

    But for signals, whose file, or times and values, only go together: test_signal_files sets those.
    """
    register(Room)
    together = {f"disturbance.{name}.{field}" for name in given_signals(Disturbance()) for field in ("times", "values")}
    for key, leaf in known_keys().items():
        if key in together or leaf.marks & {Mark.FILE, Mark.DIGEST}:
            continue
        if len(leaf.choices) == 1 and Mark.PARTS not in leaf.marks:
            continue
        choice, kinds = owners(Experiment, key)
        own = [kind for kind, names in KEYS_OF_KIND.items() if key in {f"reference.{name}" for name in names}]
        choice, kinds = ("reference.kind", own) if own else (choice, kinds)
        base = override(Experiment(), {choice: kinds[0]} if kinds else {})
        before = leaves(base)
        kinds_of_parts = [leaf.choices] if Mark.PARTS in leaf.marks else leaf.choices
        for value in [*kinds_of_parts, True, False, 3, 7, 0.25, 0.05, (3.0, 7.0), "km"]:
            if leaf.admits(value) and value != before[key]:
                changed = leaves(override(base, {key: value}))
                assert changed[key] == value
                if not leaf.choices:
                    assert {name for name in changed if changed[name] != before[name]} == {key}
                break
        else:
            pytest.fail(f"{key}: nothing to set it to")


def test_the_keys_that_choose_parts() -> None:
    assert list(describe_choices(Experiment())) == [
        "plant.rope_1.kind",
        "plant.rope_2.kind",
        "controller.estimator",
        "controller.kind",
        "controller.coordination.kind",
        "actuator.kind",
        "metrics",
    ]


def test_what_a_key_is() -> None:
    assert leaf_of("plant.vehicle.mass").quantity.unit == "kg"
    assert (
        leaf_of("controller.adrc.control_bandwidth", case(4))
        == describe(Experiment)["controller.adrc.control_bandwidth"]
    )
    with pytest.raises(ConfigurationError, match=r"^controller\.adrc is a table; its keys are control_bandwidth, obs"):
        leaf_of("controller.adrc")


def test_a_pattern_stands_for_all_keys_that_are_like_it() -> None:
    assert assigned(["plant.rope_*.damping=300", "plant.rope_2.damping=400"]) == {
        "plant.rope_1.damping": 300,
        "plant.rope_2.damping": 400,
    }
    assert assigned(["plant.vehicle.mass=1e4", "plant.vehicle.mass=10000"]) == {"plant.vehicle.mass": 1e4}
    with pytest.raises(ConfigurationError, match=r"plant\.rope_\*\.damp: no key is like this"):
        assigned(["plant.rope_*.damp=300"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["controller.kind=pid-cascade", "controller.kind=nftsm"],
            'controller.kind: is given twice, as "pid-cascade" a',
        ),
        (["plant.rope_2.damping=400", "plant.rope_*.damping=300"], "plant.rope_2.damping: is given twice, as 400 and "),
        (["plant.rope_*.damping=1", "plant.rope_*.damping=2"], "plant.rope_1.damping: is given twice, as 1 and 2; "),
        (["disturbance.seed=1", "simulation.seed=2"], "simulation.seed: is given twice"),
    ],
)
def test_a_key_that_is_given_two_values_is_refused(words: list[str], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        assigned(words)
    assert str(caught.value).startswith(message)
