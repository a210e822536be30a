"""The compiler from a model to the files of ``generated/<name>/``, as text; nothing is written here.

Stages, input to output:

    derive           Model               -> Derivation (named equations)
    build_functions  Derivation          -> CasADi functions, one for each row of the table and of `loop_rows`
    kernels_source   rows' functions     -> kernels.c, which CasADi prints
    tapes_of         functions           -> tapes -> kernels.tape, for the interpreted evaluator
    loops_source     tapes               -> loops.c, called by the loops of single runs
    sampled_header   tapes               -> sampled.h, included by the sampled loop
    kernels_header   function records    -> kernels.h
    lane_functions   functions           -> functions over lanes -> tapes -> lanes.c, lanes.h, for sweeps
    equations_text   Derivation          -> equations.json, for comparisons
    derivation_page  Derivation          -> derivation.md, for reviewers
    describe         all of the above    -> model.json
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from pmjoint_codegen.emit.affine import Entry
from pmjoint_codegen.emit.c_text import banner, kernels_header, kernels_source
from pmjoint_codegen.emit.changes import EQUATIONS
from pmjoint_codegen.emit.compact import Compact, compact_where_long
from pmjoint_codegen.emit.describe import (
    describe,
    describe_functions,
    equations_text,
    tool_versions,
)
from pmjoint_codegen.emit.functions import build_functions, lane_functions
from pmjoint_codegen.emit.guard import looks_at_actuator, rule_of
from pmjoint_codegen.emit.lane_text import lanes_header, lanes_source
from pmjoint_codegen.emit.lanes import lane_sizes
from pmjoint_codegen.emit.loop_table import lane_rows, loop_rows
from pmjoint_codegen.emit.print_c import steps
from pmjoint_codegen.emit.sampling import SAMPLED, sampled_sizes
from pmjoint_codegen.emit.scalar_text import HEADER as SAMPLED_HEADER
from pmjoint_codegen.emit.scalar_text import loops_source, sampled_header
from pmjoint_codegen.emit.table import Taylor
from pmjoint_codegen.emit.tape import tapes_of
from pmjoint_codegen.emit.vocabulary import neutral_entry, vocabulary
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.identity import Document, structure_hash
from pmjoint_codegen.kernels.tape import FILE_NAME as TAPE
from pmjoint_codegen.kernels.tape import write_tapes
from pmjoint_codegen.kernels.turn import alone
from pmjoint_codegen.manifest import FILE_NAME, Function, Manifest
from pmjoint_codegen.report.markdown import markdown_report
from pmjoint_codegen.storage import sha256
from pmjoint_derive import Derivation, Model, OutsideClassError, derive
from pmjoint_derive.progress import Stage, unwatched

PAGE = "derivation.md"
TAYLOR_ORDER = 16  # least time to 1e-9 for the paper's loop; see docs/design.md


@dataclass(frozen=True)
class Artifacts:
    """The generated files of one model.

    Attributes:
        manifest: contents of ``model.json``.
        files: name -> text of every file, ``model.json`` included.
    """

    manifest: Manifest
    files: Mapping[str, str]


@alone
def generate(
    document: Document,
    model: Model,
    order: int = TAYLOR_ORDER,
    stage: Stage = unwatched,
    *,
    lanes: bool = True,
) -> Artifacts:
    """The whole content of ``generated/<name>/`` for a model.

    Args:
        document: the parsed model file, for the hashes.
        model: the same, as input of the derivation.
        order: highest Taylor coefficient N of the continuous integrator.
        stage: called with the name of each stage and the fraction of it completed.
        lanes: whether to write the C for sweeps, too; a single run does without.

    Raises:
        ModelError: if no kernel can express the model, or it is outside the class.
    """
    try:
        derivation = derive(model, stage)
    except OutsideClassError as error:
        raise ModelError(error.what, where=f"{model.name}: {error.key}", remedy=error.remedy) from error
    functions = build_functions(derivation, order, stage)
    records = describe_functions(derivation, functions)
    stage("writing C", 0.0)
    compacts = _compacts(functions, order, neutral_entry(derivation))
    texts = _kernel_files(document, derivation, functions, compacts, records)
    if lanes:
        stage("writing C for sweeps", 0.0)
        texts |= _lane_files(document, derivation, functions)
    stage("writing the derivation", 0.0)
    texts[PAGE] = derivation_page(document, derivation)
    stage("describing the kernels", 0.0)
    texts[EQUATIONS] = equations_text(derivation)
    hashes = {name: sha256(text.encode()) for name, text in texts.items()}
    guards = {
        row.name: rule_of(functions[row.of], row.order or order)
        for row in (*loop_rows(functions), *lane_rows(functions))
        if isinstance(row, Taylor)
    }
    windows = not looks_at_actuator(functions["plant_guard"], len(vocabulary(derivation).w))
    manifest = describe(document, derivation, records, order, guards, windows, hashes)
    return Artifacts(manifest, {**texts, FILE_NAME: manifest.to_json()})


def _kernel_files(
    document: Document,
    derivation: Derivation,
    functions: Mapping[str, ca.Function],
    compacts: Sequence[Compact],
    records: tuple[Function, ...],
) -> dict[str, str]:
    operations = sum(item.operations for item in records)
    size = f"{operations} operations in {len(records)} functions."
    head = provenance(document, derivation, "kernels", size)
    made = {row.name for row in loop_rows(functions)}
    tapes = tapes_of(functions.values())
    sampled = [tape for tape in tapes if tape.name in SAMPLED]
    called = [tape for tape in tapes if tape.name in made and tape.name not in SAMPLED]
    rows = [function for name, function in functions.items() if name not in made]
    sizes = sampled_sizes(vocabulary(derivation), functions)
    return {
        "kernels.c": kernels_source(rows, banner(head)),
        "kernels.h": kernels_header(records, banner(head)),
        "loops.c": loops_source(called, sampled, compacts, banner(head[:2])),
        SAMPLED_HEADER: sampled_header(sampled, sizes, banner(head[:2])),
        TAPE: "\n".join(f"# {line}" for line in head) + "\n\n" + write_tapes(tapes),
    }


def _compacts(functions: Mapping[str, ca.Function], order: int, neutral: Entry) -> list[Compact]:
    """The kernels of Taylor coefficients up to the order of a run's steps that are not straight lines."""
    rows = (row for row in loop_rows(functions) if isinstance(row, Taylor) and row.order is None)
    found = (
        compact_where_long(row.name, functions[row.of], order, state=row.state, neutral=neutral)
        for row in rows
    )
    return [compact for compact in found if compact is not None]


