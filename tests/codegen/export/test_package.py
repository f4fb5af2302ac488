"""C packages against CasADi's interpreter, over whole runs and random states."""

import re
import shutil
import subprocess
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from benchmarks.embedded.host import PRECISE, STRICT, Host, build
from benchmarks.embedded.report import recorded
from dualwinch.codegen.block import Block
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.export.package import Provenance, c_package, frozen, prepared
from dualwinch.codegen.source.operations import PRECISIONS, Precision
from dualwinch.controllers.controller import POSITION_LAWS
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from tests.stepping import interpreted, plausible, values
from tests.tiers import all_but

ABOUT = Provenance("dualwinch", "test", "2026-01-01")


@cache
def of(what: str) -> Block:
    return block(what, case(4))


def position(block: Block, vector: str, name: str) -> int:
    return [variable.name for variable in getattr(block, vector)].index(name)


@pytest.fixture(scope="module")
def hosts(tmp_path_factory):
    """(what, precision, freeze) → a new instance of that package."""
    libraries = {}

    def new(what: str, precision: Precision = "double", *, freeze: bool = False) -> Host:
        made, key = of(what), (what, precision, freeze)
        if key not in libraries:
            package = c_package(made, made.name, ABOUT, precision, freeze=freeze)
            folder = tmp_path_factory.mktemp(f"{made.name}-{precision}")
            flags = PRECISE if precision == "float" else ()
            libraries[key] = build(folder, package, made.name, find_compiler().command, *flags)
        return Host(libraries[key], made.name, made, precision, freeze=freeze)

    return new


@pytest.mark.parametrize("number", [1, *(pytest.param(number, marks=pytest.mark.slow) for number in (2, 3, 4))])
def test_whole_runs_are_those_of_simulate_and_every_step_is_the_interpreters(hosts, number: int) -> None:
    experiment = case(number)
    plant, controller = hosts("plant"), hosts("controller")
    blocks = {"plant": of("plant"), "controller": of("controller")}
    plant.parameters[position(blocks["plant"], "parameters", "disturbance.vortex")] = experiment.disturbance.vortex
    assert (plant.prepare(), plant.reset()) == (0, 0)
    references = exogenous_signals(experiment)[:, :3]
    measured = [position(blocks["plant"], "outputs", name) for name in ("x", "v", "F1", "F2")]
    sensed = np.array(measured) + len(blocks["plant"].states)
    before = {name: np.empty((len(references), len(made.states))) for name, made in blocks.items()}
    given = {name: np.empty((len(references), len(made.inputs))) for name, made in blocks.items()}
    after = {name: np.empty((len(references), len(made.states + made.outputs))) for name, made in blocks.items()}
    for k, reference in enumerate(references):
        controller.input[:4], controller.input[4:] = plant.state[sensed], reference
        for name, host in (("controller", controller), ("plant", plant)):
            before[name][k], given[name][k] = host.state[: len(blocks[name].states)], host.input
            if name == "plant":
                host.input[:2] = given[name][k, :2] = controller.output[:2]
            assert host.step() == 0
            after[name][k] = host.state
    columns = simulate(experiment).columns
    for name, tolerance in (("x", 1e-9), ("v", 1e-9), ("theta_1", 1e-9), ("omega_2", 1e-8)):
        ours = before["plant"][:, position(blocks["plant"], "states", name)]
        np.testing.assert_allclose(ours, columns[name], rtol=0, atol=tolerance)
    for name, every in (("controller", 1), ("plant", 50)):
        parameters = {"plant": plant, "controller": controller}[name].parameters
        expected = interpreted(blocks[name], before[name][::every], given[name][::every], parameters)
        np.testing.assert_allclose(after[name][::every], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("what", "freeze"), [("controller", False), ("controller", True), ("plant", False), ("closed-loop", False)]
)
def test_random_states_give_what_the_interpreter_gives(hosts, what: str, freeze: bool) -> None:
    made, host = of(what), hosts(what, freeze=freeze)
    states, inputs = plausible(made, 1000)
    expected = interpreted(made, states, inputs, values(made.parameters))
    got = np.empty_like(expected)
    for k, (state, given) in enumerate(zip(states, inputs, strict=True)):
        host.state[: len(state)], host.input[:] = state, given
        assert host.step() == 0
        got[k] = host.state
    tolerance = 1e-9 if freeze else 1e-12  # constants fold: products of parameters round in another order
    np.testing.assert_allclose(got, expected, rtol=tolerance, atol=tolerance)


