import re

import numpy as np
import pytest

from benchmarks.embedded.board import BOARDS, measure, missing
from benchmarks.embedded.report import ABOUT, NAME, recorded, wild
from dualwinch.codegen.export.package import c_package
from dualwinch.simulation.blocks import block
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate

pytestmark = [
    pytest.mark.external,
    pytest.mark.skipif(bool(missing()), reason=f"not on this machine: {', '.join(missing())}"),
]

LIMIT = 5000
"""Instructions a step: 10 kHz at 84 MHz then uses less than 60 %, at one instruction a cycle."""


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.name)
def test_float_controller_on_a_microcontroller_is_the_hosts_and_affordable(board) -> None:
    result, controller = simulate(case(4)), block("controller", case(4))
    run = recorded(result, controller)
    inputs = np.concatenate([run, wild(controller, 2000)])
    package = c_package(controller, NAME, ABOUT, "float")
    got = measure(board, package, NAME, inputs, len(controller.outputs), freeze=False)
    names = [variable.name for variable in controller.outputs]
    for name, column, band in (("tau_1", "tau_1", 0.02), ("u_sat", "u_sat", 0.3), ("d_hat", "d_hat", 3e-5)):
        difference = np.abs(got.outputs[: len(run), names.index(name)] - result.columns[column])
        assert 0 < difference.max() < band
    assert np.isfinite(got.outputs).all()
    assert 500 < got.instructions.max() <= LIMIT
    assert got.declared_stack <= 512
    assert 200 < got.stack <= 1024
    assert not [symbol for symbol in got.symbols if re.match(r"__aeabi_(d|f2d)|(exp|pow|tanh|sqrt)$", symbol)]
