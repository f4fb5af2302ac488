"""The model descriptions of FMI 2.0 and FMI 3.0, and units as FMI defines them: integer powers of the SI base units."""

import math
import re
from collections import Counter
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from dualwinch.codegen.fmu.model import FmuModel, FmuVariable
from dualwinch.codegen.text import xml_text

SI: dict[str, dict[str, int]] = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "K": {"K": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Hz": {"s": -1},
    "1": {},
}
"""Units by their powers of the base units."""

FACTOR = re.compile(r"(/)?\s*(?:\(([^()]*)\)|([A-Za-z]+|1))(?:\^(-?\d+))?(?=[\s/]|$)\s*")
"""One factor of a product: after a slash or not, a group or a unit, and its power."""


def base_powers(unit: str) -> dict[str, int] | None:
    """Powers of the SI base units, e.g. ``N m/rad`` → kg 1, m 2, s −2, rad −1.

    A slash divides by the one factor after it, which may be a product in parentheses.

    Returns:
        None where the unit is no integer power of them (``m^(1/2)/s``) or not known.
    """
    powers: Counter[str] = Counter()
    position = 0
    while position < len(unit):
        factor = FACTOR.match(unit, position)
        if factor is None:
            return None
        slash, group, name, power = factor.groups()
        part = base_powers(group) if group is not None else SI.get(name)
        if part is None:
            return None
        times = int(power or 1) * (-1 if slash else 1)
        for base, count in part.items():
            powers[base] += times * count
        position = factor.end()
    return {base: count for base, count in powers.items() if count}


CAUSALITY = {
    "input": ("input", "continuous", None),
    "parameter": ("parameter", "tunable", "exact"),
    "output": ("output", "continuous", "calculated"),
    "state": ("local", "continuous", "calculated"),
    "derivative": ("local", "continuous", "calculated"),
    "time": ("independent", "continuous", None),
}
"""Causality, variability and initial of each role."""


TOLERANCE = 1e-9
"""Relative tolerance proposed to a solver: what matters may be a small difference of large states."""


@dataclass(frozen=True)
class About:
    """What a model description says beside the block.

    Attributes:
        tool: name and version of what exports.
        stop_time: of the default experiment, in s.
        note: added to the block's description.
    """

    tool: str
    stop_time: float
    note: str = ""


def number(value: float) -> str:
    """A number as XML has it, to the last bit."""
    return repr(float(value))


def listed(model: FmuModel) -> tuple[FmuVariable, ...]:
    """The variables a model description shows.

    Derivatives only with model exchange, and what an integrator keeps for itself only with co-simulation.
    """
    continuous = {signal.state for signal in model.of("derivative")}
    shown = {"derivative": model.flows, "state": model.steps}
    return tuple(signal for signal in model.signals if shown.get(signal.role, True) or signal.reference in continuous)


def root(model: FmuModel, about: About, **attributes: str) -> Element:
    """The outermost element."""
    words = [model.block.description, about.note]
    return Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{model.version}.0",
            "modelName": model.block.name,
            **attributes,
            "description": "; ".join(word for word in words if word),
            "generationTool": about.tool,
            "variableNamingConvention": "structured",
        },
    )


def add_units(parent: Element, model: FmuModel) -> None:
    """Definitions of every unit, with their base units where FMI can express them."""
    units = SubElement(parent, "UnitDefinitions")
    for unit in sorted({signal.variable.unit for signal in listed(model)} - {"1", ""}):
        definition = SubElement(units, "Unit", name=unit)
        powers = base_powers(unit)
        if powers is not None:
            SubElement(definition, "BaseUnit", {base: str(power) for base, power in powers.items()})


def add_log_category(parent: Element) -> None:
    """The one log category."""
    SubElement(
        SubElement(parent, "LogCategories"), "Category", name="logStatusError", description="what a status means"
    )


def add_experiment(parent: Element, model: FmuModel, about: About) -> None:
    """The default experiment: one communication step a sample."""
    attributes = {"startTime": "0.0", "stopTime": number(about.stop_time), "stepSize": number(model.block.sample_time)}
    SubElement(parent, "DefaultExperiment", attributes | ({"tolerance": number(TOLERANCE)} if model.flows else {}))


def value_attributes(signal: FmuVariable) -> dict[str, str]:
    """Unit, range and start value."""
    variable = signal.variable
    attributes = {} if variable.unit in {"", "1"} else {"unit": variable.unit}
    if signal.role == "state" and variable.nominal != 1:
        attributes["nominal"] = number(variable.nominal)
    if signal.role in {"input", "parameter"}:
        if math.isfinite(variable.lower):
            attributes["min"] = number(variable.lower)
        if math.isfinite(variable.upper):
            attributes["max"] = number(variable.upper)
        attributes["start"] = number(variable.start)
    return attributes