def derivation_page(document: Document, derivation: Derivation) -> str:
    """``derivation.md``: every equation, those of the certificate too, with the values of the model file."""
    equations = (*derivation.equations.values(), *derivation.design.certificate(derivation))
    return markdown_report(derivation.model, equations, provenance(document, derivation, "derivation")) + "\n"


def provenance(document: Document, derivation: Derivation, what: str, *more: str) -> list[str]:
    """What a generated file is, what made it, and from what; no clock, no path."""
    versions = ", ".join(f"{tool} {version}" for tool, version in tool_versions().items())
    return [
        f"{derivation.model.title}: {what}. Generated by `pmjoint regenerate`; do not edit.",
        f"Model {derivation.model.name}, structure {structure_hash(document)[:16]}; {versions}.",
        *more,
    ]


def _lane_files(
    document: Document, derivation: Derivation, functions: Mapping[str, ca.Function]
) -> dict[str, str]:
    words = vocabulary(derivation)
    lanes = tapes_of(lane_functions(functions, neutral_entry(derivation)).values())
    operations = sum(len(steps(tape)) for tape in lanes)
    size = f"{operations} operations in {len(lanes)} functions over lanes, for sweeps."
    head = banner(provenance(document, derivation, "kernels", size))
    return {
        "lanes.c": lanes_source(lanes, head),
        "lanes.h": lanes_header(lanes, lane_sizes(words, functions), head),
    }
