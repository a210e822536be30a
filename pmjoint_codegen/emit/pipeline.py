"""The compiler from a model to the files of ``generated/<name>/``, as text; nothing is written here.

Stages, input to output:

    derive           Model               -> Derivation (named equations)
    build_functions  Derivation          -> CasADi functions, one a row of the table, and the loops' own
    kernels_source   rows' functions     -> kernels.c, which CasADi prints
    tapes_of         functions           -> tapes -> kernels.tape, for the interpreted evaluator
    loops_source     tapes               -> loops.c, what the loops of single runs call
    sampled_header   tapes               -> sampled.h, what the sampled loop takes in
    kernels_header   function records    -> kernels.h
    lane_functions   functions           -> functions over lanes -> tapes -> lanes.c, lanes.h, for sweeps
    describe         all of the above    -> model.json
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from pmjoint_codegen.emit.c_text import banner, kernels_header, kernels_source
from pmjoint_codegen.emit.describe import describe, describe_functions, tool_versions
from pmjoint_codegen.emit.functions import COMPOSED, build_functions
from pmjoint_codegen.emit.guard import looks_at_actuator, rule_of
from pmjoint_codegen.emit.lane_text import lanes_header, lanes_source
from pmjoint_codegen.emit.lanes import LANE_ORDER, lane_functions, lane_sizes
from pmjoint_codegen.emit.print_c import steps
from pmjoint_codegen.emit.sampling import HOLD_ORDER, PLANT_ORDER, SAMPLED, sampled_sizes
from pmjoint_codegen.emit.scalar_text import HEADER as SAMPLED_HEADER
from pmjoint_codegen.emit.scalar_text import loops_source, sampled_header
from pmjoint_codegen.emit.table import vocabulary
from pmjoint_codegen.emit.tape import tapes_of
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.identity import Document, structure_hash
from pmjoint_codegen.kernels.tape import FILE_NAME as TAPE
from pmjoint_codegen.kernels.tape import write_tapes
from pmjoint_codegen.manifest import FILE_NAME, Function, Manifest
from pmjoint_codegen.storage import sha256
from pmjoint_derive import Derivation, Model, OutsideClassError, derive
from pmjoint_derive.progress import Stage, unwatched

TAYLOR_ORDER = 16  # least time to 1e-9 for the paper's loop; see docs/design.md
LOWEST_ORDER = 8
MOST_OPERATIONS = 20_000  # of `taylor`: some 0.7 MB of C, compiled in well under half a minute


@dataclass(frozen=True)
class Artifacts:
    """What one model generates.

    Attributes:
        manifest: contents of ``model.json``.
        files: name -> text of every file, ``model.json`` included.
    """

    manifest: Manifest
    files: Mapping[str, str]


def generate(
    document: Document, model: Model, order: int | None = None, stage: Stage = unwatched
) -> Artifacts:
    """Everything that ``generated/<name>/`` holds for a model.

    Args:
        document: the parsed model file, for the hashes.
        model: the same, as the derivation takes it.
        order: highest Taylor coefficient N of the continuous integrator; by default `affordable_functions`
            chooses.
        stage: told what is being made.

    Raises:
        ModelError: when the model needs what no kernel can hold, or is outside the class.
    """
    try:
        derivation = derive(model, stage)
    except OutsideClassError as error:
        raise ModelError(error.what, where=f"{model.name}: {error.key}", remedy=error.remedy) from error
    if order is None:
        order, functions = affordable_functions(derivation, stage)
    else:
        functions = build_functions(derivation, order, stage)
    records = describe_functions(derivation, functions)
    stage("writing C", 0.0)
    texts = _kernel_files(document, derivation, functions, records)
    stage("writing C for sweeps", 0.0)
    texts |= _lane_files(document, derivation, functions)
    stage("describing the kernels", 0.0)
    hashes = {name: sha256(text.encode()) for name, text in texts.items()}
    guards = {
        "taylor": rule_of(functions["closed_loop"], order),
        "plant_taylor": rule_of(functions["plant"], PLANT_ORDER),
        "taylor_lanes": rule_of(functions["closed_loop"], LANE_ORDER),
        "plant_lanes": rule_of(functions["plant"], HOLD_ORDER),
    }
    windows = not looks_at_actuator(functions["plant_guard"], len(vocabulary(derivation).w))
    manifest = describe(document, derivation, records, order, guards, windows, hashes)
    return Artifacts(manifest, {**texts, FILE_NAME: manifest.to_json()})


def affordable_functions(
    derivation: Derivation, stage: Stage = unwatched
) -> tuple[int, dict[str, ca.Function]]:
    """The kernels, with Taylor coefficients up to an order that C compilers can afford, and that order.

    Straight-line Taylor code of order N has about (N + 1)(N + 2)/2 terms for each product of the loop. Where
    order 16 takes more than `MOST_OPERATIONS`, the order is lowered to what this law allows, but not below 8;
    steps are then shorter, at the same tolerance.
    """
    functions = build_functions(derivation, TAYLOR_ORDER, stage)
    operations = functions["taylor"].n_instructions()
    if operations <= MOST_OPERATIONS:
        return TAYLOR_ORDER, functions
    allowed = (TAYLOR_ORDER + 1) * (TAYLOR_ORDER + 2) * MOST_OPERATIONS // operations
    order = next(n for n in range(TAYLOR_ORDER, 0, -1) if n == LOWEST_ORDER or (n + 1) * (n + 2) <= allowed)
    return order, build_functions(derivation, order, stage)


def _kernel_files(
    document: Document,
    derivation: Derivation,
    functions: Mapping[str, ca.Function],
    records: tuple[Function, ...],
) -> dict[str, str]:
    head = provenance(document, derivation, records)
    tapes = tapes_of(functions.values())
    sampled = [tape for tape in tapes if tape.name in SAMPLED]
    called = [tape for tape in tapes if tape.name in COMPOSED and tape.name not in SAMPLED]
    rows = [function for name, function in functions.items() if name not in COMPOSED]
    sizes = sampled_sizes(vocabulary(derivation), functions)
    return {
        "kernels.c": kernels_source(rows, banner(head)),
        "kernels.h": kernels_header(records, banner(head)),
        "loops.c": loops_source(called, sampled, banner(head[:2])),
        SAMPLED_HEADER: sampled_header(sampled, sizes, banner(head[:2])),
        TAPE: "\n".join(f"# {line}" for line in head) + "\n\n" + write_tapes(tapes),
    }


def provenance(document: Document, derivation: Derivation, records: tuple[Function, ...]) -> list[str]:
    """What a generated file is, what made it, and from what; no clock, no path."""
    versions = ", ".join(f"{tool} {version}" for tool, version in tool_versions().items())
    operations = sum(item.operations for item in records)
    return [
        f"{derivation.model.title}: kernels. Generated by `pmjoint regenerate`; do not edit.",
        f"Model {derivation.model.name}, structure {structure_hash(document)[:16]}; {versions}.",
        f"{operations} operations in {len(records)} functions.",
    ]


def _lane_files(
    document: Document, derivation: Derivation, functions: Mapping[str, ca.Function]
) -> dict[str, str]:
    words = vocabulary(derivation)
    lanes = tapes_of(lane_functions(functions).values())
    operations = sum(len(steps(tape)) for tape in lanes)
    what = f"{operations} operations in {len(lanes)} functions over lanes, for sweeps."
    head = banner([*provenance(document, derivation, ())[:2], what])
    return {
        "lanes.c": lanes_source(lanes, head),
        "lanes.h": lanes_header(lanes, lane_sizes(words, functions), head),
    }
