import math

import numpy as np
import pytest

from dualwinch.codegen.source.operations import PRECISIONS, Precision, literal


def test_literals_keep_guards_against_division_by_zero() -> None:
    assert literal(0.1, "float") == "0.1f"
    assert literal(0.1, "double") == "0.1"
    assert np.float32(literal(1e-100, "float")[:-1]) > 0
    assert np.isfinite(np.float32(literal(-1e100, "float")[:-1]))
    assert literal(0.0, "float") == "0.0f"


@pytest.mark.parametrize("precision", PRECISIONS)
def test_what_is_not_finite_has_its_name_in_c(precision: Precision) -> None:
    named = [literal(value, precision) for value in (math.inf, -math.inf, math.nan)]
    assert named == ["INFINITY", "-INFINITY", "NAN"]
