"""Data types and program organisation units (POUs) of a controller, as text in the dialects of IEC 61131-3."""

import re
import uuid
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args

from dualwinch.toolbox import texts

Flavour: TypeAlias = Literal["iec", "codesys", "twincat", "siemens-scl"]
FLAVOURS: tuple[Flavour, ...] = get_args(Flavour)
"""Standard text for Beremiz and OpenPLC; CODESYS; TwinCAT's project files; external sources of TIA Portal."""

_KEYWORDS = """
abs abstract acos action add and any array asin at atan bit bool by byte case char concat configuration constant
continue cos ctd ctu ctud date delete dint div do dt dword else elsif en eno end_var eq exit exp expt extends false
find finally for from function ge gt if implements initial_step insert int interface internal interval jmp le left
len limit lint ln log lreal lt lword max method mid min mod move mul mux namespace ne non_retain not null of on or
overlap override pointer priority private program protected public ref replace repeat resource retain return right
rol ror rs rtc sel sema shl shr sin single sint sqrt sr step string struct sub super tan task then this time to tod
tof ton tp transition true trunc type udint uint ulint until usint using var while with word wstring xor
"""
_INSTRUCTIONS = "cal calc calcn cd clk cu d ds in jmpc jmpcn l ld ldn n p pt pv r r1 ret retc s s1 st stn"

KEYWORDS = frozenset(_KEYWORDS.split())
"""Names that are reserved in all dialects."""

INSTRUCTIONS = frozenset(_INSTRUCTIONS.split())
"""Names of the instruction list, which the standard allows but some vendors do not."""


OPTIMISED = "{ S7_Optimized_Access := 'TRUE' }\n"
"""Attribute of a Siemens block: its variables are stored for the fastest access."""


def identifier(name: str, flavour: Flavour = "iec") -> str:
    """A valid name in IEC 61131-3: ASCII, no double or final underscore; a keyword gets the suffix ``_value``."""
    plain = re.sub(r"_+", "_", re.sub(r"\W", "_", name, flags=re.ASCII)).rstrip("_")
    plain = plain if re.match(r"[A-Za-z_]", plain) else f"n{plain}"
    reserved = KEYWORDS if flavour == "iec" else KEYWORDS | INSTRUCTIONS
    return f"{plain}_value" if plain.lower() in reserved else plain


def comment(text: object) -> str:
    """A text in one line for a comment, without comment delimiters."""
    return texts.one_line(text).replace("(*", "( *").replace("*)", "* )")


@dataclass(frozen=True)
class PlcVariable:
    """A variable of a type or a POU.

    Attributes:
        name: an identifier.
        type: elementary, derived, or ``ARRAY[0..n] OF`` an elementary one.
        initial: literal of its initial value; empty: that of its type.
        about: a comment.
    """

    name: str
    type: str
    initial: str = ""
    about: str = ""

    def declaration(self, width: int = 0) -> str:
        """Its declaration, with the name padded to a width."""
        value = f" := {self.initial}" if self.initial else ""
        about = f" (* {comment(self.about)} *)" if self.about else ""
        return f"{self.name.ljust(width)} : {self.type}{value};{about}"


@dataclass(frozen=True)
class Structure:
    """A data type of named members."""

    name: str
    members: tuple[PlcVariable, ...]
    about: str = ""


@dataclass(frozen=True)
class Pou:
    """A program organisation unit.

    Attributes:
        kind: ``FUNCTION``, ``FUNCTION_BLOCK`` or ``PROGRAM``.
        name: an identifier.
        about: a comment before it.
        sections: ``VAR_INPUT``, ``VAR_OUTPUT``, ``VAR_IN_OUT`` or ``VAR`` → its variables.
        body: its statements.
        returns: the type of a function.
    """

    kind: Literal["FUNCTION", "FUNCTION_BLOCK", "PROGRAM"]
    name: str
    about: str
    sections: dict[str, tuple[PlcVariable, ...]]
    body: tuple[str, ...]
    returns: str = ""

    @property
    def head(self) -> str:
        """Its first line."""
        return f"{self.kind} {self.name}{f' : {self.returns}' if self.returns else ''}"


@dataclass(frozen=True)
class PlcProject:
    """All parts of a controller, in the order of their dependences.

    Attributes:
        name: prefix of every name.
        about: description and origin, line by line.
        structures, pous: types and POUs.
        program: a program that runs the last POU.
        interval: interval of the program's task, in s.
        origin: name and version of the product, and the date.
    """

    name: str
    about: tuple[str, ...]
    structures: tuple[Structure, ...]
    pous: tuple[Pou, ...]
    program: Pou
    interval: float
    origin: tuple[str, str] = field(default=("", ""))

    @property
    def duration(self) -> str:
        """The task's interval as a literal."""
        return f"T#{self.interval * 1000:g}ms"


