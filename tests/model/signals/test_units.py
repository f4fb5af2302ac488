import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.units import factor


@pytest.mark.parametrize(
    ("value", "unit", "si", "expected"),
    [
        (2.0, "kN", "N", 2000.0),
        (36.0, "km/h", "m/s", 10.0),
        (1.0, "kn", "m/s", 1852 / 3600),
        (5.0, "mm", "m", 0.005),
        (3.0, "min", "s", 180.0),
        (7.0, "N", "N", 7.0),
    ],
)
def test_units_are_converted_by_name(value: float, unit: str, si: str, expected: float) -> None:
    assert factor(unit, si) * value == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(("unit", "si"), [("kg", "N"), ("N", "m/s"), ("", "N"), ("KN", "N"), ("m", "s")])
def test_a_unit_of_another_quantity_is_refused(unit: str, si: str) -> None:
    with pytest.raises(ConfigurationError, match=f'^unit "{unit}": must be one of {si}'):
        factor(unit, si)


def test_a_unit_in_other_letters_is_named() -> None:
    with pytest.raises(ConfigurationError, match="did you mean 'kN'"):
        factor("KN", "N")
