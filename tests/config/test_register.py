"""Registered parts are what built-in ones are to files, command lines and searches."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import annotated_types as at
import pytest

import dualwinch as dw
from dualwinch.config.experiment_file import loads, to_toml
from dualwinch.config.plugins import register
from dualwinch.controllers.registry import ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.part import Part, registries
from dualwinch.model.quantities.quantity import Key, Quantity
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.own_parts import DriftFree, StateFeedback, Watched


def test_a_registered_part_is_known_by_its_kind() -> None:
    before = simulate(override(case(4, law=StateFeedback(6.0)), {"simulation.duration": 0.2}))
    assert register(StateFeedback) is StateFeedback
    values = {"controller.kind": "state-feedback", "controller.state_feedback.bandwidth": 6, "simulation.duration": 0.2}
    experiment = override(case(4), values)
    assert experiment.controller.law == StateFeedback(6.0)
    assert simulate(experiment).metrics == before.metrics
    assert loads(to_toml(experiment)) == experiment
    assert dw.case(4, "state-feedback").controller.law == StateFeedback()
    for part in (DriftFree, Watched):
        register(part)
    own = {"controller.estimator": "drift-free", "controller.coordination.kind": "watched"}
    assert override(experiment, own).controller.estimator == DriftFree()


def test_its_gains_are_known_where_it_is_not_chosen() -> None:
    register(StateFeedback)
    with pytest.raises(ConfigurationError) as caught:
        override(case(4), {"controller.state_feedback.bandwidth": 6})
    assert str(caught.value) == (
        'controller.state_feedback.bandwidth: belongs to controller.kind = "state-feedback", here it is "fando-nftsm"'
    )


def spring(**attributes: Any) -> type:
    """A class that is defined anew at every call, as in a notebook's cell that runs again."""

    @dataclass(frozen=True)
    class Spring(StateFeedback):
        stiffness: Annotated[float, at.Gt(0), Quantity("N/m", "stiffness")] = 5.0
        kind: ClassVar = attributes.get("kind", "spring")

    return Spring


def test_a_part_that_is_defined_again_takes_its_own_place() -> None:
    first, second = register(spring()), spring()
    assert "spring" in describe_parts(case(4))["controller.kind"].choices
    register(second)
    assert POSITION_LAWS["spring"] is second is not first
    assert type(override(case(4), {"controller.kind": "spring"}).controller.law) is second
    assert list(POSITION_LAWS).count("spring") == 1
    register(second)


def test_another_part_cannot_take_a_kind() -> None:
    @dataclass(frozen=True)
    class Namesake(StateFeedback):
        pass

    register(StateFeedback)
    with pytest.raises(ConfigurationError) as caught:
        register(Namesake)
    assert str(caught.value) == (
        f"position law 'state-feedback' is tests.own_parts.StateFeedback; give {__name__}.Namesake a kind of its own"
    )
    assert POSITION_LAWS["state-feedback"] is StateFeedback


def test_choices_are_those_there_are_now() -> None:
    """Descriptions are kept, by what they depend on: another part in the place of one counts too."""
    assert "spring" not in describe_parts(case(4))["controller.kind"].choices
    register(spring())
    assert describe_parts(case(4))["controller.kind"].choices[-1] == "spring"
    POSITION_LAWS._parts.pop("spring")
    register(spring(kind="string"))
    assert describe_parts(case(4))["controller.kind"].choices[-1] == "string"
    with pytest.raises(ConfigurationError, match=r'^controller\.kind = "spring": must be .* or "string" \(a kind of'):
        override(case(4), {"controller.kind": "spring"})


@pytest.mark.parametrize(
    ("kind", "metadata", "key"),
    [
        ("kalman", (Quantity("1/s", "bandwidth"),), "controller.kalman.bandwidth is taken by Kalman"),
        (
            "coordination",
            (Quantity("N", "x"), Key("coordination.preload")),
            "controller.coordination.preload is taken by",
        ),
        ("winch-1", (Quantity("1", "x"), Key("estimator")), "controller.estimator is taken by Controller"),
        ("nominal", (Quantity("1", "x"), Key("kind.x")), "controller.kind is taken by Controller"),
    ],
)
def test_another_parts_key_cannot_be_taken(kind: str, metadata: tuple[Any, ...], key: str) -> None:
    @dataclass(frozen=True)
    class Taking(StateFeedback):
        bandwidth: Annotated[(float, *metadata)] = 1.0  # pyright: ignore[reportInvalidTypeForm]

    Taking.kind = kind
    before = dict(POSITION_LAWS)
    with pytest.raises(ConfigurationError, match="the key ") as caught:
        register(Taking)
    assert str(caught.value).startswith(f"{__name__}.Taking: the key {key}")
    assert dict(POSITION_LAWS) == before


def test_a_shared_group_of_gains_may_be_shared() -> None:
    @dataclass(frozen=True)
    class Slower(dw.Nftsm):
        kind: ClassVar = "slower"

    register(Slower)
    assert override(
        case(4, "nftsm"), {"controller.nftsm.k": 0.25, "controller.kind": "slower"}
    ).controller.law.nftsm.k == (  # pyright: ignore[reportAttributeAccessIssue]
        0.25
    )


@dataclass(frozen=True)
class Lonely(Part):
    kind: ClassVar = "lonely"


@pytest.mark.parametrize("thing", [3, dict, StateFeedback(), Lonely])
def test_only_classes_of_parts_are_registered(thing: Any) -> None:
    with pytest.raises(ConfigurationError, match=r"must (be a class that subclasses|subclass) .*Estimator"):
        register(thing)


def test_a_registry_stands_at_its_base() -> None:
    assert dw.PositionLaw.registry is POSITION_LAWS
    assert StateFeedback.registry is POSITION_LAWS
    assert dw.Estimator.registry is ESTIMATORS
    assert {"position law", "estimator", "coordination"} <= {registry.what for registry in registries()}
    assert Experiment().controller.law.registry is POSITION_LAWS
