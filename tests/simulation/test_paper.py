"""What can be asked of the paper's cases, and what the errors say."""

from typing import Any

import numpy as np
import pytest

from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import CASES, CONTENTS, FIGURES, case


def test_every_case_with_every_controller() -> None:
    for number in CASES:
        for kind in POSITION_LAWS:
            asked = case(number, kind)
            assert asked.controller.law.kind == kind
            assert asked.reference.kind == ("uniform" if number in {1, 3} else "profile")
            assert asked.disturbance.vortex == (number > 2)
    assert case(int(np.int64(4))) == case(np.int64(4)) == case(4)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("number", [0, 5, -1, "4", 4.0, True, None, [4], np.nan])
def test_a_case_that_is_not_there(number: Any) -> None:
    with pytest.raises(ConfigurationError) as caught:
        case(number)
    assert str(caught.value) == f"case {number!r}: must be 1, 2, 3 or 4"


@pytest.mark.parametrize(
    ("controller", "near"),
    [
        ("bang-bang", "m"),
        ("nftms", r"did you mean 'nftsm'\? M"),
        ("ADRC", r"did you mean 'adrc'\? M"),
        (3, "m"),
        (["nftsm"], r"did you mean 'nftsm'\? M"),
    ],
)
def test_an_unknown_controller_fails_at_once_and_names_the_nearest(controller: Any, near: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^unknown position law .*; {near}ust be one of fando-nftsm, "):
        case(4, controller)


def test_figures_are_numbered_as_in_the_paper() -> None:
    assert [figure.number for figure in FIGURES] == list(range(5, 21))
    assert (FIGURES[0].case, FIGURES[0].content) == (1, "trajectory")
    assert (FIGURES[13].number, FIGURES[13].case, FIGURES[13].content) == (18, 4, "error")
    assert len(FIGURES) == len(CASES) * len(CONTENTS)
