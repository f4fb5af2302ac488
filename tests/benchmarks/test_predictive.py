"""The predictive law beside other solvers: what is compared is what the law does."""

import numpy as np
import pytest

from benchmarks.predictive import REFERENCE, TOLERANCE, Programs, casadis, experiment, ours, record
from dualwinch.simulation.settings import override


@pytest.fixture(scope="module")
def programs() -> Programs:
    return record(override(experiment(), {"simulation.duration": 0.6}))


def test_the_laws_forces_are_those_of_an_exact_solver(programs: Programs) -> None:
    exact = programs.forces(casadis(programs, REFERENCE)()[1])
    assert np.abs(programs.after - exact).max() < TOLERANCE * programs.limit
    assert np.abs(programs.after).max() <= programs.limit
    assert (programs.after > 0.99 * programs.limit).mean() > 0.1


def test_what_is_timed_is_the_laws_own_method(programs: Programs) -> None:
    assert programs.forces(ours(programs)()[1]) == pytest.approx(programs.after, rel=1e-9, abs=1e-6)
