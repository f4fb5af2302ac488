"""Model description of FMI 2.0."""

from xml.etree.ElementTree import SubElement

from dualwinch.codegen.fmu import description
from dualwinch.codegen.fmu.description import About
from dualwinch.codegen.fmu.model import FmuModel


def model_description(model: FmuModel, token: str, about: About) -> bytes:
    """``modelDescription.xml`` of FMI 2.0.

    Args:
        model: what is exported.
        token: as in the C source.
        about: what is said beside the block.
    """
    document = description.root(model, about, guid=token, numberOfEventIndicators="0")
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
    description.add_units(document, model)
    description.add_log_category(document)
    description.add_experiment(document, model, about)
    variables = SubElement(document, "ModelVariables")
    index = {signal.reference: position for position, signal in enumerate(description.listed(model), start=1)}
    for signal in description.listed(model):
        scalar = SubElement(variables, "ScalarVariable", description.variable_attributes(signal))
        attributes = description.value_attributes(signal)
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
    return description.text(document)
