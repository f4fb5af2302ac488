"""Structured Text: parsed by blark, run by an evaluator of its own, and compared with the C package bit for bit."""

import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import casadi as ca
import numpy as np
import pytest
from blark.input import load_file_by_name
from blark.parse import parse_item

from benchmarks.embedded.host import PRECISE, Host, build
from benchmarks.plc import SITE, compare, controller_inputs
from dualwinch.codegen.block import Block, Variable
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.codegen.source.operations import PRECISIONS, Precision
from dualwinch.config.experiment_file import load
from dualwinch.simulation.blocks import block
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.plc.plcopen import NAMESPACE
from dualwinch.toolboxes.plc.project import FLAVOURS, Flavour, identifier
from dualwinch.toolboxes.plc.structured_text import operation_count, st_package
from tests.codegen.export.test_package_operations import AT, kept
from tests.codegen.export.test_package_operations import block as every
from tests.toolboxes.plc.st_evaluator import REALS, Frame, Machine

ABOUT = Provenance("dualwinch 0", "sha256:0 (* *) ]]>", "2026-01-01")
NS = {"": NAMESPACE, "html": "http://www.w3.org/1999/xhtml"}


@cache
def small(*, terms: int = 1) -> Block:
    """A sum that forgets, of an input that may be silent, with functions that Structured Text lacks."""
    state, given, parameters = ca.SX.sym("state", 2), ca.SX.sym("input", 2), ca.SX.sym("parameters", 2)
    (total, count), (x, y), (gain, limit) = map(ca.vertsplit, (state, given, parameters))
    heard = ca.if_else(ca.fabs(x) > 1e6, 0, x)
    inside = ca.fmin(ca.fmax(heard, -limit), limit)
    following = total + ca.tanh(inside) * ca.exp(-gain / limit)
    output = [ca.sign(y) * ca.floor(7 * following), ca.ceil(y) + ca.sqrt(ca.fabs(y)) / (1 + gain)]
    output[1] += sum((y - k for k in range(terms)), ca.SX(0))
    names = ["state", "input", "parameters"]
    steps = ca.vertcat(following, count + 1), ca.vertcat(*output)
    return Block(
        name="small",
        description="A sum *) that forgets",
        step=ca.Function("step", [state, given, parameters], list(steps), names, ["next_state", "output"]),
        initial=ca.Function("initial", [parameters], [ca.vertcat(gain / 3, 0)], ["parameters"], ["state"]),
        states=(Variable("inner.total", "m", "the sum", 0.0), Variable("count", "1", "samples", 0.0)),
        inputs=(Variable("x", "m", "what is added", 0.0), Variable("y", "1", "another", 0.5)),
        outputs=(Variable("s", "m", "whole part", 0.0), Variable("rest", "1", "the other", 0.0)),
        parameters=(
            Variable("part.gain", "1", "gain", 0.3, 0.0, source="paper (1)"),
            Variable("part.limit", "m", "limit", 2.0, 0.0, exclusive=True, source="Table 1"),
        ),
        sample_time=0.001,
        silent=frozenset({"x"}),
        rules=ca.Function(
            "rules",
            [parameters],
            [ca.vertcat(gain < limit, ca.floor(limit * 4) == limit * 4)],
            ["parameters"],
            ["holds"],
        ),
        ruled=("part.gain", "part.limit"),
    )


class Pair:
    """A block in Structured Text and in C, called alike."""

    def __init__(self, folder: Path, made: Block, precision: Precision) -> None:
        self.block, self.real = made, {"double": REALS["LREAL"], "float": REALS["REAL"]}[precision]
        self.machine = Machine(st_package(made, "st", ABOUT, precision)["st.st"])
        self.st: Frame = self.machine.new("st")
        flags = PRECISE if precision == "float" else ()
        library = build(folder, c_package(made, "c", ABOUT, precision), "c", find_compiler().command, *flags)
        self.c = Host(library, "c", made, precision)

    def step(self, values: np.ndarray, **more: object) -> int:
        """One sample of both, whose outputs must be the same to the last bit; the status."""
        self.c.input[:] = values
        status = self.c.step()
        named = {each.name: self.real(value) for each, value in zip(self.block.inputs, values, strict=True)}
        self.machine.call(self.st, **named, **more)
        output = [self.st[identifier(each.name).lower()] for each in self.block.outputs]
        np.testing.assert_array_equal(np.array(output), self.c.output, strict=True)
        assert self.st["status"] == status
        return status


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Precision], Pair]:
    """(precision) → the small block, its parts at their beginning."""
    made: dict[Precision, Pair] = {}

    def new(precision: Precision) -> Pair:
        if precision not in made:
            made[precision] = Pair(tmp_path_factory.mktemp(precision), small(), precision)
        both = made[precision]
        both.st = both.machine.new("st")
        assert both.c.reset() == 0
        return both

    return new


