"""The parts of a model description that FMI 2 and FMI 3 write alike."""

import math
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from dualwinch.codegen.fmu.model import FmuModel, Signal
from dualwinch.codegen.fmu.units import base_powers
from dualwinch.codegen.text import xml_text

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


def listed(model: FmuModel) -> tuple[Signal, ...]:
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


def value_attributes(signal: Signal) -> dict[str, str]:
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


def variable_attributes(signal: Signal) -> dict[str, str]:
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