def test_single_precision_stays_within_its_band_over_case_4(hosts) -> None:
    result, made = simulate(case(4)), of("controller")
    outputs = hosts("controller", "float").run(recorded(result, made))
    for name, band in (("tau_1", 0.02), ("u_sat", 0.3), ("d_hat", 3e-5)):
        worst = np.abs(outputs[:, position(made, "outputs", name)] - result.columns[name]).max()
        assert 0 < worst < band


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("estimator", ["lowpass", "kalman"])
def test_parameters_have_their_effect_when_prepared_and_only_then(
    tmp_path: Path, estimator: str, precision: Precision
) -> None:
    made = block("controller", with_leaves(case(4), {"controller.estimator": estimator}))
    source = c_package(made, made.name, ABOUT, precision)
    library = build(tmp_path, source, made.name, find_compiler().command, *(PRECISE if precision == "float" else ()))
    host, names = Host(library, made.name, made, precision), [variable.name for variable in made.parameters]
    states, inputs = plausible(made, 60)
    relative, absolute = {"double": (1e-12, 1e-12), "float": (1e-3, 0.1)}[precision]  # forces are sums of some 1e5 N
    known, whole = host.parameters.copy(), {"controller.nftsm.p", "controller.nftsm.q"}
    for k, (state, given) in enumerate(zip(states, inputs, strict=True)):
        host.parameters[k % len(names)] *= 1.0 if names[k % len(names)] in whole else 0.99
        if k % 3 == 0:
            assert host.prepare() == 0
            known = host.parameters.copy()
        host.state[: len(state)], host.input[:] = state, given
        assert host.step() == 0
        expected = interpreted(made, state[None], given[None], known.astype(float))[0]
        np.testing.assert_allclose(host.state, expected, rtol=relative, atol=absolute)


@pytest.mark.parametrize("estimator", [*ESTIMATORS])
def test_a_sample_computes_only_what_changes_at_a_sample(estimator: str) -> None:
    """Prepared parameters cost hardly more than constants: the Riccati equation of a filter is not there."""
    made = block("controller", with_leaves(case(4), {"controller.estimator": estimator}))
    apart, constant = prepared(made, "double"), frozen(made).step
    parameters, derived = ca.SX.sym("parameters", len(made.parameters)), ca.SX.sym("derived", apart.derived)
    step = apart.step.call([*(apart.step.sx_in(index) for index in range(2)), parameters, derived])
    fixed = ca.vertcat(parameters, derived)
    assert not ca.extract_parametric(ca.vertcat(*step), fixed)[1]  # nothing that depends on the parameters alone
    assert apart.step.n_nodes() < 1.4 * constant.n_nodes()


def test_steps_refuse_parameters_that_were_never_prepared(hosts) -> None:
    host = hosts("controller")
    host.step()
    before = host.prepared.copy()
    for wrong in (np.nan, np.inf, -np.inf):
        host.parameters[7] = wrong
        assert host.prepare() == 2
        np.testing.assert_array_equal(host.prepared.view(np.uint64), before.view(np.uint64))
        assert host.step() == 0  # goes on with what was good
    good = host.state.copy()
    for never in (0, 255, 90):
        host.prepared.view(np.uint8)[:] = never
        assert host.step() == 2
        np.testing.assert_array_equal(host.state, good)
    assert host.reset() == 2
    assert np.isfinite(host.state).all()


