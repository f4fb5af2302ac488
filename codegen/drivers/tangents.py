"""Jacobian-vector products of a function by vertex elimination: partial derivatives once, and products per direction.

The linearised computational graph of the function is reduced to few edges. An edge is a partial derivative, and costs a
product per direction. A Jacobian is the graph without inner vertices; if many dependences pass through few values, a
graph that keeps these has far fewer edges (A. Griewank, O. Vogel: Analysis and exploitation of Jacobian scarcity,
2005).
"""

import heapq
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from dualwinch.codegen.source.expressions import applied, built_once, instructions, operands_of

Vertex = Hashable


class LinearisedGraph:
    """Partial derivatives of a function's elements by each other.

    Attributes:
        into: vertex → the vertices it depends on → the partial derivatives. Inputs and outputs are ``(name, element)``,
            inner vertices the numbers of instructions.
    """

    def __init__(
        self,
        function: ca.Function,
        symbols: dict[str, ca.SX],
        active: Collection[Vertex],
        outputs: Collection[str],
        fixed: Collection[str] = (),
    ) -> None:
        """Build the graph.

        Args:
            function: function of dense SX expressions.
            symbols: symbols of its inputs, for the expressions of the derivatives.
            active: elements of inputs, ``(name, element)``, to differentiate by.
            outputs: names of the outputs to differentiate.
            fixed: names of inputs that are constant over the calls; partial derivatives that depend on these alone, and
                their products, cost nothing.
        """
        self.into: dict[Vertex, dict[Vertex, ca.SX]] = {}
        self._out_of: dict[Vertex, set[Vertex]] = {}
        self._fixed: set[int] = set()
        names_in, names_out = function.name_in(), function.name_out()
        vertices: dict[int, Vertex | None] = {}
        values: dict[int, ca.SX] = {}
        operands = operands_of(function)
        for step, instruction in enumerate(instructions(function)):
            operation, made_of = instruction.operation, operands.get(step, ())
            if operation == ca.OP_INPUT:
                vector, element = instruction.read
                source = names_in[vector], element
                values[step] = symbols[source[0]][element]
                vertices[step] = source if source in active else None
                if source[0] in fixed:
                    self._fixed.add(step)
            elif operation == ca.OP_CONST:
                values[step], vertices[step] = ca.SX(instruction.constant), None
                self._fixed.add(step)
            elif operation == ca.OP_OUTPUT:
                vector, element = instruction.written
                target, source = (names_out[vector], element), vertices[made_of[0]]
                if target[0] in outputs and source is not None:
                    self._connect(source, target, ca.SX(1))
            else:
                arguments = [values[operand] for operand in made_of]
                values[step] = applied(operation, arguments)
                if self._fixed.issuperset(made_of):
                    self._fixed.add(step)
                depends = self._connect_operands([vertices[operand] for operand in made_of], operation, arguments, step)
                vertices[step] = step if depends else None
        self._drop_unused()

    def _connect_operands(
        self, sources: list[Vertex | None], operation: int, operands: list[ca.SX], target: Vertex
    ) -> bool:
        """Connect an operation's result with its operands; whether it depends on any active input."""
        if not any(source is not None for source in sources):
            return False
        slopes = zip(sources, _partials(operation, operands), strict=True)
        active = [(source, slope) for source, slope in slopes if source is not None and not slope.is_zero()]
        for source, slope in active:
            self._connect(source, target, slope)
        return bool(active)

    def _connect(self, source: Vertex, target: Vertex, slope: ca.SX) -> None:
        edges = self.into.setdefault(target, {})
        edges[source] = edges[source] + slope if source in edges else slope
        self._out_of.setdefault(source, set()).add(target)

    def inner(self) -> list[int]:
        """The inner vertices."""
        return [vertex for vertex in self.into if isinstance(vertex, int)]

    def _drop_unused(self) -> None:
        """Remove vertices on which no output depends."""
        for vertex in reversed(self.inner()):
            if not self._out_of.get(vertex):
                self._remove(vertex)

    def _remove(self, vertex: Vertex) -> None:
        for source in self.into.pop(vertex):
            self._out_of[source].discard(vertex)
        for target in self._out_of.pop(vertex, ()):
            del self.into[target][vertex]

    def _growth(self, vertex: Vertex) -> tuple[int, int]:
        """Number of additional edges after elimination of a vertex, and of products for it."""
        sources, targets = self.into[vertex], self._out_of[vertex]
        new = sum(source not in self.into[target] for target in targets for source in sources)
        return new - len(sources) - len(targets), len(sources) * len(targets)

    def accumulate(self) -> None:
        """Eliminate every vertex, the one with the fewest products first (Markowitz), so that a Jacobian is left.

        With many columns that takes a fraction of the operations of a sweep for each (Griewank and Walther,
        *Evaluating Derivatives*, 2008, Chapter 9).
        """
        heap = [(self._growth(vertex)[1], vertex) for vertex in self.inner()]
        heapq.heapify(heap)
        while heap:
            products, vertex = heapq.heappop(heap)
            if vertex not in self.into:
                continue
            now = self._growth(vertex)[1]
            if now > products:
                heapq.heappush(heap, (now, vertex))
                continue
            self._take_out(vertex)

    def eliminate(self) -> None:
        """Eliminate vertices while that does not increase the number of edges, the greatest reduction first.

        Fixed vertices that lead to fixed values only are eliminated first in any case.
        """
        for vertex in self.inner():
            if vertex in self._fixed and self._fixed.issuperset(self._out_of[vertex]):
                self._take_out(vertex)
        heap = [(*self._growth(vertex), vertex) for vertex in self.inner()]
        heapq.heapify(heap)
        while heap and heap[0][0] <= 0:
            growth, products, vertex = heapq.heappop(heap)
            if vertex not in self.into or (growth, products) != self._growth(vertex):
                continue  # an obsolete entry
            into, slopes = self._take_out(vertex)
            near = {*into, *slopes}
            near |= {target for source in into for target in self._out_of[source]}
            near |= {source for target in slopes for source in self.into[target]}
            for other in near:
                if isinstance(other, int):
                    heapq.heappush(heap, (*self._growth(other), other))

    def _take_out(self, vertex: int) -> tuple[dict[Vertex, ca.SX], dict[Vertex, ca.SX]]:
        """Eliminate a vertex: connect its sources with its targets; returns both, with their partial derivatives."""
        into = self.into[vertex]
        slopes = {target: self.into[target][vertex] for target in self._out_of[vertex]}
        self._remove(vertex)
        for target, slope in slopes.items():
            for source, before in into.items():
                self._connect(source, target, slope * before)
        return into, slopes


