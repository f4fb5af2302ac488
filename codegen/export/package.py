"""A block as a self-contained C99 package: source, header, CMake file, README and example."""

import math
import re
import zlib
from collections.abc import Collection
from dataclasses import dataclass, replace

import casadi as ca
from jinja2 import Environment, PackageLoader, StrictUndefined

from dualwinch.codegen.block import NO_READING, Block, Variable
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.export.members import member, of_structures
from dualwinch.codegen.export.prepared import Prepared, prepared
from dualwinch.codegen.source.operations import Style
from dualwinch.codegen.source.precision import PRECISIONS, Precision, literal
from dualwinch.codegen.source.rolled import rolled_statements
from dualwinch.codegen.source.statements import Element, Strand, helpers, statements
from dualwinch.codegen.text import c_comment, c_string, markdown


@dataclass(frozen=True)
class Provenance:
    """Where a package comes from.

    Attributes:
        product: name and version of what generated it.
        configuration: digest of the configuration it was made from.
        date: of its making, ISO 8601.
    """

    product: str
    configuration: str
    date: str


def frozen(block: Block, names: Collection[str] | None = None) -> Block:
    """The block with parameters as constants: those of the names, by default all (its functions then take none)."""
    kept = tuple(variable for variable in block.parameters if names is not None and variable.name not in names)
    free = ca.SX.sym("parameters", len(kept))
    symbols = dict(zip((variable.name for variable in kept), ca.vertsplit(free) if kept else (), strict=True))
    values = ca.vertcat(*(symbols.get(variable.name, variable.start) for variable in block.parameters))

    def bound(function: ca.Function) -> ca.Function:
        names, results = function.name_in(), function.name_out()
        given = {name: ca.SX.sym(name, function.size1_in(name)) for name in names if name != "parameters"}
        found = function.call(given | {"parameters": values})
        given |= {"parameters": free} if kept else {}
        expressions = [ca.densify(ca.cse(found[name])) for name in results]
        return ca.Function(function.name(), list(given.values()), expressions, list(given), results, {"cse": True})

    return replace(
        block,
        step=bound(block.step),
        initial=bound(block.initial),
        output=bound(block.output) if block.output else None,
        derivative=bound(block.derivative) if block.derivative else None,
        parameters=kept,
    )


def c_package(
    block: Block, name: str, provenance: Provenance, precision: str = "double", *, freeze: bool = False
) -> dict[str, str]:
    """The files of a package by name.

    Args:
        block: what to write.
        name: a C identifier; begins every symbol and file name.
        provenance: goes into header and README.
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
    apart = prepared(written, precision)
    bodies = _bodies(written, apart, precision)
    facts = {
        "block": written,
        "kept": apart.kept,
        "derived": apart.derived,
        "lost": apart.lost,
        "mark": _mark(apart, bodies["derive"]),
        "constants": block.parameters if freeze else (),
        "name": name,
        "precision": precision,
        "provenance": provenance,
        "bodies": bodies,
        "helpers": helpers(apart.functions, precision),
        "silent": 2 * NO_READING,
        "comment": _comment,
    }
    files = {
        f"{name}.h": "package.h.j2",
        f"{name}.c": "package.c.j2",
        "main.c": "main.c.j2",
        "CMakeLists.txt": "CMakeLists.txt.j2",
        "README.md": "README.md.j2",
    }
    return {file: environment.get_template(template).render(facts) for file, template in files.items()}


def templates(precision: Precision) -> Environment:
    """The templates of generated files, with the filters of names, numbers and texts."""
    environment = Environment(
        loader=PackageLoader("dualwinch.codegen.export"),
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


def _bodies(block: Block, apart: Prepared, precision: Precision) -> dict[str, str]:
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
    given = of_structures({"parameters": ("parameters->", block.parameters)})

    style = Style(precision, compares=True)

    def body(function: ca.Function, element: Element = elements) -> list[str]:
        return statements(function, style, [Strand(element)])

    bodies = {
        "step": body(apart.step),
        "initial": body(apart.initial, at_start),
        "derive": rolled_statements(apart.derive, style, [Strand(given)]),  # room counts there, time does not
    } | ({"output": body(apart.output)} if apart.output else {})
    return {name: "\n".join(lines) + "\n" for name, lines in bodies.items()}


def _mark(apart: Prepared, derive: str) -> str:
    """A number that stands for what is prepared and how, never zero, in C."""
    text = "".join([*(variable.name for variable in apart.kept), derive])
    return f"0x{zlib.crc32(text.encode()) | 1:08x}"


def _comment(variable: Variable, *, value: bool = False) -> str:
    """What a comment says of a variable."""
    lower, upper = variable.lower, variable.upper
    least = f"> {lower:g}" if variable.exclusive else f"min {lower:g}"
    bounds = [least] * (lower > -math.inf) + [f"max {upper:g}"] * (upper < math.inf)
    words = [f"[{variable.unit}] {variable.description}", *bounds]
    if value:
        words.append(f"{variable.start!r}" + (f" ({variable.source})" if variable.source else ""))
    return "; ".join(words)


def _padded(variable: Variable, variables: tuple[Variable, ...]) -> str:
    """A member's declaration, as wide as the longest beside it."""
    return f"{member(variable)};".ljust(max(len(member(other)) for other in variables) + 1)
