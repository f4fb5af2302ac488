"""The contract of every position law."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate, PositionOutput
from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from tests.conftest import PaperRun

kinds = st.sampled_from(list(POSITION_LAWS))


def first_output(kind: str, x: float, v: float, a: float = 0.0, d: float = 0.0, **limits: float) -> PositionOutput:
    """What a law gives in its first sample at x_ref = 0, v_ref = 0."""
    law, estimate = POSITION_LAWS[kind](), Estimate(x, v, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0, d)
    return law.step(law.initial_state(), estimate, Setpoint(0.0, 0.0, a), Context(Plant(), Limits(**limits), 1e-3))[1]


@given(kinds, st.floats(-5, 5), st.floats(-3, 3), st.floats(0, 3000))
def test_the_saturated_force_is_the_force_within_the_limit(kind: str, x: float, v: float, reserve: float) -> None:
    output = first_output(kind, x, v, reserve=reserve)
    limit = 5800 - reserve
    assert output.u_sat == min(max(output.u, -limit), limit)


@given(kinds, st.floats(0.01, 5))
def test_at_rest_behind_the_reference_it_pulls_forward(kind: str, behind: float) -> None:
    assert first_output(kind, -behind, 0.0).u > 0 > first_output(kind, behind, 0.0).u


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_on_the_reference_at_rest_it_asks_for_nothing(kind: str) -> None:
    assert first_output(kind, 0.0, 0.0).u == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("kind", [kind for kind in POSITION_LAWS if kind not in {"pid-cascade", "mpc"}])
def test_a_law_with_a_nominal_model_takes_off_what_the_estimator_knows_and_adds_what_is_asked(kind: str) -> None:
    still = first_output(kind, 0.02, 0.1).u
    assert first_output(kind, 0.02, 0.1, d=0.05).u == pytest.approx(still - 1e4 * 0.05)
    assert first_output(kind, 0.02, 0.1, a=0.05).u == pytest.approx(still + 1e4 * 0.05)


def test_a_kind_is_its_name_in_the_registry_and_figures_tell_them_apart() -> None:
    laws = POSITION_LAWS.values()
    assert [law.kind for law in laws] == list(POSITION_LAWS)
    assert len({law.label for law in laws}) == len({law.colour for law in laws}) == len(laws)


@pytest.mark.parametrize("number", [2, 4])
@pytest.mark.parametrize(
    ("kind", "steady", "largest"),
    [
        ("adrc", 1e-3, 2e-3),
        ("eid", 0.3e-3, 0.7e-3),
        ("lqi", 0.25e-3, 0.6e-3),
        ("rbf-sliding-mode", 0.3e-3, 0.7e-3),
        ("super-twisting", 0.2e-3, 0.5e-3),
    ],
)
def test_laws_beside_the_papers_track_well_and_do_not_chatter(
    kind: str, steady: float, largest: float, number: int, paper_run: PaperRun
) -> None:
    """Steady mean |e|, Case 4: 0.54, 0.26, 0.19, 0.26, 0.095 mm; FANDO-NFTSM 3.7 mm; with the gains they come with."""
    result, paper = paper_run(number, kind), paper_run(number, "fando-nftsm")
    assert (result.outcome, result.metrics.slack_share) == ("completed", 0)
    assert result["F1"].min() >= 199
    assert result.metrics.steady_mae < steady
    assert result.metrics.max_abs_error < largest
    assert result.metrics.chatter < 1.1 * paper.metrics.chatter
