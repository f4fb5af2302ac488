"""How tangents pass through a function: its slopes, computed once, and products with them, once a direction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from dualwinch.codegen.drivers.linearised_graph import LinearisedGraph, Vertex


@dataclass(frozen=True)
class Tangents:
    """The tangents of an input.

    Attributes:
        array: in C.
        elements: of the input that have tangents; None: all.
        packed: whether the array holds those alone; else it holds all.
    """

    array: str
    elements: Sequence[int] | None = None
    packed: bool = True


@dataclass(frozen=True)
class JacobianProduct:
    """The product of a function's Jacobian with tangents, in two parts.

    Attributes:
        slopes: ``NAME_slopes(...) -> slopes``: of the function's inputs, the partial derivatives that are not constant.
        statements: C statements that make the tangents of the outputs, ``OUTPUT_tangent``, of those of the inputs and
            the slopes, for one lane. Elements of slopes lie LANES apart, those of tangents DIRECTIONS, if nothing else
            was asked for.
        still: elements of outputs, ``(name, element)``, whose tangents are zero.
    """

    slopes: ca.Function
    statements: list[str]
    still: frozenset[Vertex]


def jacobian_product(
    function: ca.Function, along: Mapping[str, Tangents], outputs: Sequence[str], lanes: str = "LANES"
) -> JacobianProduct:
    """The Jacobian-vector product of a function: its slopes, and statements that multiply tangents with them.

    Args:
        function: of dense SX expressions.
        along: input name → its tangents.
        outputs: names of the outputs that are differentiated.
        lanes: how far apart the elements of slopes lie, as C text.
    """
    symbols = {name: ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()}
    sources: dict[Vertex, str] = {}
    for name, tangents in along.items():
        elements = range(function.size1_in(name)) if tangents.elements is None else tangents.elements
        held = enumerate(elements) if tangents.packed else zip(elements, elements, strict=True)
        sources |= {(name, element): f"{tangents.array}[{k}*DIRECTIONS]" for k, element in held}
    graph = LinearisedGraph(function, symbols, sources, outputs, ["parameters"])
    graph.eliminate()

    inner = sorted(vertex for vertex in graph.into if isinstance(vertex, int))
    joints = {vertex: f"joint_{k}" for k, vertex in enumerate(inner)}
    targets = {vertex: f"const double {name}" for vertex, name in joints.items()}
    targets |= {
        (name, element): f"{name}_tangent[{element}*DIRECTIONS]"
        for name in outputs
        for element in range(function.numel_out(name))
    }
    sources |= joints
    slopes: list[ca.SX] = []
    statements = []
    for vertex, target in targets.items():
        terms = []
        for source, slope in graph.into.get(vertex, {}).items():
            if slope.is_one():
                terms.append(sources[source])
            elif slope.is_constant():
                terms.append(f"{float(slope)!r} * {sources[source]}")
            else:
                terms.append(f"slopes[{len(slopes)}*{lanes}] * {sources[source]}")
                slopes.append(slope)
        statements.append(f"{target} = {' + '.join(terms) or '0.0'};")
    return JacobianProduct(
        slopes=ca.Function(
            f"{function.name()}_slopes",
            list(symbols.values()),
            [ca.densify(ca.vertcat(*slopes))],
            list(symbols),
            ["slopes"],
            {"cse": True},
        ),
        statements=statements,
        still=frozenset(vertex for vertex in targets if not graph.into.get(vertex)),
    )
