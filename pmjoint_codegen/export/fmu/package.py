"""The four units of a model: controller and plant, in FMI 2.0 and 3.0."""

from __future__ import annotations

import hashlib
import re
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pmjoint_codegen.export.fmu.archive import Builder, zipped
from pmjoint_codegen.export.fmu.controller import controller_header, controller_variables
from pmjoint_codegen.export.fmu.description import (
    Description,
    build_description,
    description_2,
    description_3,
)
from pmjoint_codegen.export.fmu.plant import PlantUnit, plant_header, plant_variables
from pmjoint_codegen.export.fmu.units import Units
from pmjoint_codegen.export.package import export_c
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.tree import Precision
from pmjoint_derive import Derivation

VERSIONS: Final = (2, 3)
CONTROLLER, PLANT = "controller", "plant"


def stem(identity: Identity) -> str:
    """What the names of the files begin with."""
    return re.sub(r"[^\w.-]", "_", identity.model, flags=re.ASCII)


def file_name(identity: Identity, part: str, version: int) -> str:
    """Name of a unit's file.

    Args:
        identity: names and hash.
        part: ``controller`` or ``plant``.
        version: of the FMI, 2 or 3.
    """
    return f"{stem(identity)}_{part}.fmi{version}.fmu"


def units(
    derivation: Derivation, identity: Identity, precision: Precision, builders: Sequence[Builder]
) -> dict[str, bytes]:
    """File name -> contents.

    Args:
        derivation: of the model.
        identity: names and hash.
        precision: of the controller; the plant is always in double.
        builders: of the binaries; none: sources alone.

    Raises:
        BuildError: a compiler refused the sources.
    """
    found = {}
    labels = Units()
    parts = (
        _controller(derivation, identity, precision, labels),
        _plant(derivation, identity, precision, labels),
    )
    for part, (unit, texts) in zip((CONTROLLER, PLANT), parts, strict=True):
        for version in VERSIONS:
            found[file_name(identity, part, version)] = _unit(unit, texts, version, builders)
    return found


def _token(identity: Identity, part: str, precision: Precision) -> str:
    """The same for the same model, part, precision and version of this package."""
    text = "\n".join((identity.model, identity.model_hash, identity.version, part, precision.name))
    return f"{{{uuid.UUID(bytes=hashlib.sha256(text.encode()).digest()[:16])}}}"


def _controller(
    derivation: Derivation, identity: Identity, precision: Precision, labels: Units
) -> tuple[Description, dict[str, str]]:
    export = export_c(derivation, identity, precision)
    variables, token = controller_variables(export, labels), _token(identity, CONTROLLER, precision)
    run, title = derivation.model.simulation, derivation.model.title
    source = f"{identity.prefix}.c"
    unit = Description(
        f"{identity.model} controller",
        f"{identity.prefix}_{CONTROLLER}",
        token,
        f"Sampled output-feedback controller: {title}",
        identity.version,
        run.horizon,
        run.sample_time,
        variables,
        (source,),
        run.sample_time,
    )
    header = f"{identity.prefix}.h"
    texts = {source: export.source, header: export.files[header]}
    return unit, texts | {"model.h": controller_header(export, variables, token)}


def _plant(
    derivation: Derivation, identity: Identity, precision: Precision, labels: Units
) -> tuple[Description, dict[str, str]]:
    printed = PlantUnit(derivation)
    variables, token = plant_variables(printed, labels), _token(identity, PLANT, precision)
    run, title = derivation.model.simulation, derivation.model.title
    unit = Description(
        f"{identity.model} plant",
        f"{identity.prefix}_{PLANT}",
        token,
        f"Simulated plant: {title}",
        identity.version,
        run.horizon,
        run.sample_time,
        variables,
        (),
    )
    return unit, {"model.h": plant_header(printed, variables, identity, token)}


def _unit(unit: Description, texts: dict[str, str], version: int, builders: Sequence[Builder]) -> bytes:
    here = Path(__file__).parent
    wrapper = f"fmi{version}.c"
    shared = ("variables.h", "unit.h", f"fmi{version}.h", wrapper)
    texts = texts | {name: (here / name).read_text(encoding="utf-8") for name in shared}
    sources = (*unit.sources, wrapper)
    told = Description(**(vars(unit) | {"sources": sources}))
    files: dict[str, str | bytes] = {f"sources/{name}": text for name, text in texts.items()}
    if version == 3:
        files |= {
            "modelDescription.xml": description_3(told),
            "sources/buildDescription.xml": build_description(told),
        }
    else:
        files["modelDescription.xml"] = description_2(told)
    for builder in builders:
        folder = builder.platform.folder_3 if version == 3 else builder.platform.folder_2
        if folder:
            name = f"binaries/{folder}/{unit.identifier}{builder.platform.suffix}"
            files[name] = builder.binary(texts, sources, unit.identifier)
    return zipped(files)