def test_every_parameter_outside_its_bounds_is_refused_and_the_old_values_remain(hosts) -> None:
    host, made = hosts("controller"), of("controller")
    defaults, before = host.parameters.copy(), host.prepared.copy()
    assert host.checksum() == zlib.crc32(defaults.tobytes())
    wrong = {position(made, "parameters", "controller.nftsm.p"): [4.0, 5.5, 3.0]}  # odd, whole, > q
    for number, each in enumerate(made.parameters):
        below = each.lower if each.exclusive else np.nextafter(each.lower, -np.inf)
        wrong.setdefault(number, []).extend(
            value for value in (below, np.nextafter(each.upper, np.inf)) if np.isfinite(value)
        )
    assert sum(map(len, wrong.values())) > len(made.parameters)
    for number, value in ((number, value) for number, each in wrong.items() for value in each):
        host.parameters[number] = value
        assert (host.prepare(), host.invalid_parameter()) == (2, number + 1)
        np.testing.assert_array_equal(host.prepared.view(np.uint64), before.view(np.uint64))
        assert host.step() == 0
        host.parameters[:] = defaults
    host.parameters[position(made, "parameters", "controller.coordination.preload")] = 13000.0  # > 2 tension_max
    assert host.prepare() == 2
    host.parameters[:] = defaults
    assert (host.prepare(), host.invalid_parameter()) == (0, 0)


def test_what_is_not_finite_is_refused_and_changes_nothing(hosts) -> None:
    host = hosts("controller")
    host.input[0], host.input[4] = 10.0, 10.01
    assert host.step() == 0
    good, state = host.output.copy(), host.state.copy()
    assert not np.array_equal(good, values(of("controller").outputs))
    for wrong in (np.nan, np.inf, -np.inf):
        kept, host.input[2] = host.input[2], wrong
        assert host.step() == 1
        host.input[2] = kept
        np.testing.assert_array_equal(host.output, good)
        np.testing.assert_array_equal(host.state, state)
    host.input[1] = 1e300  # its square overflows
    assert host.step() == 3
    np.testing.assert_array_equal(host.output, good)


def test_instances_are_independent_in_threads(hosts) -> None:
    inputs = [plausible(of("plant"), 3000)[1] * scale for scale in (0.1, 0.2)]
    alone = [hosts("plant").run(given) for given in inputs]
    assert not np.array_equal(*alone)
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda given: hosts("plant").run(given), inputs))
    np.testing.assert_array_equal(together, alone)


@pytest.mark.parametrize(
    "name", ["gcc", *(pytest.param(name, marks=pytest.mark.external) for name in ("clang", "zig"))]
)
def test_builds_without_a_warning_and_shows_only_its_own_symbols(tmp_path: Path, name: str) -> None:
    if name != "zig" and shutil.which(name) is None:
        pytest.skip(f"no {name}")
    compiler: Compiler = find_compiler("zig" if name == "zig" else shutil.which(name))
    made, lister = of("controller"), shutil.which("nm")
    for precision, freeze in (("float", True), ("double", False)):
        folder = tmp_path / precision
        folder.mkdir()
        files = c_package(made, made.name, ABOUT, precision, freeze=freeze)
        build(folder, files, made.name, compiler.command, *PRECISE)
        command = [*compiler.command, *STRICT, *PRECISE, "-O2", "main.c", f"{made.name}.c", "-lm", "-o", "example"]
        subprocess.run(command, cwd=folder, check=True)
        printed = subprocess.run(folder / "example", capture_output=True, text=True, check=True).stdout
        assert printed.startswith("status 0 after 1000 samples")
        subprocess.run([*compiler.command, *STRICT, "-O1", "-c", f"{made.name}.c"], cwd=folder, check=True)
        if name == "zig" or lister is None:
            continue
        listed = subprocess.run([lister, f"{made.name}.o"], cwd=folder, capture_output=True, text=True, check=True)
        found = re.findall(r" ([A-Za-z]) (\S+)$", listed.stdout, re.MULTILINE)
        shown = {symbol for kind, symbol in found if kind.isupper() and kind != "U"}
        parts = ["init", "reset", "rest", "step"] + (
            [] if freeze else ["checksum", "defaults", "invalid_parameter", "prepare"]
        )
        assert shown == {f"{made.name}_{part}" for part in parts}
        assert not {symbol for kind, symbol in found if kind in "bBdDC"}  # no variable outlives a call
        needed = {symbol for kind, symbol in found if kind == "U"} - {"memcpy", "memset", "__stack_chk_fail"}
        needed.discard("_GLOBAL_OFFSET_TABLE_")
        allowed = {"exp", "log", "sin", "sqrt", "tanh", "floor"}
        assert needed <= ({f"{function}f" for function in allowed} if precision == "float" else allowed)
    loop = of("closed-loop")
    (tmp_path / "closed_loop.h").write_text((files := c_package(loop, loop.name, ABOUT, "float"))["closed_loop.h"])
    (tmp_path / "closed_loop.c").write_text(files["closed_loop.c"])
    subprocess.run([*compiler.command, *STRICT, *PRECISE, "-O0", "-c", "closed_loop.c"], cwd=tmp_path, check=True)


