import pytest

from dualwinch.controllers.laws.auxiliary import AuxiliaryGains, auxiliary_update


def test_without_excess_it_decays() -> None:
    Z_a = 100.0
    for _ in range(1000):
        Z_a = auxiliary_update(Z_a, 0.0, AuxiliaryGains(k_a=2.0), 1e-3)
    assert Z_a == pytest.approx(100 * 0.998**1000)


def test_a_constant_excess_settles_at_excess_over_k_a() -> None:
    Z_a = 0.0
    for _ in range(20_000):
        Z_a = auxiliary_update(Z_a, 500.0, AuxiliaryGains(k_a=2.0), 1e-3)
    assert Z_a == pytest.approx(250)
