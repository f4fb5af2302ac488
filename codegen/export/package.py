"""A block as a self-contained C99 package: source, header, CMake file, README and example.

Expressions of the parameters alone are computed only when these change, which saves time per sample. In single
precision the states of a step use compensated summation (Kahan, Further remarks on reducing truncation errors,
Communications of the ACM 8 (1965) 40): at 46 m the rounding error is up to 2 µm. An observer that adds ``T v`` to a
position at every sample makes this error, at constant speed always in the same direction: 2 mm/s at 1 kHz, which it
takes for a disturbance. The rounding error of a state is therefore stored and added at the next sample.
"""

import math
import re
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from dualwinch.codegen.block import NO_READING, Block, Variable
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.expressions import GRAPHS, applied, as_written, elements_read
from dualwinch.codegen.source.hoist import hoisted_together
from dualwinch.codegen.source.loops import rolled_statements
from dualwinch.codegen.source.operations import PRECISIONS, Precision, Style, literal
from dualwinch.codegen.source.statements import Element, Strand, helpers, of_array, statements
from dualwinch.codegen.source.written_out import written_out
from dualwinch.codegen.text import c_comment, c_string, markdown


def member(variable: Variable) -> str:
    """Name of a variable as a member of a C structure."""
    return re.sub(r"\W", "_", variable.name)


def of_structures(
    vectors: Mapping[str, tuple[str, tuple[Variable, ...]]],
    arrays: Mapping[str, str] | None = None,
    named: Callable[[Variable], str] = member,
) -> Element:
    """C expressions of elements that are members of structures.

    Args:
        vectors: name of an argument or result → prefix of its members (e.g. ``state->``), and the variables; others are
            arrays.
        arrays: name of an argument or result → name of its array, if different.
        named: name of a variable as a member.
    """
    other = arrays or {}
    members = {
        name: [before + named(variable) for variable in variables] for name, (before, variables) in vectors.items()
    }

    def element(name: str, index: int) -> str:
        return members[name][index] if name in members else of_array(other.get(name, name), index)

    return element


@GRAPHS.cached
def compensated(step: ca.Function) -> ca.Function:
    """A step with compensated summation of all states that are sums of their last value and a change (cached).

    Args:
        step: function of dense SX expressions, with an input ``state`` and ``next_state`` as the first output.

    Returns:
        The step with ``lost`` as an additional last input and ``next_lost`` as an additional last output.
    """
    inputs = [ca.SX.sym(name, step.size1_in(name)) for name in step.name_in()]
    states = ca.vertsplit(inputs[step.name_in().index("state")])
    with as_written():
        following, *outputs = step.call(inputs)
        after = ca.vertsplit(following)
        sums = {index: parts for index, state in enumerate(states) if (parts := _sum(after[index], state))}
        lost = ca.SX.sym("lost", len(sums))
        next_lost = ca.SX.zeros(len(sums))
        for position, (index, (before, change)) in enumerate(sums.items()):
            added = change + lost[position]
            after[index] = before + added
            next_lost[position] = added - (after[index] - before)
        return ca.Function(
            step.name(),
            [*inputs, lost],
            [ca.vertcat(*after), *outputs, next_lost],
            [*step.name_in(), "lost"],
            [*step.name_out(), "next_lost"],
            {"cse": True},
        )


def _sum(after: ca.SX, state: ca.SX) -> tuple[ca.SX, ca.SX] | None:
    """A state's next value as a sum of its last value and a change; None where it is no such sum."""
    state_terms, addends = _terms(after, state)
    with_state, added = {_condition(term) for term in state_terms}, {_condition(term) for term in addends}
    if not state_terms or not addends:
        return None
    if None not in with_state | added and with_state.isdisjoint(added):
        return None  # the state is chosen, not summed: it stays where nothing is added
    return sum(state_terms[1:], state_terms[0]), sum(addends[1:], addends[0])


