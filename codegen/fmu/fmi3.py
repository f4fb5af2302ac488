"""Model description and build description of FMI 3.0."""

from xml.etree.ElementTree import Element, SubElement

from dualwinch.codegen.fmu import description
from dualwinch.codegen.fmu.description import About
from dualwinch.codegen.fmu.model import FmuModel


def model_description(model: FmuModel, token: str, about: About) -> bytes:
    """``modelDescription.xml`` of FMI 3.0.

    Args:
        model: what is exported.
        token: as in the C source.
        about: what is said beside the block.
    """
    document = description.root(model, about, instantiationToken=token)
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
            fixedInternalStepSize=description.number(model.block.sample_time),
        )
    description.add_units(document, model)
    description.add_log_category(document)
    description.add_experiment(document, model, about)
    variables = SubElement(document, "ModelVariables")
    for signal in description.listed(model):
        attributes = description.variable_attributes(signal) | description.value_attributes(signal)
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
    return description.text(document)


def build_description(model: FmuModel) -> bytes:
    """``sources/buildDescription.xml``: how to compile the one source file."""
    document = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(document, "BuildConfiguration", modelIdentifier=model.block.name)
    files = SubElement(build, "SourceFileSet", language="C99")
    SubElement(files, "SourceFile", name=f"{model.block.name}.c")
    return description.text(document)