@pytest.mark.parametrize("precision", ["double", pytest.param("float", marks=pytest.mark.slow)])
def test_the_block_gives_the_bits_of_the_c_package(pair, precision: Precision) -> None:
    both = pair(precision)
    for values in np.random.default_rng(1).normal(0, 3, (200, 2)):
        assert both.step(values) == 0


def test_bad_input_keeps_the_state_and_repeats_the_output(pair) -> None:
    both = pair("double")
    for bad in (np.nan, np.inf, -np.inf):
        both = pair("double")
        assert both.step(np.array([1.0, bad])) == 1  # at once: what is repeated is the output at rest
        assert both.step(np.array([1.0, 2.0])) == 0
        before = dict(both.st["state"])
        assert both.step(np.array([1.0, bad])) == 1
        assert both.st["state"] == before
        assert both.step(np.array([bad, -2.0])) == 0  # a silent input is none
        assert both.st["state"] != before
    assert both.step(np.array([1.0, 3e307])) == 0
    before = both.c.state[0] = both.st["state"]["inner_total"] = both.real(1e308)  # whose multiple is not finite
    assert both.step(np.array([1.0, 2.0])) == 3
    assert both.st["state"]["inner_total"] == before


def test_parameters_take_effect_when_they_are_prepared(pair) -> None:
    both, given = pair("double"), np.array([0.7, 0.4])
    both.step(given)
    both.st["parameters"]["part_gain"] = both.real(0.9)
    assert both.step(given) == 0  # not yet
    both.c.parameters[0] = 0.9
    assert both.c.prepare() == 0
    assert both.step(given, prepare=True) == 0
    both.st["parameters"]["part_gain"] = both.real(np.nan)
    assert both.step(given, prepare=True) == 0  # goes on with what was good
    assert both.st["parameter_status"] == 2
    elsewhere = both.machine.new("st_prepare")
    elsewhere["parameters"]["part_gain"] = both.real(0.2)
    both.machine.call(elsewhere)
    both.c.parameters[0] = 0.2
    assert both.c.prepare() == 0
    assert both.step(given, prepare=False, use_prepared=True, prepared=elsewhere["prepared"]) == 0
    assert both.c.reset() == 0
    both.step(given, use_prepared=False, reset=True)
    both.c.parameters[0] = 0.3
    assert both.c.prepare() == 0


@pytest.mark.parametrize(
    ("gain", "limit", "position"), [(-0.1, 2, 1), (0.3, 0, 2), (3, 2, 1), (0.3, 2.1, 2), (0, 4, 0)]
)
def test_invalid_parameters_are_refused_as_in_c_and_the_old_ones_remain(
    pair, gain: float, limit: float, position: int
) -> None:
    both = pair("double")
    assert both.step(np.array([0.7, 0.4])) == 0
    both.c.parameters[:] = gain, limit
    both.st["parameters"] |= {"part_gain": both.real(gain), "part_limit": both.real(limit)}
    assert both.c.prepare() == (2 if position else 0)
    assert both.c.invalid_parameter() == position
    assert both.step(np.array([0.7, 0.4]), prepare=True) == 0
    assert (both.st["parameter_status"], both.st["invalid_parameter"]) == (2 if position else 0, position)
    both.c.parameters[:] = 0.3, 2
    assert both.c.prepare() == 0
    both.st["parameters"] |= {"part_gain": both.real(0.3), "part_limit": both.real(2)}
    assert both.step(np.array([0.7, 0.4]), prepare=True) == 0
    both.step(np.array([0.7, 0.4]), prepare=False)


