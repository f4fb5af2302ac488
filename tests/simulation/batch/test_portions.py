import re

import pytest

from dualwinch.codegen.drivers.batch import LANES
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import BLOCKS, portion_size
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override


def test_fewer_threads_where_signals_are_long_and_an_error_where_not_one_fits() -> None:
    assert portion_size(case(4), 4) == (4 * BLOCKS * LANES, 4)
    with pytest.raises(
        ConfigurationError, match=r"simulation\.duration = 1e\+06: must be <= [\d.e+]+ s in an ensemble"
    ) as raised:
        portion_size(override(case(4), {"simulation.duration": 1e6, "simulation.sample_time": 1e-4}), 1)
    longest = float(re.findall(r"<= ([\d.e+]+) s", str(raised.value))[0]) * 0.99
    long = override(case(4), {"simulation.duration": longest, "simulation.sample_time": 1e-4})
    assert portion_size(long, 1000) == (BLOCKS * LANES, 1)
