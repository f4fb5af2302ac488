"""C packages that hold every operation of SX expressions."""

import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from benchmarks.embedded.host import PRECISE, Host, build
from dualwinch.codegen.block import Block, Variable
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.errors import CodegenError, CodegenWarning
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.codegen.source.operations import PRECISIONS, Precision
from tests.codegen.operations import functions, interpreted

ABOUT = Provenance("dualwinch", "test", "2026-01-01")
COMPILERS = [*filter(shutil.which, ("gcc", "clang")), pytest.param("zig", marks=pytest.mark.external)]
AT = np.array([[0.3, 0.7], [-0.4, 2.5], [0.9, -1.5]])
"""Where most operations are defined, so that a package does not refuse the result."""


def block(operations: dict[int, ca.Function]) -> Block:
    """A block without memory: an output for each operation of its two inputs."""
    state, given, unused = ca.SX.sym("state"), ca.SX.sym("input", 2), ca.SX.sym("parameters")
    outputs = ca.vertcat(*(function(given[0], given[1]) for function in operations.values()))
    names = ["state", "input", "parameters"]
    return Block(
        name="operations",
        description="every operation",
        step=ca.Function("step", [state, given, unused], [state, outputs], names, ["next_state", "output"]),
        initial=ca.Function("initial", [unused], [ca.SX(0.0)], ["parameters"], ["state"]),
        states=(Variable("kept", "1", "nothing", 0.0),),
        inputs=(Variable("x", "1", "x", 0.3), Variable("y", "1", "y", 0.7)),
        outputs=tuple(Variable(function.name(), "1", "z", 0.0) for function in operations.values()),
        parameters=(Variable("unused", "1", "nothing", 0.0),),
        sample_time=1.0,
    )


def kept() -> dict[int, ca.Function]:
    """All that a package can hold and that is finite at `AT`."""
    return {
        operation: function
        for operation, function in functions().items()
        if operation != ca.OP_PRINTME and np.isfinite(interpreted(function, AT)).all()
    }


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", COMPILERS)
def test_every_operation_compiles_without_a_warning_and_gives_its_value(
    tmp_path: Path, name: str, precision: Precision
) -> None:
    operations = kept()
    made = block(operations)
    command = find_compiler(name).command
    everything = block({key: function for key, function in functions().items() if key != ca.OP_PRINTME})
    build(tmp_path, c_package(everything, "everything", ABOUT, precision), "everything", command, *PRECISE)
    host = Host(
        build(tmp_path, c_package(made, made.name, ABOUT, precision), made.name, command, *PRECISE),
        made.name,
        made,
        precision,
    )
    assert len(operations) > 40
    for x, y in AT:
        host.input[:] = x, y
        assert host.step() == 0
        at = host.input.astype(float)[np.newaxis]
        wanted = [interpreted(function, at)[0] for function in operations.values()]
        np.testing.assert_allclose(host.output, wanted, rtol=1e-10 if precision == "double" else 1e-6, atol=1e-30)


def test_an_operation_without_c_of_ours_is_casadi_s_in_double_precision(tmp_path: Path) -> None:
    printing = block({ca.OP_PRINTME: functions()[ca.OP_PRINTME]})
    with pytest.warns(CodegenWarning, match="no C of our own for step: there is none for its 'printme'"):
        files = c_package(printing, "operations", ABOUT)
    host = Host(build(tmp_path, files, "operations", [*find_compiler().command]), "operations", printing, "double")
    host.input[:] = 2.0, 3.0
    assert (host.step(), host.output[0]) == (0, 2.0)
    with pytest.raises(CodegenError, match="no C in single precision for step"):
        c_package(printing, "operations", ABOUT, "float")
