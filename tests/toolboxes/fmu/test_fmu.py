"""FMUs of a block that knows nothing of winches, and the words of the model description."""

import shutil
import subprocess
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree as ET

import casadi as ca
import pytest

from dualwinch.codegen.block import Block, Variable
from dualwinch.codegen.errors import CodegenError
from dualwinch.toolboxes.fmu.build import archive, build_fmu, fmu_source, host_platform
from dualwinch.toolboxes.fmu.description import About, base_powers
from dualwinch.toolboxes.fmu.model import fmu_model

ABOUT = About("tested 1.0", 2.0)
SANITISERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]


VALGRIND = ["--quiet", "--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=all"]


def spring(*, sampled: bool = False) -> Block:
    """A mass on a spring, stepped by Euler; the output answers the force at once only where it is sampled."""
    state, force, parameters = ca.SX.sym("state", 2), ca.SX.sym("input", 1), ca.SX.sym("parameters", 2)
    x, v = ca.vertsplit(state)
    stiffness, stretch = ca.vertsplit(parameters)
    slope = ca.vertcat(v, force - stiffness * x)
    output = ca.vertcat(stiffness * x, *([force] if sampled else []))
    three, names = [state, force, parameters], ["state", "input", "parameters"]
    return Block(
        name="spring",
        description="mass & spring",
        step=ca.Function("step", three, [state + 0.01 * slope, output], names, ["next_state", "output"]),
        initial=ca.Function("initial", [parameters], [ca.vertcat(stretch, 0)], ["parameters"], ["state"]),
        states=(Variable("queue.0.x", "m", "position", 0.5), Variable("queue.0.v", "m/s", "speed", 0.0)),
        inputs=(Variable("force", "N", "force", 0.0, -5.0, 5.0),),
        outputs=(Variable("pull", "N", "pull", 1.0), *([Variable("told", "N", "force", 0.0)] if sampled else [])),
        parameters=(Variable("stiffness", "N/m", "stiffness", 2.0, 0.0), Variable("stretch", "m", "at start", 0.5)),
        sample_time=0.01,
        derivative=None if sampled else ca.Function("derivative", three, [slope, output], names, ["dx", "output"]),
    )


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("kg/m^3", {"kg": 1, "m": -3}),
        ("N m/(N s)", {"m": 1, "s": -1}),
        ("N s/m", {"kg": 1, "s": -1}),
        ("(rad/s^2)/s", {"rad": 1, "s": -3}),
        ("1/s", {"s": -1}),
        ("N m s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("m^(1/2)/s", None),
        ("furlong", None),
    ],
)
def test_units_are_powers_of_the_base_units(unit: str, powers: dict[str, int] | None) -> None:
    assert base_powers(unit) == powers


@pytest.mark.parametrize("version", [2, 3])
def test_what_others_say_of_a_variable_is_text_that_xml_can_hold(version: int) -> None:
    wild = 'a\x00b\x1b\n<c> "d" & \ud800\ufffe|'
    made = spring()
    made = replace(made, inputs=(replace(made.inputs[0], unit=wild, description=wild),), description=wild)
    root = ET.fromstring(build_fmu(fmu_model(made, version), (), ABOUT)["modelDescription.xml"])  # noqa: S314
    kept = r"""a\x00b\x1b\n<c> "d" & \ud800\ufffe|"""
    assert root.get("description") == kept
    assert [unit.get("name") for unit in root.iter("Unit") if "a" in unit.attrib["name"]] == [kept]
    (force,) = (variable for variable in root.iter() if variable.get("name") == "force")
    assert force.get("description") == kept


def test_model_description_names_what_depends_on_what() -> None:
    root = ET.fromstring(build_fmu(fmu_model(spring(), 3), (), ABOUT)["modelDescription.xml"])  # noqa: S314
    reference = {variable.get("name"): variable.get("valueReference") for variable in root.find("ModelVariables") or ()}
    name_of = {value: name for name, value in reference.items()}
    structure = root.find("ModelStructure")
    assert structure is not None
    found = {
        (unknown.tag, name_of[unknown.get("valueReference")]): {
            name_of[i] for i in (unknown.get("dependencies") or "").split()
        }
        for unknown in structure
    }
    assert found["Output", "pull"] == {"state.queue[0].x"}
    assert found["ContinuousStateDerivative", "der(state.queue[0].v)"] == {"force", "state.queue[0].x"}
    assert found["InitialUnknown", "pull"] == {"stiffness", "stretch"}


def test_the_same_block_gives_the_same_bytes_and_another_one_another_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []
    for folder in ("one", "other"):
        monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(tmp_path / folder))
        made.append(archive(build_fmu(fmu_model(spring()), (host_platform(),), ABOUT)))
    assert made[0] == made[1]
    names = zipfile.ZipFile(BytesIO(made[0])).namelist()
    assert names[:2] == ["modelDescription.xml", "sources/spring.c"]
    assert names[2].startswith(f"binaries/{host_platform().name}/spring.")
    other = replace(spring(), parameters=(replace(spring().parameters[0], start=3.0), spring().parameters[1]))
    assert fmu_source(fmu_model(spring()))[1] != fmu_source(fmu_model(other))[1]


def test_what_cannot_be_an_fmu_is_refused() -> None:
    with pytest.raises(CodegenError, match="FMI version 1: must be 2 or 3"):
        fmu_model(spring(), 1)
    with pytest.raises(CodegenError, match="must be co-simulation, model-exchange, both"):
        fmu_model(spring(), 2, "shared")
    with pytest.raises(CodegenError, match="must be co-simulation"):
        fmu_model(spring(sampled=True), 2, "both")
    twice = replace(spring(), inputs=(Variable("pull", "N", "force", 0.0),))
    with pytest.raises(CodegenError, match="two variables of spring are called pull"):
        build_fmu(fmu_model(twice), (), ABOUT)


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("judge", ["sanitizers", pytest.param("valgrind", marks=pytest.mark.external)])
def test_c_is_clean_under_sanitizers_and_valgrind(version: int, sampled: bool, judge: str, tmp_path: Path) -> None:
    gcc, valgrind = shutil.which("gcc"), shutil.which("valgrind")
    if gcc is None or (judge == "valgrind" and valgrind is None):
        pytest.skip("needs gcc with its sanitizers, or valgrind")
    harness = (Path(__file__).parent / f"fmu{version}_main.c").read_text()
    (tmp_path / "unit.c").write_text(fmu_source(fmu_model(spring(sampled=sampled), version))[0] + harness)
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "-g"]
    flags, before = (SANITISERS, []) if judge == "sanitizers" else ([], [valgrind, *VALGRIND])
    subprocess.run([gcc, *strict, *flags, "unit.c", "-o", "unit", "-lm"], cwd=tmp_path, check=True)
    done = subprocess.run([*before, str(tmp_path / "unit")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