def test_nothing_prepared_is_said_and_the_output_is_that_at_rest(pair) -> None:
    both = pair("double")
    both.st["parameters"]["part_limit"] = both.real(np.inf)
    both.machine.call(both.st, x=both.real(1), y=both.real(1))
    assert (both.st["status"], both.st["parameter_status"]) == (2, 2)
    assert [both.st["s"], both.st["rest"]] == [each.start for each in small().outputs]


@pytest.mark.slow
@pytest.mark.parametrize("precision", PRECISIONS)
def test_every_operation_gives_the_bits_of_the_c_package(tmp_path: Path, precision: Precision) -> None:
    written = {operation: function for operation, function in kept().items() if operation != ca.OP_ERFINV}
    assert len(written) > 40
    both = Pair(tmp_path, every(written), precision)
    assert [both.step(values) for values in AT] == [0, 0, 0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "precision"),
    [
        ({}, "double"),
        ({}, "float"),
        ({"controller.kind": "mpc"}, "double"),
    ],
)
def test_2_s_of_case_4_are_the_same_to_the_last_bit(
    tmp_path: Path, changed: dict[str, str], precision: Precision
) -> None:
    _compare(tmp_path, override(case(4), changed), precision, 2.0)


@pytest.mark.slow
def test_half_a_second_of_the_tuned_site_with_its_filter_is_the_same_to_the_last_bit(tmp_path: Path) -> None:
    _compare(tmp_path, load(SITE), "double", 0.5)


def _compare(folder: Path, experiment: Experiment, precision: Precision, duration: float) -> None:
    experiment = override(experiment, {"simulation.duration": duration})
    both = Pair(folder, block("controller", experiment), precision)
    inputs = controller_inputs(experiment, both.block)
    assert len(inputs) >= 1000 * duration
    assert {both.step(values) for values in inputs} == {0}


@pytest.mark.external
@pytest.mark.parametrize("precision", PRECISIONS)
def test_matiec_compiles_the_block_to_the_same_bits(precision: Precision) -> None:
    iec2c = os.environ.get("IEC2C") or shutil.which("iec2c")
    if not iec2c:
        pytest.skip("no iec2c; IEC2C says where it is")
    got = compare(override(case(4), {"simulation.duration": 2.0}), precision, Path(iec2c))
    assert (got.numbers, got.different) == (24_000, 0)


def test_types_carry_units_bounds_sources_and_values() -> None:
    text = st_package(small(), "st", ABOUT)["st.st"]
    assert "part_gain  : LREAL := LREAL#0.3; (* [1] gain; min 0; 0.3 (paper (1)) *)" in text
    assert "part_limit : LREAL := LREAL#2.0; (* [m] limit; > 0; 2.0 (Table 1) *)" in text
    assert re.search(r"^  x +: LREAL := LREAL#0.0; \(\* \[m\] what is added \*\)$", text, re.MULTILINE)
    assert text.startswith("(* st: A sum * ) that forgets, one sample per call.\n")
    assert " REAL " not in text
    assert "LREAL" not in st_package(small(), "st", ABOUT, "float")["st.st"]


def test_names_are_those_that_the_standard_has() -> None:
    names = {"controller.k": "controller_k", "a__b_": "a_b", "Größe": "Gr_e", "1st": "n1st", "min": "min_value"}
    assert {name: identifier(name) for name in names} == names
    assert [identifier("s", flavour) for flavour in FLAVOURS] == ["s", "s_value", "s_value", "s_value"]
    twins = replace(small(), inputs=(replace(small().inputs[0], name="S"), small().inputs[1]), silent=frozenset())
    with pytest.raises(CodegenError, match="st: no Structured Text with both 'S' and 's'; rename one"):
        st_package(twins, "st", ABOUT)


