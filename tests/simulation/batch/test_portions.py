import re
from collections.abc import Iterator

import pytest

from dualwinch.codegen.drivers.batch import LANES
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import BLOCKS, in_portions, portion_size
from dualwinch.simulation.paper import case
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.settings import override

SEA = load_ensemble("sea")


def test_portions_hold_every_scenario_once_in_order() -> None:
    sizes = [[scenario.index for scenario in portion] for portion in in_portions(SEA.scenarios(7, 0), 3)]
    assert sizes == [[0, 1, 2], [3, 4, 5], [6]]
    assert list(in_portions([], 3)) == []


def test_an_error_while_drawing_comes_after_the_portions_before_it() -> None:
    def broken() -> Iterator[Scenario]:
        yield from SEA.scenarios(3, 0)
        raise ConfigurationError("the fourth")

    portions = in_portions(broken(), 3)
    assert len(next(portions)) == 3
    with pytest.raises(ConfigurationError, match="the fourth"):
        next(portions)


def test_fewer_threads_where_signals_are_long_and_an_error_where_not_one_fits() -> None:
    assert portion_size(case(4), 4) == (4 * BLOCKS * LANES, 4)
    with pytest.raises(
        ConfigurationError, match=r"simulation\.duration = 1e\+06: must be <= [\d.e+]+ s in an ensemble"
    ) as raised:
        portion_size(override(case(4), {"simulation.duration": 1e6, "simulation.sample_time": 1e-4}), 1)
    longest = float(re.findall(r"<= ([\d.e+]+) s", str(raised.value))[0]) * 0.99
    long = override(case(4), {"simulation.duration": longest, "simulation.sample_time": 1e-4})
    assert portion_size(long, 1000) == (BLOCKS * LANES, 1)
