"""Setpoints ahead: what a setpoint guesses of them, and what it knows."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import Departures, Setpoint, no_departures, previewed
from dualwinch.model.reference import Reference, departures, setpoint
from tests.tolerances import close

NOW, TIMES = Setpoint(2.0, 0.5, 0.1), (0.5, 2.0)
T = np.arange(0, 60, 0.01)


def numbers_of(point: Setpoint) -> list[float]:
    return [float(value) for value in (point.x, point.v, point.a)]


def test_a_setpoint_alone_goes_on_with_its_acceleration() -> None:
    assert numbers_of(NOW.ahead(2.0)) == pytest.approx([3.2, 0.7, 0.1])
    assert numbers_of(previewed(NOW, TIMES).ahead(2.0)) == numbers_of(NOW.ahead(2.0))
    assert numbers_of(previewed(NOW, TIMES, no_departures(TIMES)).ahead(0.5)) == numbers_of(NOW.ahead(0.5))


def test_departures_are_added() -> None:
    by = Departures(ca.SX([0.1, 0.2]), ca.SX([0.3, 0.4]), ca.SX([0.5, 0.6]))
    assert numbers_of(previewed(NOW, TIMES, by).ahead(2.0)) == pytest.approx([3.4, 1.1, 0.7])


def test_a_time_that_nobody_asked_for_is_an_error() -> None:
    with pytest.raises(
        ConfigurationError, match=r"setpoint\.ahead\(1\.0\): must be a time of the part's preview, 0\.5, 2"
    ):
        previewed(NOW, TIMES).ahead(1.0)
    with pytest.raises(ConfigurationError, match="preview, none"):
        previewed(NOW, ()).ahead(1.0)


@pytest.fixture(params=["uniform", "jerk-limited", "profile", "jerk-limited profile", "way-points", "file"])
def reference(request: pytest.FixtureRequest, tmp_path: Path) -> Reference:
    path = tmp_path / "motion.csv"
    path.write_text("t,x\n" + "".join(f"{t},{10 - 10 * np.cos(t / 8)}\n" for t in np.arange(0, 20, 0.5)))
    return {
        "uniform": Reference("uniform"),
        "jerk-limited": Reference("uniform", jerk_limit=0.5),
        "profile": Reference("profile"),
        "jerk-limited profile": Reference("profile", jerk_limit=0.05),
        "way-points": Reference("way-points", points=(10.0, 4.0), pauses=(3.0, 1.0), jerk_limit=0.2),
        "file": Reference("file", file=str(path), unit="m"),
    }[request.param]


def test_what_departs_is_what_the_motion_does(reference: Reference) -> None:
    """At all times, the last ones of a run too, and long after the motion has ended."""
    by = departures(T, TIMES, reference)
    for index, time in enumerate(TIMES):
        now, then = setpoint(T, reference), setpoint(T + time, reference)
        assert close(np.asarray(now.x + time * now.v + time**2 / 2 * now.a + by.x[index]), then.x, abs=1e-12)
        assert close(np.asarray(now.v + time * now.a + by.v[index]), np.asarray(then.v), abs=1e-12)
        assert close(np.asarray(now.a + by.a[index]), np.asarray(then.a), abs=1e-12)