def variable_attributes(signal: FmuVariable) -> dict[str, str]:
    """Name, value reference, description and the role in FMI's words."""
    causality, variability, initial = CAUSALITY[signal.role]
    variable = signal.variable
    beyond = f" (greater than {variable.lower:g})" if variable.exclusive else ""  # FMI's min includes itself
    attributes = {
        "name": signal.name,
        "valueReference": str(signal.reference),
        "description": variable.description + beyond,
        "causality": causality,
        "variability": variability,
    }
    return attributes | ({"initial": initial} if initial else {})


def text(element: Element) -> bytes:
    """The document; what others wrote is in one line of letters that XML can hold."""
    for inner in element.iter():
        inner.attrib.update({name: xml_text(value) for name, value in inner.attrib.items()})
    indent(element)
    return tostring(element, encoding="utf-8", xml_declaration=True) + b"\n"


def model_description_2(model: FmuModel, token: str, about: About) -> bytes:
    """``modelDescription.xml`` of FMI 2.0.

    Args:
        model: what is exported.
        token: as in the C source.
        about: what is said beside the block.
    """
    document = root(model, about, guid=token, numberOfEventIndicators="0")
    common = {
        "modelIdentifier": model.block.name,
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": str(model.functions.now_tangent is not None).lower(),
    }
    offered = []
    if model.flows:
        offered.append(("ModelExchange", common | {"completedIntegratorStepNotNeeded": "true"}))
    if model.steps:
        offered.append(("CoSimulation", common | {"canHandleVariableCommunicationStepSize": "true"}))
    for interface, attributes in offered:
        files = SubElement(SubElement(document, interface, attributes), "SourceFiles")
        SubElement(files, "File", name=f"{model.block.name}.c")
    add_units(document, model)
    add_log_category(document)
    add_experiment(document, model, about)
    variables = SubElement(document, "ModelVariables")
    index = {signal.reference: position for position, signal in enumerate(listed(model), start=1)}
    for signal in listed(model):
        scalar = SubElement(variables, "ScalarVariable", variable_attributes(signal))
        attributes = value_attributes(signal)
        if signal.state is not None:
            attributes["derivative"] = str(index[signal.state])
        SubElement(scalar, "Real", attributes)

    structure = SubElement(document, "ModelStructure")
    for group, role in (("Outputs", "output"), ("Derivatives", "derivative")):
        if role == "derivative" and not model.flows:
            continue
        unknowns = SubElement(structure, group)
        for signal in model.of(role):
            dependencies = " ".join(str(index[known]) for known in model.dependencies[signal.reference])
            SubElement(unknowns, "Unknown", index=str(index[signal.reference]), dependencies=dependencies)
    unknowns = SubElement(structure, "InitialUnknowns")
    for reference, knowns in model.initial_unknowns.items():
        dependencies = " ".join(str(index[known]) for known in knowns)
        SubElement(unknowns, "Unknown", index=str(index[reference]), dependencies=dependencies)
    return text(document)


def model_description_3(model: FmuModel, token: str, about: About) -> bytes:
    """``modelDescription.xml`` of FMI 3.0.

    Args:
        model: what is exported.
        token: as in the C source.
        about: what is said beside the block.
    """
    document = root(model, about, instantiationToken=token)
    common = {
        "modelIdentifier": model.block.name,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": str(model.functions.now_tangent is not None).lower(),
    }
    if model.flows:
        SubElement(document, "ModelExchange", common)
    if model.steps:
        SubElement(
            document,
            "CoSimulation",
            common,
            canHandleVariableCommunicationStepSize="true",
            fixedInternalStepSize=number(model.block.sample_time),
        )
    add_units(document, model)
    add_log_category(document)
    add_experiment(document, model, about)
    variables = SubElement(document, "ModelVariables")
    for signal in listed(model):
        attributes = variable_attributes(signal) | value_attributes(signal)
        if signal.state is not None:
            attributes["derivative"] = str(signal.state)
        SubElement(variables, "Float64", attributes)

    structure = SubElement(document, "ModelStructure")
    for element, role in (("Output", "output"), ("ContinuousStateDerivative", "derivative")):
        if role == "derivative" and not model.flows:
            continue
        for signal in model.of(role):
            known = " ".join(map(str, model.dependencies[signal.reference]))
            SubElement(structure, element, valueReference=str(signal.reference), dependencies=known)
    for reference, knowns in model.initial_unknowns.items():
        known = " ".join(map(str, knowns))
        SubElement(structure, "InitialUnknown", valueReference=str(reference), dependencies=known)
    return text(document)


def build_description(model: FmuModel) -> bytes:
    """``sources/buildDescription.xml``: how to compile the one source file."""
    document = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(document, "BuildConfiguration", modelIdentifier=model.block.name)
    files = SubElement(build, "SourceFileSet", language="C99")
    SubElement(files, "SourceFile", name=f"{model.block.name}.c")
    return text(document)
