"""Runs Structured Text: blark's parse tree as closures over IEEE 754 numbers; shares no code with the product.

A frame is a dictionary of lower-case names; structures and instances of function blocks are frames of their own, arrays
are lists. Lines that are a statement each are parsed once for every shape they have, as blark takes a millisecond for
some letters: names and indices are put in afterwards. What they may be called, their declarations say.
"""

import ctypes
import ctypes.util
import dataclasses
import gc
import operator
import re
from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from blark import transform as st
from blark.parse import parse_source_code

Frame: TypeAlias = dict[str, Any]
Closure: TypeAlias = Callable[[Frame], Any]

LIBM = ctypes.CDLL(ctypes.util.find_library("m"))
REALS: dict[str, Any] = {"LREAL": np.float64, "REAL": np.float32}
OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "=": operator.eq,
    "<>": operator.ne,
    "AND": lambda left, right: bool(left) and bool(right),
    "OR": lambda left, right: bool(left) or bool(right),
}


def _of_libm(name: str) -> Callable[[Any], Any]:
    """A function of the C library in either precision."""
    double, single = LIBM[name], LIBM[f"{name}f"]
    double.restype, double.argtypes = ctypes.c_double, [ctypes.c_double]
    single.restype, single.argtypes = ctypes.c_float, [ctypes.c_float]

    def call(x: Any) -> Any:
        return np.float32(single(x)) if x.dtype == np.float32 else np.float64(double(x))

    return call


FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "ABS": abs,
    "SQRT": np.sqrt,
    "EXP": _of_libm("exp"),
    "LN": _of_libm("log"),
    **{name.upper(): _of_libm(name) for name in ("sin", "cos", "tan", "asin", "acos", "atan")},
}


def parsed(source: str) -> st.SourceCode:
    """The tree of a source; an error where it is no Structured Text."""
    gc.disable()  # an Earley parser keeps all that it makes
    try:
        result = parse_source_code(source)
    finally:
        gc.enable()
    if result.exception:
        raise result.exception
    return result.transform()


LINE = re.compile(r" +([\w.\[\]]+ := [^;]*;|IF [^;]* THEN [^;]*; ELSE [^;]*; END_IF;)")
"""A line that is a statement."""

WORDS = "IF|THEN|ELSE|END_IF|AND|OR|NOT|TRUE|FALSE|L?REAL"
NAME = re.compile(rf"(?<=\[)\d+(?=\])|\b(?!(?:{WORDS})\b)[A-Za-z_]\w*\b(?! *\()")
"""An index, or a name that is none of a function."""

RUN = "lines_"
"""What the names begin with of variables in whose place lines go."""


def with_runs(source: str) -> tuple[str, dict[str, list[str]]]:
    """A source with one assignment in the place of lines that follow each other, and these by its variable."""
    text, runs, before = list[str](), dict[str, list[str]](), False
    for line in source.splitlines():
        if found := LINE.fullmatch(line):
            if not before:
                text.append(f"{RUN}{len(runs)} := 0;")
                runs[f"{RUN}{len(runs)}"] = []
            runs[f"{RUN}{len(runs) - 1}"].append(found[1])
        else:
            text.append(line)
        before = bool(found)
    return "\n".join(text), runs


def statement_of(line: str) -> Any:
    """The tree of a line that is a statement."""
    names = dict[str, str]()

    def stand_in(found: re.Match[str]) -> str:
        name = f"{90000 + len(names)}" if found[0].isdigit() else f"name_{len(names)}"
        names[name] = found[0]
        return name

    return renamed(_shape(NAME.sub(stand_in, line)), names)


@cache
def _shape(line: str) -> Any:
    (item,) = parsed(f"FUNCTION_BLOCK shape\n{line}\nEND_FUNCTION_BLOCK\n").items
    body: Any = item
    (statement,) = body.body.statements
    return statement


def renamed(node: Any, names: dict[str, str]) -> Any:
    """A tree with other names in the place of some."""
    if isinstance(node, str):
        return names.get(node, node)
    if isinstance(node, list | tuple):
        return [renamed(each, names) for each in node]
    if not dataclasses.is_dataclass(node) or isinstance(node, type):
        return node
    other = object.__new__(type(node))
    other.__dict__.update({key: value if key == "meta" else renamed(value, names) for key, value in vars(node).items()})
    return other


