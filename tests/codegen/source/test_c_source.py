import subprocess
from pathlib import Path

import casadi as ca
import pytest

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.rollout import rollout_source
from dualwinch.codegen.errors import CodegenError, CodegenWarning
from dualwinch.codegen.source.c_source import c_source
from dualwinch.codegen.source.hoist import hoisted
from dualwinch.codegen.source.operations import Style
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
    assert "const double *restrict hold" in source
    assert "next_motion[1]=" in source


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


def generated(function: ca.Function) -> str:
    """CasADi's own text of a function."""
    generator = ca.CodeGenerator("generated.c")
    generator.add(function)
    return generator.dump()


def test_functions_of_matrices_are_casadi_s() -> None:
    x = ca.MX.sym("x", 2)
    with pytest.warns(CodegenWarning, match="no C of our own for norm: it is no function of SX expressions"):
        source = c_source([ca.Function("norm", [x], [ca.norm_2(x)])])
    assert "static inline void norm(" in source


def test_an_embedded_call_is_casadi_s_text_untouched() -> None:
    x, p = ca.SX.sym("x"), ca.SX.sym("parameters")
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    outer = ca.Function("outer", [x, p], [inner(x) / p], ["x", "parameters"], ["y"])
    with pytest.warns(CodegenWarning, match="^no C of our own for outer: there is none for its 'call'; CasADi's"):
        source = c_source([outer])
    renamed = ca.Function("generated_outer", [x, p], [outer(x, p)], ["x", "parameters"], ["y"])
    assert generated(renamed) in source
    derive, lean = hoisted(outer)
    assert (derive.numel_out(), lean.numel_in("derived")) == (0, 0)


def test_the_style_of_casadi_takes_its_text_of_everything() -> None:
    x = ca.SX.sym("x", 2)
    function = ca.Function("f", [x], [x[0] ** 2 / 3 + ca.tanh(x[1])], ["x"], ["y"])
    source = c_source([function], Style(generator="casadi"))
    renamed = ca.Function("generated_f", [x], [function(x)], ["x"], ["y"])
    assert generated(renamed) in source


def test_casadi_s_text_is_in_double_precision_only() -> None:
    x = ca.SX.sym("x")
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    with pytest.raises(CodegenError, match="no C in single precision for outer: there is none for its 'call'"):
        c_source([ca.Function("outer", [x], [inner(x)], ["x"], ["y"])], Style("float"))


def test_sparse_arguments_are_refused() -> None:
    """What is not stored has no instruction, and would keep what was there before."""
    x = ca.SX.sym("x", 2)
    zero_below = ca.Function("zero_below", [x], [ca.vertcat(x[0], ca.SX(1, 1))], ["x"], ["y"])
    with pytest.raises(CodegenError, match="y is sparse"):
        c_source([zero_below])


def test_sparse_outputs_are_written_in_full() -> None:
    """A structural zero has no instruction: `hoisted` makes outputs dense, so every element is written."""
    source = rollout_source(oscillator())
    for element in range(2):
        assert f"row[{element}]=" in source
        assert f"next_motion[{element}]=" in source
