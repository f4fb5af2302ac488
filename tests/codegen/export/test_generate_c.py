"""C by CasADi's own code generator, compiled and loaded as a CasADi user does."""

import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import dualwinch as dw
from dualwinch.cli import main
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.errors import CodegenError
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.blocks import BLOCKS, block


def compiled(source: Path) -> str:
    """The shared library of a file, by the system's compiler; its path."""
    library = source.with_suffix(".so")
    command = [*find_compiler().command, "-O0", "-ffp-contract=off", "-shared", "-fPIC", source, "-o", library, "-lm"]
    subprocess.run(command, check=True)
    return str(library)


def test_without_an_experiment_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="source: must be an Experiment or a Function, not NoneType"):
        dw.generate_c(None, tmp_path / "c")  # pyright: ignore[reportArgumentType]
    assert not (tmp_path / "c").exists()


def test_every_function_of_an_experiment_is_found_by_external(tmp_path: Path) -> None:
    experiment = dw.case(4)
    files = dw.generate_c(experiment, tmp_path)
    assert {path.name for path in files} == {"dualwinch.c", "dualwinch.h", "variables.json"}
    library = compiled(tmp_path / "dualwinch.c")
    for name in BLOCKS:
        made = block(name, experiment)
        point = [[variable.start for variable in vector] for vector in (made.states, made.inputs, made.parameters)]
        external = ca.external(f"{made.name}_step", library)
        assert external.name_in() == made.step.name_in()
        for ours, theirs in zip(external(*point), made.step(*point), strict=True):
            np.testing.assert_array_equal(np.array(ours), np.array(theirs))
        np.testing.assert_array_equal(
            np.array(ca.external(f"{made.name}_initial", library)(point[2])), np.array(made.initial(point[2]))
        )


def test_a_function_of_the_user_s_own(tmp_path: Path) -> None:
    x = ca.MX.sym("x", 2)
    table = ca.interpolant("table", "bspline", [[0, 1, 2, 3, 4]], [0, 1, 4, 9, 16])
    function = ca.Function("mine", [x], [table(ca.norm_2(x))], ["x"], ["y"])
    files = dw.generate_c(function, tmp_path, header=False)
    assert files == [tmp_path / "mine.c"]
    external = ca.external("mine", compiled(tmp_path / "mine.c"))
    np.testing.assert_array_equal(np.array(external([1.0, 2.0])), np.array(function([1.0, 2.0])))


def test_the_text_is_casadi_s(tmp_path: Path) -> None:
    function = dw.plant()
    dw.generate_c(function, tmp_path, main=True, mex=True)
    generator = ca.CodeGenerator(f"{function.name()}.c", {"with_header": True, "main": True, "mex": True})
    generator.add(function)
    (tmp_path / "theirs").mkdir()
    generator.generate(f"{tmp_path / 'theirs'}/")
    for file in (f"{function.name()}.c", f"{function.name()}.h"):
        assert (tmp_path / file).read_text() == (tmp_path / "theirs" / file).read_text()
    assert "mexFunction" in (tmp_path / f"{function.name()}.c").read_text()


def test_what_casadi_does_not_generate_is_refused(tmp_path: Path) -> None:
    x = ca.MX.sym("x")
    with pytest.raises(CodegenError, match="no C for root: Code generation not supported for Newton"):
        dw.generate_c(ca.rootfinder("root", "newton", {"x": x, "g": x**2 - 2}), tmp_path)


def test_on_the_command_line(tmp_path: Path) -> None:
    main(["export", "c", "--generator", "casadi", "--block", "plant", "--mex", "--out", str(tmp_path)])
    text = (tmp_path / "dualwinch.c").read_text()
    assert "int plant_step(" in text
    assert "controller_step" not in text
    assert "mexFunction" in text