def _partials(operation: int, operands: list[ca.SX]) -> list[ca.SX]:
    """The partial derivatives of an operation with respect to its operands."""
    if operation == ca.OP_MUL:  # the most frequent operations without a call
        return operands[::-1]
    if operation in {ca.OP_ADD, ca.OP_SUB}:
        return [ca.SX(1), ca.SX(1 if operation == ca.OP_ADD else -1)]
    return _derivatives(operation, len(operands)).call(operands)


@built_once
def _derivatives(operation: int, count: int) -> ca.Function:
    operands = [ca.SX.sym(f"operand_{operand}") for operand in range(count)]
    value = applied(operation, operands)
    return ca.Function("partials", operands, [ca.jacobian(value, operand) for operand in operands])


def accumulated_jacobian(
    function: ca.Function, inputs: Mapping[str, ca.SX], columns: Sequence[Vertex], output: str
) -> ca.SX:
    """The Jacobian of an output with respect to elements of inputs, by vertex elimination, dense.

    Args:
        function: function of dense SX expressions.
        inputs: name → its symbols.
        columns: elements of inputs, ``(name, element)``, in the order of the Jacobian's columns.
        output: name of the output.
    """
    graph = LinearisedGraph(function, dict(inputs), set(columns), [output])
    graph.accumulate()
    number = {column: k for k, column in enumerate(columns)}
    jacobian = ca.SX.zeros(function.numel_out(output), len(columns))
    for row in range(jacobian.shape[0]):
        for source, slope in graph.into.get((output, row), {}).items():
            jacobian[row, number[source]] = slope
    return jacobian


