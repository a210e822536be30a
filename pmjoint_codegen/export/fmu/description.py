"""modelDescription.xml and buildDescription.xml of a unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

from pmjoint_codegen.export.fmu.units import Declared
from pmjoint_codegen.export.fmu.variables import (
    BOOLEAN,
    INPUT,
    INTEGER,
    OUTPUT,
    PARAMETER,
    REAL,
    TIME,
    Variable,
)

_TYPES_2: Final = {REAL: "Real", INTEGER: "Integer", BOOLEAN: "Boolean"}
_TYPES_3: Final = {REAL: "Float64", INTEGER: "Int32", BOOLEAN: "Boolean"}


@dataclass(frozen=True)
class Description:
    """What a unit says of itself.

    Attributes:
        name: of the model.
        identifier: of its functions and files.
        token: what a tool must give to instantiate it.
        about: one line for the reader.
        version: of this package.
        stop: s, end of the run that the model file describes.
        step: s, communication step of that run.
        variables: with the time first.
        sources: files to compile.
        internal: s, step of its own that the unit cannot leave; None: none.
    """

    name: str
    identifier: str
    token: str
    about: str
    version: str
    stop: float
    step: float
    variables: tuple[Variable, ...]
    sources: tuple[str, ...]
    internal: float | None = None


def description_2(unit: Description) -> bytes:
    """modelDescription.xml of FMI 2.0."""
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=unit.name,
        guid=unit.token,
        description=unit.about,
        generationTool=f"pmjoint-codegen {unit.version}",
        variableNamingConvention="flat",
        numberOfEventIndicators="0",
    )
    kind = ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=unit.identifier,
        canHandleVariableCommunicationStepSize="true",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    files = ET.SubElement(kind, "SourceFiles")
    for name in unit.sources:
        ET.SubElement(files, "File", name=name)
    _units(root, unit.variables)
    _logging(root)
    ET.SubElement(root, "DefaultExperiment", _experiment(unit))
    variables = ET.SubElement(root, "ModelVariables")
    listed = [item for item in enumerate(unit.variables) if item[1].causality != TIME]
    for reference, item in listed:
        entry = ET.SubElement(variables, "ScalarVariable", _attributes(reference, item))
        ET.SubElement(entry, _TYPES_2[item.kind], _value(item))
    structure = ET.SubElement(root, "ModelStructure")
    for label, wanted in (("Outputs", _is_output), ("InitialUnknowns", _is_calculated)):
        places = [place for place, (_, item) in enumerate(listed, start=1) if wanted(item)]
        group = ET.SubElement(structure, label)
        for place in places:
            ET.SubElement(group, "Unknown", index=str(place))
    return _text(root)


def description_3(unit: Description) -> bytes:
    """modelDescription.xml of FMI 3.0."""
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=unit.name,
        instantiationToken=unit.token,
        description=unit.about,
        generationTool=f"pmjoint-codegen {unit.version}",
        variableNamingConvention="flat",
    )
    kind = ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=unit.identifier,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    if unit.internal is not None:
        kind.set("fixedInternalStepSize", repr(unit.internal))
    _units(root, unit.variables)
    _logging(root)
    ET.SubElement(root, "DefaultExperiment", _experiment(unit))
    variables = ET.SubElement(root, "ModelVariables")
    for reference, item in enumerate(unit.variables):
        ET.SubElement(variables, _TYPES_3[item.kind], _attributes(reference, item) | _value(item))
    structure = ET.SubElement(root, "ModelStructure")
    for label, wanted in (("Output", _is_output), ("InitialUnknown", _is_calculated)):
        for reference, item in enumerate(unit.variables):
            if wanted(item):
                ET.SubElement(structure, label, valueReference=str(reference))
    return _text(root)


def build_description(unit: Description) -> bytes:
    """buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=unit.identifier)
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    for name in unit.sources:
        ET.SubElement(files, "SourceFile", name=name)
    return _text(root)


def _is_output(item: Variable) -> bool:
    return item.causality == OUTPUT


def _is_calculated(item: Variable) -> bool:
    return item.causality == OUTPUT and item.start is None


def _experiment(unit: Description) -> dict[str, str]:
    return {"startTime": "0.0", "stopTime": repr(unit.stop), "stepSize": repr(unit.step)}


def _attributes(reference: int, item: Variable) -> dict[str, str]:
    found = {
        "name": item.name,
        "valueReference": str(reference),
        "description": " ".join(item.about.split()),
        "causality": item.causality,
        "variability": item.variability,
    }
    if item.causality == PARAMETER or (item.causality == OUTPUT and item.start is not None):
        found["initial"] = "exact"
    elif item.causality not in (INPUT, TIME):
        found["initial"] = "calculated"
    return found


def _value(item: Variable) -> dict[str, str]:
    found = {}
    if item.start is not None:
        shown = {REAL: repr(float(item.start)), INTEGER: str(int(item.start))}
        found["start"] = shown.get(item.kind, str(bool(item.start)).lower())
    if item.unit is not None:
        found["unit"] = item.unit.name
        if item.unit.shown is not None:
            found["displayUnit"] = item.unit.shown[0]
    return found


def _units(root: ET.Element, variables: Sequence[Variable]) -> None:
    """Every unit once, with all the units in which variables of it are shown."""
    units: dict[str, Declared] = {}
    shown: dict[str, dict[str, float]] = {}
    for item in variables:
        if item.unit is not None:
            units.setdefault(item.unit.name, item.unit)
            if item.unit.shown is not None:
                shown.setdefault(item.unit.name, {})[item.unit.shown[0]] = item.unit.shown[1]
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name, unit in units.items():
        entry = ET.SubElement(definitions, "Unit", name=name)
        if unit.exponents is not None:
            base = ET.SubElement(entry, "BaseUnit", {label: str(power) for label, power in unit.exponents})
            if unit.factor != 1.0:
                base.set("factor", repr(unit.factor))
        for label, factor in shown.get(name, {}).items():
            ET.SubElement(entry, "DisplayUnit", name=label, factor=repr(factor))


def _logging(root: ET.Element) -> None:
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="what went wrong")


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"
