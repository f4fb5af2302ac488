"""A controller's types and POUs as PLCopen XML (TC6, version 2.01), which Beremiz, CODESYS and TwinCAT import."""

import re
from collections.abc import Iterable
from xml.etree import ElementTree as ET

from dualwinch.toolbox import texts
from dualwinch.toolboxes.plc.project import Flavour, PlcProject, PlcVariable, Pou

NAMESPACE = "http://www.plcopen.org/xml/tc6_0201"
XHTML = "http://www.w3.org/1999/xhtml"

SECTIONS = {"VAR_INPUT": "inputVars", "VAR_OUTPUT": "outputVars", "VAR_IN_OUT": "inOutVars", "VAR": "localVars"}
POU_TYPES = {"FUNCTION": "function", "FUNCTION_BLOCK": "functionBlock", "PROGRAM": "program"}


def plcopen_xml(project: PlcProject, flavour: Flavour = "iec") -> str:
    """A project as one file.

    The schema leaves two details to vendors: the element of texts, and the format of a task's interval.

    Args:
        project: the project.
        flavour: ``iec`` for the format of Beremiz, others for that of CODESYS.
    """
    text_tag, interval = ("p", project.duration) if flavour == "iec" else ("xhtml", f"PT{project.interval:g}S")
    product, date = project.origin
    root = ET.Element("project", {"xmlns": NAMESPACE, "xmlns:xhtml": XHTML})
    moment = f"{date}T00:00:00"
    header = {"companyName": "dualwinch", "productName": product, "productVersion": "1", "creationDateTime": moment}
    ET.SubElement(root, "fileHeader", header)
    content = ET.SubElement(root, "contentHeader", {"name": project.name, "modificationDateTime": moment})
    ET.SubElement(content, "Comment").text = texts.xml_text(" ".join(project.about))
    coordinates = ET.SubElement(content, "coordinateInfo")
    for language in ("fbd", "ld", "sfc"):
        ET.SubElement(ET.SubElement(coordinates, language), "scaling", {"x": "1", "y": "1"})
    types = ET.SubElement(root, "types")
    data_types, pous = ET.SubElement(types, "dataTypes"), ET.SubElement(types, "pous")
    for part in project.structures:
        described = ET.SubElement(data_types, "dataType", {"name": part.name})
        _variables(ET.SubElement(ET.SubElement(described, "baseType"), "struct"), part.members, text_tag)
        _text(ET.SubElement(described, "documentation"), part.about, text_tag)
    for pou in (*project.pous, project.program):
        _pou(pous, pou, text_tag)
    configurations = ET.SubElement(ET.SubElement(root, "instances"), "configurations")
    configuration = ET.SubElement(configurations, "configuration", {"name": "plant"})
    resource = ET.SubElement(configuration, "resource", {"name": "cpu"})
    task = ET.SubElement(resource, "task", {"name": "control", "interval": interval, "priority": "0"})
    ET.SubElement(task, "pouInstance", {"name": "instance", "typeName": project.program.name})
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True).replace("'", '"', 6) + "\n"


def _pou(pous: ET.Element, pou: Pou, text_tag: str) -> None:
    element = ET.SubElement(pous, "pou", {"name": pou.name, "pouType": POU_TYPES[pou.kind]})
    interface = ET.SubElement(element, "interface")
    if pou.returns:
        _type(ET.SubElement(interface, "returnType"), pou.returns)
    for section, variables in pou.sections.items():
        if variables:
            _variables(ET.SubElement(interface, SECTIONS[section]), variables, text_tag)
    _text(ET.SubElement(interface, "documentation"), pou.about, text_tag)
    body = ET.SubElement(ET.SubElement(element, "body"), "ST")
    _text(body, "\n".join(pou.body), text_tag)


def _variables(parent: ET.Element, variables: Iterable[PlcVariable], text_tag: str) -> None:
    for variable in variables:
        element = ET.SubElement(parent, "variable", {"name": variable.name})
        _type(ET.SubElement(element, "type"), variable.type)
        if variable.initial:
            ET.SubElement(ET.SubElement(element, "initialValue"), "simpleValue", {"value": variable.initial})
        if variable.about:
            _text(ET.SubElement(element, "documentation"), variable.about, text_tag)


def _type(parent: ET.Element, name: str) -> None:
    if array := re.fullmatch(r"ARRAY\[(\d+)\.\.(\d+)\] OF (\w+)", name):
        element = ET.SubElement(parent, "array")
        ET.SubElement(element, "dimension", {"lower": array[1], "upper": array[2]})
        _type(ET.SubElement(element, "baseType"), array[3])
    elif name in {"BOOL", "INT", "LREAL", "REAL"}:
        ET.SubElement(parent, name)
    else:
        ET.SubElement(parent, "derived", {"name": name})


def _text(parent: ET.Element, text: str, text_tag: str) -> None:
    lines = "\n".join(texts.xml_text(line) for line in text.split("\n"))
    ET.SubElement(parent, f"xhtml:{text_tag}").text = lines