@pytest.mark.parametrize("estimator", ["lowpass", pytest.param("kalman", marks=pytest.mark.slow)])
def test_fuzzing_finds_no_trap_no_infinity_and_no_torque_beyond_its_limits(estimator: str, tmp_path: Path) -> None:
    made = block("controller", with_leaves(case(4), {"controller.estimator": estimator}))
    for file, text in c_package(made, "controller", ABOUT).items():
        (tmp_path / file).write_text(text)
    source = Path(__file__).parents[1] / "fuzz.c"
    sanitizers = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g")
    command = ["gcc", *STRICT, "-O1", *sanitizers, f"-I{tmp_path}", str(source), "controller.c", "-lm", "-o", "fuzz"]
    if shutil.which("gcc") is None:
        pytest.skip("the sanitizers need gcc")
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "fuzz", "40000", "7"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    accepted, refused = map(int, re.findall(r"\d+", done.stdout))
    assert min(accepted, refused) > 10_000


def test_the_closed_loop_runs_clean_under_sanitizers(tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("the sanitizers need gcc")
    for file, text in c_package(of("closed-loop"), "loop", ABOUT, "float").items():
        (tmp_path / file).write_text(text)
    sanitizers = "-fsanitize=address,undefined,float-cast-overflow"
    command = ["gcc", *STRICT, "-O0", sanitizers, "main.c", "loop.c", "-lm", "-o", "example"]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run(tmp_path / "example", capture_output=True, text=True, check=True)
    assert done.stderr == ""


@pytest.mark.external
@pytest.mark.parametrize("what", ["controller", "plant"])
def test_valgrind_finds_nothing(what: str, tmp_path: Path) -> None:
    valgrind, gcc = shutil.which("valgrind"), shutil.which("gcc")
    if valgrind is None or gcc is None:
        pytest.skip("no valgrind")
    made = block(what, with_leaves(case(4), {"controller.estimator": "kalman"}))
    for file, text in c_package(made, made.name, ABOUT).items():
        (tmp_path / file).write_text(text)
    command = [gcc, *STRICT, "-O1", "-g", "main.c", f"{made.name}.c", "-lm", "-o", "example"]
    subprocess.run(command, cwd=tmp_path, check=True)
    command = [valgrind, "--quiet", "--error-exitcode=9", "--leak-check=full", tmp_path / "example"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.external
def test_cmake_builds_the_package(tmp_path: Path) -> None:
    if shutil.which("cmake") is None:
        pytest.skip("no cmake")
    for file, text in c_package(of("controller"), "controller", ABOUT, "float").items():
        (tmp_path / file).write_text(text)
    for command in (["cmake", "-B", "build", "-S", "."], ["cmake", "--build", "build"]):
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    example = subprocess.run(tmp_path / "build" / "controller_example", capture_output=True, text=True, check=True)
    assert "tau_1                      22.22222 N m" in example.stdout


CHOICES = [
    *(("controller.kind", kind) for kind in POSITION_LAWS),
    *(("controller.estimator", estimator) for estimator in ESTIMATORS),
    *(("controller.coordination.kind", coordination) for coordination in COORDINATIONS),
]


@pytest.mark.parametrize("precision", ["float", pytest.param("double", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("key", "choice"), CHOICES)
def test_every_law_becomes_a_package(key: str, choice: str, precision: Precision) -> None:
    made = block("controller", with_leaves(Experiment(), {key: choice}))
    source = c_package(made, "controller", ABOUT, precision)["controller.c"]
    assert not re.search(r"casadi|arg\[|res\[|\binf\b|\bnan\b", source)
    if precision == "float":
        assert not re.search(r"\d\.\d*(e[+-]?\d+)?(?![\dfe.])", source.split("static void evaluate")[1])


def test_what_others_say_of_a_number_does_not_end_its_comment() -> None:
    made = of("controller")
    first, *others = made.inputs
    wild = replace(first, description="of mine */ int evil; /*\n*/")
    header = c_package(replace(made, inputs=(wild, *others)), "pilot", ABOUT)["pilot.h"]
    (line,) = (line for line in header.splitlines() if "evil" in line)
    assert line.count("*/") == line.count("/*") == 1
    assert line.endswith("*/")


def test_what_others_say_of_a_number_breaks_no_table_and_no_string(tmp_path: Path) -> None:
    made = of("controller")
    first, *others = made.outputs
    wild = replace(first, unit='| " ??/ %s\n`<b>', description="of mine | *all*\n| x | y |")
    files = c_package(replace(made, outputs=(wild, *others), description="a | <b>\n# b"), "pilot", ABOUT)
    readme = files["README.md"]
    (row,) = (line for line in readme.splitlines() if "of mine" in line)
    assert len(re.findall(r"(?<!\\)\|", row)) == 4
    assert r"\<b\>" in row
    assert not [line for line in readme.splitlines() if line.startswith(("# b", "| x"))]
    for file, text in files.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    command = find_compiler().command
    subprocess.run([*command, "-std=c99", "-O0", "main.c", "pilot.c", "-lm", "-o", "pilot"], cwd=tmp_path, check=True)
    shown = subprocess.run([tmp_path / "pilot"], capture_output=True, text=True, check=True).stdout
    assert '| " ??/ %s\\n`<b>\n' in shown


def test_header_names_units_sources_and_provenance() -> None:
    header = c_package(of("controller"), "pilot", Provenance("dualwinch 9", "sha256:abc", "2026-01-02"))["pilot.h"]
    assert "Generated by dualwinch 9 on 2026-01-02;\n   configuration sha256:abc." in header
    assert re.search(r"controller_nftsm_k; +/\* \[m/s\^2\] gain .*; min 0; 0\.5 \(paper 4\.1\) \*/", header)
    assert "pilot_step" in header
    frozen_header = c_package(of("controller"), "pilot", ABOUT, freeze=True)["pilot.h"]
    assert not re.search("pilot_(parameters|prepared)", frozen_header)
    assert "controller.nftsm.k = [m/s^2] gain of the switching term; min 0; 0.5 (paper 4.1)" in frozen_header


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("controller", ABOUT, "half"), "unknown precision 'half': must be double or float"),
        (("9lives", ABOUT), "'9lives': must be a C identifier"),
    ],
)
def test_wrong_requests_say_what_is_allowed(arguments, message: str) -> None:
    with pytest.raises(CodegenError, match=re.escape(message)):
        c_package(of("controller"), *arguments)


def test_frozen_block_has_its_parameters_inside() -> None:
    made = frozen(of("plant"))
    assert made.step.name_in() == ["state", "input"]
    assert not made.parameters


@pytest.mark.parametrize("precision", all_but(["float"], ["double", "float"]))
def test_a_sensor_may_be_silent_where_the_estimator_does_without_it(tmp_path: Path, precision: Precision) -> None:
    made = block("controller", case(4, estimator=ESTIMATORS["self-calibrating-kalman"]()))
    assert made.silent == {"x"}
    package = c_package(made, made.name, ABOUT, precision)
    assert "`input.x` may be silent" in package["README.md"]
    flags = PRECISE if precision == "float" else ()
    library = build(tmp_path, package, made.name, find_compiler().command, *flags)
    hosts = [Host(library, made.name, made, precision) for _ in range(2)]
    x, v = position(made, "inputs", "x"), position(made, "inputs", "v")
    for sample in range(40):
        for host, nothing in zip(hosts, (np.nan, 2e6), strict=True):
            host.input[x] = nothing if sample > 30 else 1e-5 * sample
            assert host.step() == 0
        assert np.array_equal(hosts[0].output, hosts[1].output)
    hosts[0].input[v] = np.nan
    assert hosts[0].step() == 1


def test_others_refuse_what_is_no_number(hosts) -> None:
    host = hosts("controller")
    host.input[position(of("controller"), "inputs", "x")] = np.nan
    assert host.step() == 1
