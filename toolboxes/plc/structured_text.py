"""A block as function blocks of IEC 61131-3: the counterpart of `codegen.export.package` for PLCs.

The functions and the order of their statements are those of the C package, so that doubles agree to the last bit where
the PLC's EXP, LN, SIN and COS agree with those of the C library.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca

from dualwinch.toolbox import blocks, errors, language, package
from dualwinch.toolboxes.plc.operations import WORK, StructuredText, floor_function, work_variables
from dualwinch.toolboxes.plc.plcopen import plcopen_xml
from dualwinch.toolboxes.plc.project import (
    FLAVOURS,
    Flavour,
    PlcProject,
    PlcVariable,
    Pou,
    Structure,
    files_of,
    identifier,
)

TEMPLATES = Path(__file__).parent / "templates"

MAX_OPERATIONS = 20_000
"""Default limit of operations per call: 2 ms at 0.1 µs each."""

COUNTED = {
    "multiplications": {ca.OP_MUL, ca.OP_SQ, ca.OP_TWICE},
    "divisions": {ca.OP_DIV, ca.OP_INV},
    "square roots": {ca.OP_SQRT},
    "EXP, LN, SIN, …": {ca.OP_EXP, ca.OP_LOG, ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN},
    "additions": {ca.OP_ADD, ca.OP_SUB, ca.OP_NEG},
}
"""Operations of different duration; the rest are comparisons and choices."""


@dataclass(frozen=True)
class OperationCount:
    """Operations of a function by their kind.

    Attributes:
        kinds: kind → count.
    """

    kinds: dict[str, int]

    @property
    def total(self) -> int:
        """Total count."""
        return sum(self.kinds.values())

    @property
    def words(self) -> str:
        """Counts by kind, in words."""
        return ", ".join(f"{count} {kind}" for kind, count in self.kinds.items() if count)


def operation_count(function: ca.Function) -> OperationCount:
    """Count the operations of a function of SX expressions, without constants and copies."""
    idle = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
    every = Counter(
        instruction.operation for instruction in language.instructions(function) if instruction.operation not in idle
    )
    kinds = {kind: sum(every.pop(operation, 0) for operation in operations) for kind, operations in COUNTED.items()}
    return OperationCount(kinds | {"comparisons and choices": sum(every.values())})


def st_package(
    block: blocks.Block,
    name: str,
    provenance: package.Provenance,
    precision: str = "double",
    *,
    flavour: str = "iec",
    max_operations: int = MAX_OPERATIONS,
) -> dict[str, str]:
    """The files of a package by name: source text, PLCopen XML and a README.

    Args:
        block: a block with parameters.
        name: an identifier, the prefix of every name.
        provenance: written into comments and README.
        precision: ``double`` (LREAL) or ``float`` (REAL).
        flavour: dialect, one of `FLAVOURS`.
        max_operations: limit of operations per call.

    Raises:
        CodegenError: an unknown precision or flavour, a block of more operations, or an operation or names that
            Structured Text does not have.
    """
    if precision not in language.PRECISIONS:
        raise errors.CodegenError(f"unknown precision '{precision}': must be {' or '.join(language.PRECISIONS)}")
    dialects: dict[str, Flavour] = {name: name for name in FLAVOURS}
    dialect = dialects.get(flavour)
    if dialect is None:
        raise errors.CodegenError(f"unknown flavour '{flavour}': must be {' or '.join(FLAVOURS)}")
    writer = _Package(block, name, provenance, precision, dialect)
    count = operation_count(writer.apart.step)
    if count.total > max_operations:
        raise errors.CodegenError(
            f"{block.name}: {count.total} operations per call; must be <= {max_operations} (--max-operations)"
        )
    project = writer.project()
    files = files_of(project, dialect)
    if flavour != "siemens-scl":
        files[f"{name}.xml"] = plcopen_xml(project, dialect)
    facts = {
        "block": block,
        "name": name,
        "provenance": provenance,
        "flavour": flavour,
        "real": writer.style.real,
        "files": tuple(files),
        "step": count,
        "prepare": operation_count(writer.apart.derive),
        "numbers": writer.numbers(project),
        "identifier": writer.named,
        "silent": 2 * blocks.NO_READING,
        "duration": project.duration,
    }
    return files | {"README.md": package.templates(precision, TEMPLATES).get_template("README.md.j2").render(facts)}


class _Package:
    """The parts of the package of a block."""

    def __init__(
        self,
        block: blocks.Block,
        name: str,
        provenance: package.Provenance,
        precision: language.Precision,
        flavour: Flavour,
    ) -> None:
        self.block, self.name, self.provenance = block, name, provenance
        self.flavour: Flavour = flavour
        self.style = StructuredText(precision, compares=True, functions=name)
        self.apart: package.PreparedBlock = package.prepared(block, precision)
        for function in self.apart.functions:
            if reason := language.lacking(function):
                raise errors.CodegenError(f"no Structured Text for {function.name()}: {reason}")
        if not block.parameters:
            raise errors.CodegenError(f"{block.name}: no Structured Text of a block without parameters")

    def named(self, variable: blocks.Variable) -> str:
        """Identifier of a variable."""
        return identifier(variable.name, self.flavour)

    def project(self) -> PlcProject:
        """All types and POUs."""
        block, origin = self.block, self.provenance
        about = (
            f"{self.name}: {block.description}, one sample per call.",
            f"Generated by {origin.product} on {origin.date}; configuration {origin.configuration}.",
            f"{self.style.real} throughout; {operation_count(self.apart.step).total} operations per call.",
        )
        structures = self._structures()
        pous, program = (self._prepare(), self._sample(), self._block()), self._program()
        floors = any(f"{self.name}_floor(" in line for pou in pous for line in pou.body)
        for part in structures:
            _check_names(part.name, (part.members,))
        for pou in (*pous, program):
            _check_names(pou.name, pou.sections.values())
        return PlcProject(
            self.name,
            about,
            structures,
            (self._floor(), *pous) if floors else pous,
            program,
            block.sample_time,
            (origin.product, origin.date),
        )

    def numbers(self, project: PlcProject) -> int:
        """Number of values in an instance of the block, those of its parts included."""
        of_structure: dict[str, int] = {}

        def count(variables: Iterable[PlcVariable]) -> int:
            return sum(_elements(variable.type, of_structure) for variable in variables)

        for part in project.structures:
            of_structure[part.name] = count(part.members)
        for pou in project.pous:
            sections = pou.sections.items()
            of_structure[pou.name] = sum(count(members) for section, members in sections if section != "VAR_IN_OUT")
        return of_structure[self.name]

    def _variable(self, variable: blocks.Variable, *, value: bool = True, source: bool = False) -> PlcVariable:
        start = self.style.number(variable.start) if value else ""
        return PlcVariable(self.named(variable), self.style.real, start, package.described(variable, value=source))

    def _structures(self) -> tuple[Structure, ...]:
        block, name, real = self.block, self.name, self.style.real
        derived, lost = self.apart.derived, self.apart.lost
        members = [PlcVariable(self.named(variable), real) for variable in self.apart.parameters]
        follows = PlcVariable("derived", f"ARRAY[0..{derived - 1}] OF {real}", "", "derived from parameters")
        valid = PlcVariable("valid", "BOOL", "FALSE", "whether this has been prepared")
        took = PlcVariable("lost", f"ARRAY[0..{lost - 1}] OF {real}", "", "rounding errors of sums")
        output = PlcVariable("output", f"{name}_output", "", "of this state" if block.output else "of the last sample")
        return (
            Structure(f"{name}_input", tuple(map(self._variable, block.inputs)), "Inputs, with their values at rest."),
            Structure(
                f"{name}_parameters",
                tuple(self._variable(variable, source=True) for variable in block.parameters),
                "Parameters: unit, meaning, bounds, value (source).",
            ),
            Structure(
                f"{name}_prepared",
                (*members, *([follows] if derived else []), valid),
                f"Values for a sample that depend on the parameters alone, computed by {name}_prepare.",
            ),
            Structure(f"{name}_output", tuple(map(self._variable, block.outputs)), "Outputs."),
            Structure(
                f"{name}_state",
                (*map(self._variable, block.states), output, *([took] if lost else [])),
                "The state, with its output.",
            ),
        )

    def _elements(self) -> tuple[language.Element, language.Element, language.Element]:
        """Expressions of elements: in a sample, at the start, and in the preparation of parameters."""
        block = self.block
        vectors = {
            "state": ("state.", block.states),
            "input": ("now.", block.inputs),
            "parameters": ("prepared.", block.parameters),
            "next_state": ("next.", block.states),
            "output": ("next.output.", block.outputs),
        }
        arrays = {"lost": "state.lost", "next_lost": "next.lost", "derived": "prepared.derived"}
        initial = vectors | {"parameters": ("own.", block.parameters), "output": ("state.output.", block.outputs)}
        parameter_vectors = {"parameters": ("parameters.", block.parameters)}
        return (
            package.of_structures(vectors, arrays, self.named),
            package.of_structures(initial, {"derived": "own.derived"}, self.named),
            package.of_structures(parameter_vectors, {"derived": "prepared.derived"}, self.named),
        )

    def _work(self, lines: Sequence[str]) -> tuple[PlcVariable, ...]:
        turn = [PlcVariable("turn", "INT")] if any("FOR turn" in line for line in lines) else []
        return (*turn, *(PlcVariable(name, self.style.real) for name in work_variables(lines)))

    def _finite(self, names: Sequence[str]) -> list[str]:
        """Statements that check whether all variables are finite."""
        tests = [self.style.is_finite(name) for name in names]
        return [f"finite := {'finite AND ' * (number > 0)}{test};" for number, test in enumerate(tests)]

    def _floor(self) -> Pou:
        name, body = floor_function(self.style)
        real = self.style.real
        sections = {"VAR_INPUT": (PlcVariable("value", real),), "VAR": (PlcVariable("whole", real),)}
        return Pou("FUNCTION", name, "The largest whole number up to a value.", sections, tuple(body), real)

    def _prepare(self) -> Pou:
        block, name = self.block, self.name
        derive = language.rolled_statements(self.apart.derive, self.style, [language.Strand(self._elements()[2], WORK)])
        relations = self._relations()
        body = [
            *self._invalid(relations),
            "IF invalid_parameter = 0 THEN",
            *(
                f"  prepared.{self.named(parameter)} := parameters.{self.named(parameter)};"
                for parameter in self.apart.parameters
            ),
            *derive,
            "  prepared.valid := TRUE;",
            "  status := 0;",
            "ELSE",
            "  status := 2;",
            "END_IF;",
        ]
        return Pou(
            "FUNCTION_BLOCK",
            f"{name}_prepare",
            "Values that depend on the parameters alone; unchanged if a parameter is invalid (status 2).",
            {
                "VAR_INPUT": (PlcVariable("parameters", f"{name}_parameters"),),
                "VAR_OUTPUT": (
                    PlcVariable("prepared", f"{name}_prepared"),
                    PlcVariable("status", "INT", "0"),
                    PlcVariable("invalid_parameter", "INT", "0", "position of the first invalid one, from 1; 0: none"),
                ),
                "VAR": (
                    *(
                        [PlcVariable("holds", f"ARRAY[0..{len(block.ruled) - 1}] OF {self.style.real}")]
                        if relations
                        else []
                    ),
                    *self._work([*relations, *derive]),
                ),
            },
            tuple(body),
        )

    def _relations(self) -> list[str]:
        """Statements of the requirements on parameters beyond their bounds: `holds`, 1 where each does."""
        if not self.apart.rules:
            return []
        strand = language.Strand(self._elements()[2], WORK)
        return language.statements(self.apart.rules, self.style, [strand], in_place=True)

    def _invalid(self, relations: Sequence[str]) -> list[str]:
        """Statements that find the position of the first invalid parameter, which is assigned last."""
        block, zero = self.block, self.style.number(0)
        positions = {variable.name: position for position, variable in enumerate(block.parameters, start=1)}
        refusals = [
            f"  IF NOT (holds[{row}] > {zero}) THEN invalid_parameter := {positions[name]}; END_IF;"
            for row, name in enumerate(block.ruled)
        ]
        related = ["IF invalid_parameter = 0 THEN", *relations, *reversed(refusals), "END_IF;"] if relations else []
        rows = list[str]()
        for variable in block.parameters:
            path = f"parameters.{self.named(variable)}"
            conditions = [self.style.is_finite(path)]
            conditions += [f"({path} {bound})" for bound in package.bounds(variable, self.style.number)]
            rows.append(
                f"IF NOT ({' AND '.join(conditions)}) THEN invalid_parameter := {positions[variable.name]}; END_IF;"
            )
        return ["invalid_parameter := 0;", *reversed(rows), *related]

    def _sample(self) -> Pou:
        name, block = self.name, self.block
        lines = language.statements(
            self.apart.step, self.style, [language.Strand(self._elements()[0], WORK)], in_place=True
        )
        results = [f"next.{self.named(variable)}" for variable in block.states]
        results += [f"next.output.{self.named(variable)}" for variable in block.outputs]
        return Pou(
            "FUNCTION_BLOCK",
            f"{name}_sample",
            "One sample: `next` from the last state, and whether it is finite.",
            {
                "VAR_OUTPUT": (PlcVariable("finite", "BOOL"),),
                "VAR_IN_OUT": (
                    PlcVariable("state", f"{name}_state"),
                    PlcVariable("now", f"{name}_input"),
                    PlcVariable("prepared", f"{name}_prepared"),
                    PlcVariable("next", f"{name}_state"),
                ),
                "VAR": self._work(lines),
            },
            (*(line.strip() for line in lines), *self._finite(results)),
        )

    def _block(self) -> Pou:
        block, name = self.block, self.name
        start = self._start()
        outputs = [self.named(variable) for variable in block.outputs]
        start_values = [f"state.output.{self.named(out)} := {self.style.number(out.start)};" for out in block.outputs]
        lost = [f"state.lost[{k}] := {self.style.number(0)};" for k in range(self.apart.lost)]
        call = "sample(state := state, now := now, prepared := own, next := next);"
        body = [
            "(* the parameters *)",
            "IF use_prepared AND prepared.valid THEN own := prepared; END_IF;",
            "IF prepare OR NOT own.valid THEN",
            "  preparation(parameters := parameters);",
            "  parameter_status := preparation.status;",
            "  invalid_parameter := preparation.invalid_parameter;",
            "  IF parameter_status = 0 THEN own := preparation.prepared; END_IF;",
            "END_IF;",
            "(* the state before the first sample *)",
            "IF reset OR NOT started THEN",
            *(f"  {line}" for line in (*start_values, *lost)),
            *(f"  state.{self.named(each)} := {self.style.number(each.start)};" for each in block.states),
            "  IF own.valid THEN",
            *(f"    {line.strip()}" for line in start),
            *(
                []
                if block.output
                else [
                    *(f"    now.{self.named(each)} := {self.style.number(each.start)};" for each in block.inputs),
                    f"    {call}",
                    "    state.output := next.output;",
                ]
            ),
            "    started := TRUE;",
            "  END_IF;",
            "END_IF;",
            "(* one sample *)",
            *self._heard(),
            *self._finite([f"now.{self.named(variable)}" for variable in block.inputs]),
            "IF NOT finite THEN",
            "  status := 1;",
            "ELSIF NOT own.valid THEN",
            "  status := 2;",
            "ELSE",
            f"  {call}",
            "  IF sample.finite THEN",
            "    state := next;",
            "    status := 0;",
            "  ELSE",
            "    status := 3;",
            *(f"    {line}" for line in lost),
            "  END_IF;",
            "END_IF;",
            "IF status <> 0 THEN",
            *(f"  {line}" for line in self._finite([f"state.output.{each}" for each in outputs])),
            "  IF NOT finite THEN",
            *(f"    {line}" for line in start_values),
            "  END_IF;",
            "END_IF;",
            *(f"{each} := state.output.{each};" for each in outputs),
        ]
        when = "at this call"
        return Pou(
            "FUNCTION_BLOCK",
            name,
            "One sample per call. An input or a result that is not finite keeps the state and repeats the last output. "
            "Initial values and parameters are those of the configuration; nothing has to be called before.",
            {
                "VAR_INPUT": (
                    *map(self._variable, block.inputs),
                    PlcVariable("reset", "BOOL", "FALSE", f"restart {when}"),
                    PlcVariable("prepare", "BOOL", "FALSE", f"apply the parameters {when}"),
                    PlcVariable("parameters", f"{name}_parameters", "", "applied at the first call and by prepare"),
                    PlcVariable("use_prepared", "BOOL", "FALSE", f"apply `prepared` {when}"),
                    PlcVariable("prepared", f"{name}_prepared", "", f"of {name}_prepare in a slower task"),
                ),
                "VAR_OUTPUT": (
                    *map(self._variable, block.outputs),
                    PlcVariable("status", "INT", "0", "0 good; 1 an input, 3 a result not finite; 2 nothing prepared"),
                    PlcVariable("parameter_status", "INT", "0", "0 good; 2 a parameter is invalid, none applied"),
                    PlcVariable("invalid_parameter", "INT", "0", "position of the first invalid one, from 1; 0: none"),
                ),
                "VAR": (
                    PlcVariable("started", "BOOL", "FALSE"),
                    PlcVariable("finite", "BOOL"),
                    PlcVariable("own", f"{name}_prepared"),
                    PlcVariable("now", f"{name}_input"),
                    PlcVariable("state", f"{name}_state"),
                    PlcVariable("next", f"{name}_state"),
                    PlcVariable("preparation", f"{name}_prepare"),
                    PlcVariable("sample", f"{name}_sample"),
                    *self._work(start),
                ),
            },
            tuple(body),
        )

    def _start(self) -> list[str]:
        """Statements of the state before the first sample, and of the output of a block without direct feedthrough."""
        strand = language.Strand(self._elements()[1], WORK)
        lines = language.statements(self.apart.initial, self.style, [strand], in_place=True)
        output = self.apart.output
        return lines + (language.statements(output, self.style, [strand], in_place=True) if output else [])

    def _heard(self) -> list[str]:
        """Statements that read the inputs, with the value of a missing reading for NaN of one that may be silent."""
        lines, none = [], self.style.number(2 * blocks.NO_READING)
        for each in self.block.inputs:
            name = self.named(each)
            lines.append(f"now.{name} := {name};")
            if each.name in self.block.silent:
                lines += [*self._finite([name]), f"IF NOT finite THEN now.{name} := {none}; END_IF;"]
        return lines

    def _program(self) -> Pou:
        block, name = self.block, self.name
        inputs, outputs = ([self.named(each) for each in part] for part in (block.inputs, block.outputs))
        body = [
            "(* Connect inputs and outputs to your fieldbus. Limits, interlocks and safety are your responsibility. *)",
            f"control(reset := enable AND NOT enabled, {', '.join(f'{each} := {each}' for each in inputs)});",
            "enabled := enable;",
            "IF enable THEN",
            *(f"  {each} := control.{each};" for each in outputs),
            "END_IF;",
            "fault := control.status <> 0;",
        ]
        return Pou(
            "PROGRAM",
            f"{name}_program",
            "Example: calls the block every sample; starts from rest when enabled.",
            {
                "VAR": (
                    PlcVariable("control", name),
                    PlcVariable("enable", "BOOL", "TRUE"),
                    PlcVariable("enabled", "BOOL", "FALSE"),
                    PlcVariable("fault", "BOOL", "FALSE"),
                    *map(self._variable, (*block.inputs, *block.outputs)),
                )
            },
            tuple(body),
        )


def _elements(kind: str, of_structure: dict[str, int]) -> int:
    """Number of values in a variable of a type."""
    if kind.startswith("ARRAY"):
        return int(kind.partition("..")[2].partition("]")[0]) + 1
    return of_structure.get(kind, 1)


def _check_names(owner: str, groups: Iterable[Sequence[PlcVariable]]) -> None:
    """Raise `CodegenError` for names that differ only in case."""
    names: dict[str, str] = {}
    for variable in (each for group in groups for each in group):
        other = names.setdefault(variable.name.lower(), variable.name)
        if other is not variable.name:
            raise errors.CodegenError(
                f"{owner}: no Structured Text with both '{other}' and '{variable.name}'; rename one"
            )