@dataclass(frozen=True)
class Tangents:
    """The tangents of an input.

    Attributes:
        array: name of their array in C.
        elements: elements of the input with tangents; None: all.
        packed: whether the array holds only those; else it holds all.
    """

    array: str
    elements: Sequence[int] | None = None
    packed: bool = True


@dataclass(frozen=True)
class JacobianProduct:
    """The product of a function's Jacobian with tangents, in two parts.

    Attributes:
        slopes: ``NAME_slopes(...) -> slopes``: from the function's inputs, the non-constant partial derivatives.
        joints: names of the inner vertices.
        terms: C text of a vector of tangents, of a joint or an output → the terms of its sum, each with the array of
            the tangents that it multiplies.
        still: elements of outputs, ``(name, element)``, with zero tangents.
    """

    slopes: ca.Function
    joints: tuple[str, ...]
    terms: Mapping[str, Sequence[tuple[str, str]]]
    still: frozenset[Vertex]

    def statements(self, without: str = "") -> list[str]:
        """C statements that compute the outputs' tangents, ``OUTPUT_tangent``, from slopes and the inputs' tangents.

        The stride of the slopes' elements is LANES by default; an element's tangents along all directions are VECTORS
        vectors, of which TOGETHER are computed (`vectors.h`).

        Args:
            without: array of tangents that are zero.
        """
        lines = [f"Vector {', '.join(f'{joint}[TOGETHER]' for joint in self.joints)};"] if self.joints else []
        for target, terms in self.terms.items():
            total = " + ".join(term for array, term in terms if array != without)
            lines.append(f"EACH_VECTOR {target} = {total or 'ZEROS'};")
        return lines


def jacobian_product(
    function: ca.Function, along: Mapping[str, Tangents], outputs: Sequence[str], lanes: str = "LANES"
) -> JacobianProduct:
    """The Jacobian-vector product of a function: its slopes, and statements that multiply tangents by them.

    Args:
        function: function of dense SX expressions.
        along: input name → its tangents.
        outputs: names of the outputs to differentiate.
        lanes: stride of the slopes' elements, as C text.
    """
    symbols = {name: ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()}
    arrays: dict[Vertex, str] = {}
    elements: dict[Vertex, str] = {}
    for name, tangents in along.items():
        indices = range(function.size1_in(name)) if tangents.elements is None else tangents.elements
        for place, element in enumerate(indices) if tangents.packed else zip(indices, indices, strict=True):
            arrays[name, element] = tangents.array
            elements[name, element] = f"{tangents.array}[{place}*VECTORS + v]"
    graph = LinearisedGraph(function, symbols, elements, outputs, ["parameters"])
    graph.eliminate()

    joints = {vertex: f"joint_{k}" for k, vertex in enumerate(sorted(graph.inner()))}
    arrays |= joints
    elements |= {vertex: f"{name}[v]" for vertex, name in joints.items()}
    targets: dict[Vertex, str] = {vertex: elements[vertex] for vertex in joints}
    targets |= {
        (name, element): f"{name}_tangent[{element}*VECTORS + v]"
        for name in outputs
        for element in range(function.numel_out(name))
    }
    slopes: list[ca.SX] = []
    terms: dict[str, list[tuple[str, str]]] = {target: [] for target in targets.values()}
    for vertex, target in targets.items():
        for source, slope in graph.into.get(vertex, {}).items():
            factor = ""
            if not slope.is_constant():
                factor = f"slopes[{len(slopes)}*{lanes}] * "
                slopes.append(slope)
            elif not slope.is_one():
                factor = f"{float(slope)!r} * "
            if not slope.is_zero():
                terms[target].append((arrays[source], factor + elements[source]))
    return JacobianProduct(
        slopes=ca.Function(
            f"{function.name()}_slopes",
            list(symbols.values()),
            [ca.densify(ca.vertcat(*slopes))],
            list(symbols),
            ["slopes"],
            {"cse": True},
        ),
        joints=tuple(joints.values()),
        terms=terms,
        still=frozenset(vertex for vertex in targets if not graph.into.get(vertex)),
    )
