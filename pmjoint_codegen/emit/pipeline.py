"""The compiler from a model to the files of ``generated/<name>/``, as text; nothing is written here.

Stages, input to output:

    derive           derive.Model        -> Derivation (named equations)
    build_functions  Derivation          -> CasADi functions, one a row of the table, and the two Taylor
    kernels kernels_source   functions           -> kernels.c
    kernels_header   function records    -> kernels.h
    serialise        functions           -> kernels.casadi, for the interpreted evaluator
    describe         all of the above    -> model.json
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from derive import Derivation, Model, derive
from pmjoint_codegen.emit.c_text import banner, kernels_header, kernels_source
from pmjoint_codegen.emit.describe import describe, describe_functions, tool_versions
from pmjoint_codegen.emit.functions import build_functions
from pmjoint_codegen.identity import Document, structure_hash
from pmjoint_codegen.manifest import FILE_NAME, Function, Manifest
from pmjoint_codegen.storage import sha256

TAYLOR_ORDER = 16  # least time to 1e-9 for the paper's loop; see docs/design.md


@dataclass(frozen=True)
class Artifacts:
    """What one model generates.

    Attributes:
        manifest: contents of ``model.json``.
        files: name -> text of every file, ``model.json`` included.
    """

    manifest: Manifest
    files: Mapping[str, str]


def generate(document: Document, model: Model, order: int = TAYLOR_ORDER) -> Artifacts:
    """Everything that ``generated/<name>/`` holds for a model.

    Args:
        document: the parsed model file, for the hashes.
        model: the same, as the derivation takes it.
        order: highest Taylor coefficient N of the continuous integrator.

    Raises:
        ModelError: when the model needs what no kernel can hold.
    """
    derivation = derive(model)
    functions = build_functions(derivation, order)
    records = describe_functions(derivation, functions)
    texts = _kernel_files(document, derivation, functions, records)
    hashes = {name: sha256(text.encode()) for name, text in texts.items()}
    manifest = describe(document, derivation, records, order, hashes)
    return Artifacts(manifest, {**texts, FILE_NAME: manifest.to_json()})


def _kernel_files(
    document: Document,
    derivation: Derivation,
    functions: Mapping[str, ca.Function],
    records: tuple[Function, ...],
) -> dict[str, str]:
    versions = ", ".join(f"{tool} {version}" for tool, version in tool_versions().items())
    head = banner(
        f"{derivation.model.title}: kernels of the closed loop",
        [
            f"Model {derivation.model.name}, structure {structure_hash(document)[:16]}; {versions}.",
            f"{sum(item.operations for item in records)} operations in {len(records)} functions.",
        ],
    )
    return {
        "kernels.c": kernels_source(functions, head),
        "kernels.h": kernels_header(records, head),
        "kernels.casadi": serialise(functions),
    }


def serialise(functions: Mapping[str, ca.Function]) -> str:
    """The functions in CasADi's own text form, a JSON object from name to text."""
    return json.dumps({name: function.serialize() for name, function in functions.items()}, indent=0) + "\n"
