"""The model description of an FMU in FMI 2.0 or 3.0, with units as integer powers of the SI base units."""

import math
import re
from collections import Counter
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from dualwinch.toolbox import texts
from dualwinch.toolboxes.fmu.model import FmuModel, FmuVariable

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
"""One factor of a product: an optional slash, a group or a unit, and its power."""


def base_powers(unit: str) -> dict[str, int] | None:
    """Powers of the SI base units, e.g. ``N m/rad`` → kg 1, m 2, s −2, rad −1.

    A slash divides by the next factor, which may be a product in parentheses.

    Returns:
        None for a unit that is unknown or no integer power of them (``m^(1/2)/s``).
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
"""Relative tolerance proposed to a solver: small differences of large states matter."""


@dataclass(frozen=True)
class About:
    """Data of a model description in addition to the block.

    Attributes:
        tool: name and version of the exporting tool.
        stop_time: stop time of the default experiment in s.
        note: text added to the block's description.
    """

    tool: str
    stop_time: float
    note: str = ""


def model_description(model: FmuModel, token: str, about: About) -> bytes:
    """``modelDescription.xml`` of FMI 2.0 or 3.0.

    Args:
        model: the model.
        token: token of the C source.
        about: further data.
    """
    two, block = model.version == 2, model.block
    listed = _listed(model)
    numbers = {signal.reference: k if two else signal.reference for k, signal in enumerate(listed, start=1)}
    document = Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{model.version}.0",
            "modelName": block.name,
            **({"guid": token, "numberOfEventIndicators": "0"} if two else {"instantiationToken": token}),
            "description": "; ".join(word for word in (block.description, about.note) if word),
            "generationTool": about.tool,
            "variableNamingConvention": "structured",
        },
    )
    for interface, attributes in _interfaces(model):
        offered = SubElement(document, interface, attributes)
        if two:
            SubElement(SubElement(offered, "SourceFiles"), "File", name=f"{block.name}.c")
    units = SubElement(document, "UnitDefinitions")
    for unit in sorted({signal.variable.unit for signal in listed} - {"1", ""}):
        definition = SubElement(units, "Unit", name=unit)
        powers = base_powers(unit)
        if powers is not None:
            SubElement(definition, "BaseUnit", {base: str(power) for base, power in powers.items()})
    categories = SubElement(document, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="explanation of a status")
    experiment = {"startTime": "0.0", "stopTime": _number(about.stop_time), "stepSize": _number(block.sample_time)}
    experiment |= {"tolerance": _number(TOLERANCE)} if model.flows else {}
    SubElement(document, "DefaultExperiment", experiment)

    variables = SubElement(document, "ModelVariables")
    for signal in listed:
        role_attributes, value = _role_attributes(signal), _value_attributes(signal)
        if signal.state is not None:
            value["derivative"] = str(numbers[signal.state])
        if two:
            SubElement(SubElement(variables, "ScalarVariable", role_attributes), "Real", value)
        else:
            SubElement(variables, "Float64", role_attributes | value)

    structure = SubElement(document, "ModelStructure")
    outputs, derivatives = (
        {signal.reference: model.dependencies[signal.reference] for signal in model.of(role)}
        for role in ("output", "derivative")
    )
    groups = [("Outputs", "Output", outputs)]
    groups += [("Derivatives", "ContinuousStateDerivative", derivatives)] if model.flows else []
    for group, element, unknowns in (*groups, ("InitialUnknowns", "InitialUnknown", model.initial_unknowns)):
        parent = SubElement(structure, group) if two else structure
        for reference, knowns in unknowns.items():
            which = {"index" if two else "valueReference": str(numbers[reference])}
            dependencies = " ".join(str(numbers[dependency]) for dependency in knowns)
            SubElement(parent, "Unknown" if two else element, which, dependencies=dependencies)
    return _text(document)


def build_description(model: FmuModel) -> bytes:
    """``sources/buildDescription.xml`` of FMI 3.0, for the compilation of the source file."""
    document = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(document, "BuildConfiguration", modelIdentifier=model.block.name)
    files = SubElement(build, "SourceFileSet", language="C99")
    SubElement(files, "SourceFile", name=f"{model.block.name}.c")
    return _text(document)


def _number(value: float) -> str:
    """A number in XML, exact to the last bit."""
    return repr(float(value))


def _listed(model: FmuModel) -> tuple[FmuVariable, ...]:
    """The variables of a model description.

    Derivatives only with model exchange, states of the integrator only with co-simulation.
    """
    continuous = {signal.state for signal in model.of("derivative")}
    visible = {"derivative": model.flows, "state": model.steps}
    return tuple(signal for signal in model.signals if visible.get(signal.role, True) or signal.reference in continuous)


def _interfaces(model: FmuModel) -> list[tuple[str, dict[str, str]]]:
    """The supported interfaces with their attributes."""
    directional = str(model.functions.now_tangent is not None).lower()
    variable_step = {"canHandleVariableCommunicationStepSize": "true"}
    if model.version == 2:
        common = {
            "modelIdentifier": model.block.name,
            "canNotUseMemoryManagementFunctions": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "providesDirectionalDerivative": directional,
        }
        of_exchange, of_steps = {"completedIntegratorStepNotNeeded": "true"}, variable_step
    else:
        common = {
            "modelIdentifier": model.block.name,
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "providesDirectionalDerivatives": directional,
        }
        of_exchange, of_steps = {}, variable_step | {"fixedInternalStepSize": _number(model.block.sample_time)}
    offered = [("ModelExchange", common | of_exchange)] if model.flows else []
    return offered + ([("CoSimulation", common | of_steps)] if model.steps else [])


def _role_attributes(signal: FmuVariable) -> dict[str, str]:
    """Name, value reference, description, and the role in FMI's terms."""
    causality, variability, initial = CAUSALITY[signal.role]
    variable = signal.variable
    exclusion = f" (greater than {variable.lower:g})" if variable.exclusive else ""  # FMI's min includes itself
    attributes = {
        "name": signal.name,
        "valueReference": str(signal.reference),
        "description": variable.description + exclusion,
        "causality": causality,
        "variability": variability,
    }
    return attributes | ({"initial": initial} if initial else {})


def _value_attributes(signal: FmuVariable) -> dict[str, str]:
    """Unit, range and start value."""
    variable = signal.variable
    attributes = {} if variable.unit in {"", "1"} else {"unit": variable.unit}
    if signal.role == "state" and variable.nominal != 1:
        attributes["nominal"] = _number(variable.nominal)
    if signal.role in {"input", "parameter"}:
        bounds = {"min": variable.lower, "max": variable.upper}
        attributes |= {name: _number(bound) for name, bound in bounds.items() if math.isfinite(bound)}
        attributes["start"] = _number(variable.start)
    return attributes


def _text(element: Element) -> bytes:
    """The document, with texts made valid in XML."""
    for inner in element.iter():
        inner.attrib.update({name: texts.xml_text(value) for name, value in inner.attrib.items()})
    indent(element)
    return tostring(element, encoding="utf-8", xml_declaration=True) + b"\n"