def files_of(project: PlcProject, flavour: Flavour) -> dict[str, str]:
    """Source texts of a project in a dialect: file name → content."""
    name = project.name
    if flavour == "twincat":
        types = {f"{part.name}.TcDUT": _twincat_type(part) for part in project.structures}
        return types | {f"{pou.name}.TcPOU": _twincat_pou(pou) for pou in (*project.pous, project.program)}
    if flavour == "siemens-scl":
        names = {part.name for part in (*project.structures, *project.pous, project.program)}
        structures = [_scl_structure(part, names) for part in project.structures]
        parts = [*structures, *(_scl_pou(pou, names) for pou in project.pous)]
        return {
            f"{name}.scl": _joined(project, parts),
            "main.scl": _head(project) + _scl_pou(project.program, names) + _scl_data(project),
        }
    parts = [*(_structure(part) for part in project.structures), *(_pou(pou) for pou in project.pous)]
    program = _pou(project.program) + (f"\n{_configuration(project)}" if flavour == "iec" else "")
    return {f"{name}.st": _joined(project, parts), "main.st": _head(project) + program}


def _head(project: PlcProject) -> str:
    product, date = project.origin
    return f"(* Generated by {product} on {date}. *)\n\n"


def _joined(project: PlcProject, parts: Iterable[str]) -> str:
    head = "\n".join(f"   {comment(line)}" for line in project.about).lstrip()
    return f"(* {head} *)\n\n" + "\n".join(parts)


def _variables(variables: Sequence[PlcVariable], indent: str = "  ") -> str:
    width = max((len(variable.name) for variable in variables), default=0)
    return "".join(f"{indent}{variable.declaration(width)}\n" for variable in variables)


def _structure(part: Structure) -> str:
    return f"(* {comment(part.about)} *)\nTYPE {part.name} :\nSTRUCT\n{_variables(part.members)}END_STRUCT;\nEND_TYPE\n"


def _sections(pou: Pou) -> str:
    return "".join(
        f"{section}\n{_variables(variables)}END_VAR\n" for section, variables in pou.sections.items() if variables
    )


def _body(pou: Pou) -> str:
    return "".join(f"  {line}\n" for line in pou.body)


def _pou(pou: Pou) -> str:
    return f"(* {comment(pou.about)} *)\n{pou.head}\n{_sections(pou)}\n{_body(pou)}END_{pou.kind}\n"


def _configuration(project: PlcProject) -> str:
    return f"""CONFIGURATION plant
  RESOURCE cpu ON PLC
    TASK control(INTERVAL := {project.duration}, PRIORITY := 0);
    PROGRAM instance WITH control : {project.program.name};
  END_RESOURCE
END_CONFIGURATION
"""


def _scl_structure(part: Structure, names: Collection[str]) -> str:
    members = _quoted(_variables(part.members), names)
    return f'(* {comment(part.about)} *)\nTYPE "{part.name}"\nVERSION : 0.1\nSTRUCT\n{members}END_STRUCT;\nEND_TYPE\n'


def _scl_pou(pou: Pou, names: Collection[str]) -> str:
    """A POU in SCL, with the names of types and blocks in quotes, except for the assignment of a function's result.

    SCL has no programs, and functions have only temporary variables.
    """
    kind = "FUNCTION_BLOCK" if pou.kind == "PROGRAM" else pou.kind
    returns = f" : {pou.returns}" if pou.returns else ""
    sections = _quoted(_sections(pou), names)
    if kind == "FUNCTION":
        sections = sections.replace("\nVAR\n", "\nVAR_TEMP\n")
    body = re.sub(rf'^(\s*)"{pou.name}" :=', rf"\1#{pou.name} :=", _quoted(_body(pou), names), flags=re.MULTILINE)
    return (
        f'(* {comment(pou.about)} *)\n{kind} "{pou.name}"{returns}\n{OPTIMISED}VERSION : 0.1\n'
        f"{sections}BEGIN\n{body}END_{kind}\n"
    )


def _scl_data(project: PlcProject) -> str:
    """The instance of the example."""
    name = project.program.name
    return (
        f"\n(* The instance; call it in a cyclic interrupt of {project.duration}. *)\n"
        f'DATA_BLOCK "{name}_data"\n{OPTIMISED}VERSION : 0.1\n"{name}"\nBEGIN\nEND_DATA_BLOCK\n'
    )


def _quoted(text: str, names: Collection[str]) -> str:
    return re.sub(rf"\b({'|'.join(sorted(names, key=len, reverse=True))})\b", r'"\1"', text)


def _twincat_pou(pou: Pou) -> str:
    declaration = f"(* {comment(pou.about)} *)\n{pou.head}\n{_sections(pou)}"
    parts = f"<Declaration>{_cdata(declaration)}</Declaration>"
    parts += f"<Implementation><ST>{_cdata(_body(pou))}</ST></Implementation>"
    return _twincat("POU", pou.name, f' SpecialFunc="None">{parts}')


def _twincat_type(part: Structure) -> str:
    return _twincat("DUT", part.name, f"><Declaration>{_cdata(_structure(part))}</Declaration>")


def _twincat(kind: str, name: str, rest: str) -> str:
    """One object of a TwinCAT project; its identity follows from its name."""
    identity = uuid.uuid5(uuid.NAMESPACE_DNS, f"{kind}.{name}.dualwinch")
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<TcPlcObject Version="1.1.0.1" ProductVersion="3.1.4024.0">\n'
        f'<{kind} Name="{name}" Id="{{{identity}}}"{rest}</{kind}>\n</TcPlcObject>\n'
    )


def _cdata(text: str) -> str:
    lines = (texts.xml_text(line).replace("]]>", "]] >") for line in text.split("\n"))
    return "<![CDATA[" + "\n".join(lines) + "]]>"
