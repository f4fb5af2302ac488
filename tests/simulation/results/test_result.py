import pytest

from dualwinch.codegen.errors import DualwinchError
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.rows import COLUMNS
from tests.conftest import PaperRun


@pytest.fixture(scope="module")
def result(paper_run: PaperRun) -> Result:
    return paper_run(4, "nftsm")


def test_a_result_is_asked_for_columns_as_a_mapping_is(result: Result) -> None:
    assert "x" in result
    assert "vv" not in result
    assert list(result) == list(result.keys()) == [*COLUMNS, "Z_a", "s"]
    for name, values in dict(result).items():
        assert values is result[name]
    assert "d_hat" not in result


@pytest.mark.parametrize(("name", "near"), [("vv", "v"), ("F_1", "F1"), ("tau1", "tau_1"), (3, ""), (["x"], "")])
def test_an_unknown_column_is_one_line_that_names_the_nearest(result: Result, name: str, near: str) -> None:
    with pytest.raises(KeyError) as caught:
        result[name]
    assert isinstance(caught.value, DualwinchError)
    hint = f"did you mean '{near}'? Must" if near else "must"
    assert str(caught.value).startswith(f"unknown column {name!r}; {hint} be one of t, x, v, ")