def copied(value: Any) -> Any:
    """A value that changes with no other."""
    if isinstance(value, dict):
        return {key: copied(part) for key, part in value.items()}
    return [copied(part) for part in value] if isinstance(value, list) else value


class Machine:
    """The types and POUs of a source; ``machine.new(name)`` is an instance of a function block."""

    def __init__(self, source: str) -> None:
        self.structures: dict[str, st.StructureTypeDeclaration] = {}
        self.pous: dict[str, Any] = {}
        text, self._runs = with_runs(source)
        for item in parsed(text).items:
            if isinstance(item, st.DataTypeDeclaration):
                assert isinstance(item.declaration, st.StructureTypeDeclaration)
                self.structures[str(item.declaration.name).lower()] = item.declaration
            else:
                self.pous[str(item.name).lower()] = item
        self._bodies: dict[str, list[Closure]] = {}

    def new(self, name: str) -> Frame:
        """A frame with the variables of a POU as they begin."""
        frame: Frame = {"": name.lower()}
        for block in self.pous[name.lower()].declarations:
            if not isinstance(block, st.InputOutputDeclarations):
                for item in block.items:
                    self._declare(frame, item)
        return frame

    def call(self, frame: Frame, **inputs: Any) -> None:
        """Call an instance with some inputs."""
        for key, value in inputs.items():
            frame[key.lower()] = value
        with np.errstate(all="ignore"):
            self._run(frame)

    def _run(self, frame: Frame) -> None:
        name = frame[""]
        if name not in self._bodies:
            self._bodies[name] = self._statements(self.pous[name].body)
        for statement in self._bodies[name]:
            statement(frame)

    def _declare(self, frame: Frame, item: Any) -> None:
        for declared in item.variables:
            name = str(getattr(getattr(declared, "variable", declared), "name", declared)).lower()
            if isinstance(item, st.FunctionBlockNameDeclaration):
                frame[name] = self._initial(str(item.spec))
                continue
            init = item.init
            if isinstance(init, st.ArrayTypeInitialization):
                subrange: Any = init.spec.subranges[0]
                low, high = (int(str(end)) for end in (subrange.start, subrange.stop))
                assert low == 0
                frame[name] = [self._initial(str(init.spec.type)) for _ in range(high + 1)]
            else:
                kind = str(init.spec.type)
                value = getattr(init, "value", None)
                frame[name] = self._expression(value)(frame) if value is not None else self._initial(kind)

    def _initial(self, kind: str) -> Any:
        if kind in REALS:
            return REALS[kind](0)
        if kind in {"BOOL", "INT"}:
            return {"BOOL": False, "INT": 0}[kind]
        if kind.lower() in self.pous:
            return self.new(kind)
        frame: Frame = {}
        for item in self.structures[kind.lower()].declarations:
            self._declare(frame, item)
        return frame

    def _statements(self, block: Any) -> list[Closure]:
        found = list[Closure]()
        for each in block.statements if block else []:
            run = None
            if isinstance(each, st.AssignmentStatement):
                run = self._runs.get(str(getattr(each.variables[0], "name", "")))
            found += [self._statement(tree) for tree in ([each] if run is None else map(statement_of, run))]
        return found

    def _statement(self, node: Any) -> Closure:
        if isinstance(node, st.AssignmentStatement):
            (variable,) = node.variables
            return self._assignment(variable, self._expression(node.expression))
        if isinstance(node, st.IfStatement):
            return self._choice(node)
        if isinstance(node, st.ForStatement):
            return self._loop(node)
        assert isinstance(node, st.FunctionCallStatement), type(node)
        return self._instance_call(node)

    def _assignment(self, variable: Any, value: Closure) -> Closure:
        if isinstance(variable, st.SimpleVariable):
            name = str(variable.name).lower()

            def assign(frame: Frame) -> None:
                frame[name] = copied(value(frame))

            return assign
        *path, last = self._path(variable)

        def assign_part(frame: Frame) -> None:
            owner: Any = frame
            for part in path:
                owner = owner[part]
            owner[last] = copied(value(frame))

        return assign_part

    def _choice(self, node: st.IfStatement) -> Closure:
        parts = [node, *node.else_ifs]
        branches = [(self._expression(part.if_expression), self._statements(part.statements)) for part in parts]
        otherwise = self._statements(node.else_clause.statements) if node.else_clause else []

        def choose(frame: Frame) -> None:
            chosen = next((statements for condition, statements in branches if condition(frame)), otherwise)
            for statement in chosen:
                statement(frame)

        return choose

    def _loop(self, node: st.ForStatement) -> Closure:
        name, body = str(node.control.name).lower(), self._statements(node.statements)
        start, end = self._expression(node.from_), self._expression(node.to)

        def loop(frame: Frame) -> None:
            for value in range(start(frame), end(frame) + 1):
                frame[name] = value
                for statement in body:
                    statement(frame)

        return loop

    def _instance_call(self, node: Any) -> Closure:
        name = str(node.name.name).lower()
        given = [(str(each.name.name).lower(), self._expression(each.value)) for each in node.parameters]

        def call(frame: Frame) -> None:
            instance = frame[name]
            for key, value in given:
                shared = key in self._shared(instance[""])
                instance[key] = value(frame) if shared else copied(value(frame))
            self._run(instance)

        return call

    def _shared(self, pou: str) -> set[str]:
        blocks = (each for each in self.pous[pou].declarations if isinstance(each, st.InputOutputDeclarations))
        items: list[Any] = [item for block in blocks for item in block.items]
        return {str(each.variable.name).lower() for item in items for each in item.variables}

    def _path(self, node: Any) -> list[Any]:
        path: list[Any] = [str(node.name.name).lower()]
        for element in node.elements:
            if isinstance(element, st.FieldSelector):
                path.append(str(element.field.name).lower())
            else:
                path.append(int(str(element.subscripts[0])))
        return path

    def _expression(self, node: Any) -> Closure:
        made: dict[type, Callable[[Any], Closure]] = {
            st.Real: self._literal,
            st.Integer: self._literal,
            st.Boolean: self._literal,
            st.ParenthesizedExpression: lambda inside: self._expression(inside.expr),
            st.UnaryOperation: self._unary,
            st.BinaryOperation: self._binary,
            st.FunctionCall: self._function,
            st.SimpleVariable: lambda variable: operator.itemgetter(str(variable.name).lower()),
            st.MultiElementVariable: self._part,
        }
        return made[type(node)](node)

    def _literal(self, node: Any) -> Closure:
        text = str(node.value)
        if isinstance(node, st.Real):
            value: Any = REALS[str(node.type_name)](text)
        else:
            value = int(text) if isinstance(node, st.Integer) else text.upper() == "TRUE"
        return lambda _: value

    def _unary(self, node: st.UnaryOperation) -> Closure:
        inner = self._expression(node.expr)
        return {"-": lambda frame: -inner(frame), "NOT": lambda frame: not inner(frame)}[str(node.op).upper()]

    def _binary(self, node: st.BinaryOperation) -> Closure:
        left, right = self._expression(node.left), self._expression(node.right)
        apply = OPERATORS[str(node.op).upper()]
        return lambda frame: apply(left(frame), right(frame))

    def _part(self, node: st.MultiElementVariable) -> Closure:
        first, *path = self._path(node)

        def part_of(frame: Frame) -> Any:
            owner = frame[first]
            for part in path:
                owner = owner[part]
            return owner

        return part_of

    def _function(self, node: st.FunctionCall) -> Closure:
        name = str(node.name.name)
        given: Any = node.parameters[0]
        argument = self._expression(given.value)
        if name.upper() in FUNCTIONS:
            function = FUNCTIONS[name.upper()]
            return lambda frame: function(argument(frame))

        def call(frame: Frame) -> Any:
            own = self.new(name)
            own["value"] = argument(frame)
            self._run(own)
            return own[name.lower()]

        return call