def test_what_it_cannot_write_is_refused_with_the_reason() -> None:
    operations = operation_count(small(terms=500).step).total
    assert operations > 500
    with pytest.raises(CodegenError, match=r"small: \d+ operations per call; must be <= 500 \(--max-operations\)"):
        st_package(small(terms=500), "st", ABOUT, max_operations=500)
    with pytest.raises(CodegenError, match="unknown flavour 'step7': must be iec or codesys or twincat or siemens-scl"):
        st_package(small(), "st", ABOUT, flavour="step7")
    with pytest.raises(CodegenError, match="unknown precision 'half': must be double or float"):
        st_package(small(), "st", ABOUT, "half")
    symbols = {name: ca.SX.sym(name, 2) for name in ("state", "input", "parameters")}
    results = [symbols["state"], ca.erfinv(symbols["input"])]
    inverse = ca.Function("step", [*symbols.values()], results, [*symbols], ["next_state", "output"])
    with pytest.raises(CodegenError, match="no Structured Text for 'erfinv'"):
        st_package(replace(small(), step=inverse), "st", ABOUT)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_each_flavour_has_its_files(flavour: Flavour, tmp_path: Path) -> None:
    files = st_package(small(), "st", ABOUT, flavour=flavour)
    assert ("st.xml" in files) == (flavour != "siemens-scl")
    assert "| per sample | " in files["README.md"]
    if flavour == "twincat":
        for name in ("st_input.TcDUT", "st_floor.TcPOU"):
            (tmp_path / name).write_text(files[name])
            for item in load_file_by_name(tmp_path / name):
                assert all(result.exception is None for result in parse_item(item))
    elif flavour == "siemens-scl":
        head = "{ S7_Optimized_Access := 'TRUE' }\nVERSION : 0.1\n"
        assert f'FUNCTION "st_floor" : LREAL\n{head}VAR_INPUT\n  value : LREAL;\nEND_VAR\nVAR_TEMP\n' in files["st.scl"]
        assert f'DATA_BLOCK "st_program_data"\n{head}"st_program"\nBEGIN\nEND_DATA_BLOCK\n' in files["main.scl"]
        assert "#st_floor := whole;" in files["st.scl"]
        assert '"st_floor"(value := work' in files["st.scl"]
        assert 'prepared : "st_prepared";' in files["st.scl"]
        assert files["st.scl"].count("BEGIN") == 4
    else:
        assert ("TASK control(INTERVAL := T#1ms" in files["main.st"]) == (flavour == "iec")
        program, _, _ = files["main.st"].partition("CONFIGURATION")  # which blark does not know
        (tmp_path / "main.st").write_text(program)
        for item in load_file_by_name(tmp_path / "main.st"):
            assert all(result.exception is None for result in parse_item(item))
        assert "PROGRAM st_program" in program


@pytest.mark.parametrize("flavour", ["iec", "codesys"])
def test_plcopen_xml_has_the_same_types_and_bodies(flavour: Flavour) -> None:
    files = st_package(small(), "st", ABOUT, flavour=flavour)
    root = ET.fromstring(files["st.xml"])  # noqa: S314  # of our own making
    assert [child.tag.split("}")[1] for child in root] == ["fileHeader", "contentHeader", "types", "instances"]
    types = {each.get("name") for each in root.iterfind(".//dataType", NS)}
    pous = {each.get("name"): each for each in root.iterfind(".//pou", NS)}
    assert {each.get("name") for each in root.iterfind(".//derived", NS)} <= types | set(pous)
    kinds = ["function", "functionBlock", "functionBlock", "functionBlock", "program"]
    assert [each.get("pouType") for each in pous.values()] == kinds
    text = files["st.st"] + files["main.st"]
    for pou in pous.values():
        (body,) = pou.iterfind("body/ST/*", NS)
        assert body.tag.split("}")[1] == {"iec": "p", "codesys": "xhtml"}[flavour]
        lines = [line for line in (body.text or "").split("\n") if line.strip()]
        assert all(f"  {line}\n" in text for line in lines)
        sections = [each.tag.split("}")[1] for each in pou.iterfind("interface/*", NS)]
        order = ["returnType", "inputVars", "outputVars", "inOutVars", "localVars", "documentation"]
        assert set(sections) <= set(order)
    start = root.find(".//dataType[@name='st_parameters']//variable[@name='part_gain']/initialValue/simpleValue", NS)
    assert start is not None
    assert start.get("value") == "LREAL#0.3"
    task = root.find(".//task", NS)
    assert task is not None
    assert task.get("interval") == {"iec": "T#1ms", "codesys": "PT0.001S"}[flavour]
