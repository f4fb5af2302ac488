"""Formulas as the site shows them; where Sphinx is not installed (group ``docs``) there is no site."""

import pytest

pytest.importorskip("sphinx")
pytest.importorskip("latex2mathml")

from sphinx.errors import ExtensionError

from docs.generated.mathematics import mathml

pytestmark = pytest.mark.external


def test_aligned_lines_are_a_table() -> None:
    assert mathml(r"\begin{aligned} a &= b, \\ c &= d \end{aligned}", "block").count("<mtr>") == 2


def test_bars_of_an_absolute_value_do_not_stretch() -> None:
    text = mathml(r"\lvert e\rvert = |e|", "inline")
    assert text.count('<mo stretchy="false" lspace="0" rspace="0">|</mo>') == 4


@pytest.mark.parametrize("formula", [r"a \nonsense b", "a & b"])
def test_what_has_no_mathml_is_an_error(formula: str) -> None:
    with pytest.raises(ExtensionError, match="no MathML"):
        mathml(formula, "inline")