def _condition(term: ca.SX) -> int | None:
    """The condition of a term, by its hash; None without one."""
    return term.dep(0).element_hash() if term.is_op(ca.OP_IF_ELSE_ZERO) else None


def _terms(value: ca.SX, state: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """The terms of a sum that are the state, possibly under a condition, and the others."""
    if value.is_op(ca.OP_ADD) or value.is_op(ca.OP_SUB):
        state_terms, addends = _terms(value.dep(0), state)
        right_state_terms, right_addends = _terms(value.dep(1), state)
        if value.is_op(ca.OP_ADD):
            return state_terms + right_state_terms, addends + right_addends
        if not right_state_terms:
            return state_terms, [*addends, *(-term for term in right_addends)]
    if value.is_op(ca.OP_IF_ELSE_ZERO):
        state_terms, addends = _terms(value.dep(1), state)
        if state_terms:
            condition = value.dep(0)
            state_terms, addends = (
                [applied(ca.OP_IF_ELSE_ZERO, [condition, term]) for term in terms] for terms in (state_terms, addends)
            )
            return state_terms, addends
    return ([value], []) if value.is_symbolic() and value.element_hash() == state.element_hash() else ([], [value])


@dataclass(frozen=True)
class PreparedBlock:
    """The functions of a block, each but the first with ``derived`` as its last input.

    Attributes:
        derive: ``derive(parameters) -> derived``, all expressions of the parameters alone.
        step, initial, output: functions of the block; in single precision the step has the additional argument and
            result ``lost`` (`codegen.export.package`).
        rules: the block's requirements on parameters, in plain operations.
        parameters: the parameters that these read in addition to the derived values.
    """

    derive: ca.Function
    step: ca.Function
    initial: ca.Function
    output: ca.Function | None
    parameters: tuple[Variable, ...]
    rules: ca.Function | None = None

    @property
    def derived(self) -> int:
        """Number of derived values."""
        return self.derive.numel_out("derived")

    @property
    def lost(self) -> int:
        """Number of states with compensated summation."""
        return self.step.numel_in("lost") if "lost" in self.step.name_in() else 0

    @property
    def functions(self) -> tuple[ca.Function, ...]:
        """All functions, the one of every sample first."""
        return (
            self.step,
            self.initial,
            *((self.output,) if self.output else ()),
            *((self.rules,) if self.rules else ()),
            self.derive,
        )


def prepared(block: Block, precision: Precision) -> PreparedBlock:
    """Split the functions of a block into expressions of the parameters alone, and the rest.

    Functions that Structured Text lacks are `written_out`. In double precision all other results are unchanged to the
    last bit. In single precision divisions by derived values become products with reciprocals, as a division takes
    fourteen times as long on a Cortex-M4, and states use compensated summation.

    Args:
        block: the block.
        precision: precision of the generated code.
    """
    functions = tuple(map(written_out, (block.step, block.initial, *((block.output,) if block.output else ()))))
    if precision == "float":
        functions = (compensated(functions[0]), *functions[1:])
    derive, (step, initial, *output) = hoisted_together(functions, exact=precision == "double")
    read = set[int]().union(*(elements_read(function, "parameters") for function in (step, initial, *output)))
    parameters = tuple(block.parameters[index] for index in sorted(read))
    rules = written_out(block.rules) if block.rules else None
    return PreparedBlock(derive, step, initial, output[0] if output else None, parameters, rules)


@dataclass(frozen=True)
class Provenance:
    """Origin of a package.

    Attributes:
        product: name and version of the generating product.
        configuration: digest of its configuration.
        date: date of generation, ISO 8601.
    """

    product: str
    configuration: str
    date: str


def frozen(block: Block, names: Collection[str] | None = None) -> Block:
    """The block with the named parameters as constants; by default all, so that its functions take none."""
    free_parameters = tuple(
        variable for variable in block.parameters if names is not None and variable.name not in names
    )
    free = ca.SX.sym("parameters", len(free_parameters))
    symbols = dict(
        zip((variable.name for variable in free_parameters), ca.vertsplit(free) if free_parameters else (), strict=True)
    )
    values = ca.vertcat(*(symbols.get(variable.name, variable.start) for variable in block.parameters))

    def bound(function: ca.Function) -> ca.Function:
        names, results = function.name_in(), function.name_out()
        inputs = {name: ca.SX.sym(name, function.size1_in(name)) for name in names if name != "parameters"}
        outputs = function.call(inputs | {"parameters": values})
        inputs |= {"parameters": free} if free_parameters else {}
        expressions = [ca.densify(ca.cse(outputs[name])) for name in results]
        return ca.Function(function.name(), list(inputs.values()), expressions, list(inputs), results, {"cse": True})

    rules, ruled = _free_rules(block, bound, [variable.name for variable in free_parameters])
    return replace(
        block,
        rules=rules,
        ruled=ruled,
        step=bound(block.step),
        initial=bound(block.initial),
        output=bound(block.output) if block.output else None,
        derivative=bound(block.derivative) if block.derivative else None,
        parameters=free_parameters,
    )


def _free_rules(
    block: Block, bound: Callable[[ca.Function], ca.Function], free: Sequence[str]
) -> tuple[ca.Function | None, tuple[str, ...]]:
    """The rules that depend on free parameters, and the free parameter that each is about."""
    if block.rules is None or not free:
        return None, ()
    every = bound(block.rules)
    symbols = ca.SX.sym("parameters", len(free))
    holds = every(symbols)
    depends = np.array(ca.DM(ca.jacobian_sparsity(holds, symbols), 1.0).full(), bool)
    rows = [int(row) for row in np.flatnonzero(depends.any(axis=1))]
    about = [(name, np.array(free)[depends[row]]) for row, name in enumerate(block.ruled)]
    ruled = tuple(name if name in names else str(names[0]) for name, names in (about[row] for row in rows))
    return ca.Function("rules", [symbols], [holds[rows]], ["parameters"], ["holds"]) if rows else None, ruled


def bounds(variable: Variable, number: Callable[[float], str]) -> list[str]:
    """Bounds of a parameter as the operator and number of a comparison, in C and Structured Text alike."""
    ends = ((">" if variable.exclusive else ">=", variable.lower), ("<=", variable.upper))
    return [f"{comparison} {number(end)}" for comparison, end in ends if math.isfinite(end)]


def c_package(
    block: Block, name: str, provenance: Provenance, precision: str = "double", *, freeze: bool = False
) -> dict[str, str]:
    """The files of a package by name.

    Args:
        block: the block.
        name: a C identifier, the prefix of every symbol and file name.
        provenance: written into header and README.
        precision: ``double`` or ``float`` (no double-precision operation at all).
        freeze: parameters as constants instead of an argument.

    Raises:
        CodegenError: an unknown precision, a name that is no C identifier, or a function that is no plain C.
    """
    if precision not in PRECISIONS:
        raise CodegenError(f"unknown precision '{precision}': must be {' or '.join(PRECISIONS)}")
    if not re.fullmatch(r"[A-Za-z_]\w*", name):
        raise CodegenError(f"{name!r}: must be a C identifier")
    environment = templates(precision)
    written = frozen(block) if freeze else block
    prepared_block = prepared(written, precision)
    bodies = _bodies(written, prepared_block, precision)
    facts = {
        "block": written,
        "kept": prepared_block.parameters,
        "derived": prepared_block.derived,
        "lost": prepared_block.lost,
        "mark": _mark(prepared_block, bodies["derive"]),
        "constants": block.parameters if freeze else (),
        "name": name,
        "precision": precision,
        "provenance": provenance,
        "bodies": bodies,
        "helpers": helpers(prepared_block.functions, Style(precision)),
        "silent": 2 * NO_READING,
        "bounds": lambda variable: bounds(variable, lambda value: literal(value, precision)),
        "ruled": [1 + [each.name for each in written.parameters].index(name) for name in written.ruled],
        "checksum": _checksum(written.parameters, precision),
        "comment": described,
    }
    files = {
        f"{name}.h": "package.h.j2",
        f"{name}.c": "package.c.j2",
        "main.c": "main.c.j2",
        "CMakeLists.txt": "CMakeLists.txt.j2",
        "README.md": "README.md.j2",
    }
    return {file: environment.get_template(template).render(facts) for file, template in files.items()}


TEMPLATES = Path(__file__).parent / "templates"
"""Folder of the templates of C packages."""


def templates(precision: Precision, folder: Path = TEMPLATES) -> Environment:
    """The templates of generated files in a folder, with filters for names, numbers and texts."""
    environment = Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # noqa: S701  # C, not HTML
    )
    environment.filters |= {
        "member": member,
        "padded": _padded,
        "c_comment": c_comment,
        "c_string": c_string,
        "markdown": markdown,
        "literal": lambda value: literal(value, precision),
    }
    return environment


