import subprocess
from pathlib import Path

import pytest

import dualwinch as dw
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.errors import CodegenError
from dualwinch.export import export_c
from dualwinch.model.errors import ConfigurationError
from dualwinch.toolboxes.server.plant import ServedPlant, ServerSettings


def built(folder: Path, precision: str = "double") -> Path:
    """The exported controller of Case 4 as a program."""
    export_c(dw.case(4), folder, precision=precision, udp=True)
    command = [*find_compiler().command, "-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-ffp-contract=off"]
    subprocess.run([*command, "udp.c", "dualwinch_controller.c", "-lm", "-o", "udp"], cwd=folder, check=True)
    return folder / "udp"


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_exported_controller_gives_the_run_of_simulate(precision: str, tmp_path: Path) -> None:
    program = built(tmp_path, precision)
    plant = ServedPlant(dw.case(4), ServerSettings(lockstep=True, may_write=True))
    with subprocess.Popen([program, "127.0.0.1", str(plant.port)], stdout=subprocess.PIPE, text=True) as process:
        result = plant.serve()
        said, _ = process.communicate(timeout=120)
    plant.release()
    assert process.returncode == 0
    assert said == "50000 samples, 0 with a status other than OK\n"
    assert result is not None
    expected = dw.simulate(dw.case(4))
    if precision == "double":
        assert result["x"] == pytest.approx(expected["x"], abs=1e-9)
    assert result.metrics["mse"] == pytest.approx(expected.metrics["mse"], rel=1e-9 if precision == "double" else 0.05)


def test_an_option_is_answered_by_the_usage(tmp_path: Path) -> None:
    program = built(tmp_path)
    for words in (["--help"], ["127.0.0.1", "1", "2"]):
        done = subprocess.run([program, *words], capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert done.stderr == f"usage: {program} [HOST] [PORT]        (default: 127.0.0.1 47800)\n"


def test_a_controller_with_other_inputs_is_refused(tmp_path: Path) -> None:
    ahead = dw.case(4, "mpc")
    if not ahead.controller.preview:
        pytest.skip("it does not look ahead")
    with pytest.raises(CodegenError, match="x_ref_ahead_1 is not sent by `dualwinch serve`"):
        export_c(ahead, tmp_path, udp=True)


def test_only_a_controller_can_be_connected(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="udp: must be off for the plant"):
        export_c(dw.case(4), tmp_path, block="plant", udp=True)
