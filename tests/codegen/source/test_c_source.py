import subprocess
from pathlib import Path

import casadi as ca
import pytest

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.rollout import rollout_source
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.c_source import c_source
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.paper import CONTROLLERS, case
from tests.codegen.toy import oscillator

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-c", "unit.c", "-o", "unit.o")


def compiles_without_a_warning(source: str, folder: Path) -> None:
    (folder / "unit.c").write_text(source)
    done = subprocess.run([*find_compiler().command, *STRICT], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_closed_loop_compiles_without_a_warning(kind: str, tmp_path: Path) -> None:
    loop = closed_loop(structure_of(case(4, kind)))
    compiles_without_a_warning(rollout_source(loop), tmp_path)


def test_arguments_keep_their_names() -> None:
    source = c_source([oscillator().move])
    assert "static inline void move(" in source
    assert "const double *restrict held" in source
    assert "next_motion[1]=" in source
    assert "arg[" not in source


def test_functions_keep_their_order() -> None:
    x = ca.SX.sym("x")
    double, square = ca.Function("double_it", [x], [2 * x]), ca.Function("square_it", [x], [x**2])
    source = c_source([double, square])
    assert source.index("void double_it(") < source.index("void square_it(")


def test_an_unused_input_makes_no_warning(tmp_path: Path) -> None:
    x, unused = ca.SX.sym("x"), ca.SX.sym("unused")
    function = ca.Function("identity", [x, unused], [x], ["x", "unused"], ["y"])
    main = "int main(void) { double x = 1, y; identity(&x, &x, &y); return y != 1; }\n"
    compiles_without_a_warning(c_source([function]) + main, tmp_path)


def test_functions_of_matrices_are_refused() -> None:
    x = ca.MX.sym("x", 2)
    with pytest.raises(CodegenError, match="expand"):
        c_source([ca.Function("norm", [x], [ca.norm_2(x)])])


def test_an_embedded_call_is_refused() -> None:
    x = ca.SX.sym("x")
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    outer = ca.Function("outer", [x], [inner(x)], ["x"], ["y"])
    with pytest.raises(CodegenError, match="outer"):
        c_source([outer])


def test_sparse_outputs_are_written_in_full() -> None:
    """A structural zero has no statement in CasADi's C: `hoisted` makes outputs dense, so every element is written."""
    source = rollout_source(oscillator())
    for element in range(2):
        assert f"row[{element}]=" in source
        assert f"next_motion[{element}]=" in source