def _bodies(block: Block, apart: PreparedBlock, precision: Precision) -> dict[str, str]:
    """The statements of each of a package's functions."""
    vectors = {
        "state": ("state->", block.states),
        "input": ("input->", block.inputs),
        "parameters": ("prepared->", block.parameters),
        "next_state": ("next->", block.states),
        "output": ("next->output.", block.outputs),
    }
    arrays = {"lost": "state->lost", "next_lost": "next->lost"}
    elements = of_structures(vectors, arrays)
    at_start = of_structures(vectors | {"state": ("next->", block.states)})
    parameters = of_structures({"parameters": ("parameters->", block.parameters)})

    style = Style(precision, compares=True)

    def body(function: ca.Function, element: Element = elements) -> list[str]:
        return statements(function, style, [Strand(element)])

    bodies = {
        "step": body(apart.step),
        "initial": body(apart.initial, at_start),
        "derive": rolled_statements(apart.derive, style, [Strand(parameters)]),  # size matters here, not speed
    }
    bodies |= {"output": body(apart.output)} if apart.output else {}
    bodies |= {"rules": body(apart.rules, parameters)} if apart.rules else {}
    return {name: "\n".join(lines) + "\n" for name, lines in bodies.items()}


def _mark(apart: PreparedBlock, derive: str) -> str:
    """A nonzero C constant that identifies the layout and computation of the prepared values."""
    text = "".join([*(variable.name for variable in apart.parameters), derive])
    return f"0x{zlib.crc32(text.encode()) | 1:08x}"


def _checksum(parameters: Sequence[Variable], precision: Precision) -> str:
    """CRC-32 of the parameters' defaults as stored in memory, the least significant byte first."""
    values = np.array([variable.start for variable in parameters], "<f4" if precision == "float" else "<f8")
    return f"0x{zlib.crc32(values.tobytes()):08x}"


def described(variable: Variable, *, value: bool = False) -> str:
    """Comment on a variable: unit, meaning, bounds, and optionally its value with the source."""
    lower, upper = variable.lower, variable.upper
    lower_bound = f"> {lower:g}" if variable.exclusive else f"min {lower:g}"
    bounds = [lower_bound] * (lower > -math.inf) + [f"max {upper:g}"] * (upper < math.inf)
    words = [f"[{variable.unit}] {variable.description}", *bounds]
    if value:
        words.append(f"{variable.start!r}" + (f" ({variable.source})" if variable.source else ""))
    return "; ".join(words)


def _padded(variable: Variable, variables: tuple[Variable, ...]) -> str:
    """A member's declaration, padded to the width of the longest."""
    return f"{member(variable)};".ljust(max(len(member(other)) for other in variables) + 1)
