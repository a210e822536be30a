"""Target ``wasm``: a WebAssembly module without imports, an ES module around it, and its types."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from pmjoint_codegen.compile.zig import wasm_module, zig_compiler
from pmjoint_codegen.errors import CheckFailed, MissingToolError
from pmjoint_codegen.export import fields
from pmjoint_codegen.export.bindings.replay import (
    asked,
    ended,
    input_names,
    output_names,
    printed,
    replay_of,
    state_names,
)
from pmjoint_codegen.export.companions import parameter_rows
from pmjoint_codegen.export.fields import INTEGER, Field
from pmjoint_codegen.export.lines import Line, comment
from pmjoint_codegen.export.package import Export, export_c
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.source import banner, filled, joined, words_of
from pmjoint_codegen.export.targets.target import Delivery, Order, Report, Target
from pmjoint_codegen.workspace import cache_dir

FOLDER: Final = Path(__file__).parent / "wasm"
EXPORTED: Final = ("base", "size", "offset", "defaults", "init", "reset", "step", "self_test")
# zig reserves 16 MB for the stack, in every instance; a step needs a few kilobytes.
LINKER: Final = ("-z,stack-size=65536",)
_LIMIT: Final = 120.0  # s; node takes one


def deliver(order: Order) -> Delivery:
    """The module and what is around it.

    Raises:
        MissingToolError: ziglang is not installed.
        BuildError: it failed.
    """
    export = export_c(order.derivation, order.identity, order.precision, order.hold)
    program, prefix = export.program, order.identity.prefix
    sources = {name: export.files[name] for name in (f"{prefix}.c", f"{prefix}.h")}
    sources["wasm.c"] = _filled("wasm.c.in", export, _offsets(program, prefix), {})
    exported = [f"controller_{name}" for name in EXPORTED]
    given = {name: text.encode() for name, text in sources.items()}
    cache = cache_dir(order.environment, order.notify)
    module = wasm_module(given, exported, zig_compiler(order.environment), cache, LINKER)
    y0 = repr(program.derivation.model.simulation.x0[0])
    names = input_names(program)
    words = {
        "size": str(len(module)),
        "Array": "Float32Array" if order.precision.suffix else "Float64Array",
        "y0": y0,
        "zeros": ", ".join(f"{name}: 0" for name in names),
    }
    files: dict[str, str | bytes] = {
        **sources,
        f"{prefix}.wasm": module,
        f"{prefix}.mjs": _filled(
            "controller.mjs.in",
            export,
            _names(program),
            words | {"sample": ", ".join(f'"{name}"' for name in names)},
        ),
        f"{prefix}.d.mts": _filled("controller.d.mts.in", export, _types(program), words),
        "example.mjs": _filled("example.mjs.in", export, {}, words),
        "README.md": _filled(
            "README.md.in",
            export,
            {"parameters": parameter_rows(program, order.precision)},
            words | {"sample": ", ".join(names)},
        ),
    }
    line = f"{prefix}.wasm: {len(module)} bytes, no imports"
    return Delivery(files, Report({"module_bytes": len(module)}, (line,)))


def _filled(template: str, export: Export, blocks: Mapping[str, list[Line]], words: Mapping[str, str]) -> str:
    """A template of this folder with the words that all have."""
    program, identity = export.program, export.identity
    known = words_of(program, identity, export.precision) | {
        "model": comment(identity.model),
        "short": identity.model_hash[:16],
        "rho": str(program.derivation.plant.rho),
    }
    blocks = {"banner": banner(program, identity, export.precision), **blocks}
    return joined(filled((FOLDER / template).read_text(encoding="utf-8"), blocks, {**known, **words}))


def _structures(program: Program) -> dict[str, tuple[Field, ...]]:
    """The structures that JavaScript sees, as the header declares them."""
    return {
        "params": fields.parameter_fields(program),
        "state": fields.state_fields(program),
        "input": fields.input_fields(program),
        "output": fields.output_fields(program),
    }


def _lines(program: Program, line: Callable[[str, Field], str]) -> dict[str, list[Line]]:
    return {kind: [Line(line(kind, item)) for item in items] for kind, items in _structures(program).items()}


def _offsets(program: Program, prefix: str) -> dict[str, list[Line]]:
    return _lines(program, lambda kind, item: f"        offsetof({prefix}_{kind}, {item.name}),")


def _names(program: Program) -> dict[str, list[Line]]:
    return _lines(program, lambda _, item: f'    ["{item.name}", {int(item.kind == INTEGER)}],')


def _types(program: Program) -> dict[str, list[Line]]:
    def typed(item: Field) -> str:
        return f"  /** {comment(item.about)} */\n  {item.name}: number;"

    sample = [Line(typed(item)) for item in fields.input_fields(program) if item.name in input_names(program)]
    return _lines(program, lambda _, item: typed(item)) | {"sample": sample}


def run(order: Order, folder: Path) -> Report:
    """Run the example and recorded samples under node; compare with this machine and with the equations."""
    node = shutil.which("node", path=order.environment.get("PATH"))
    if node is None:
        raise MissingToolError(
            "node is needed to run the export", remedy="install it: apt-get install nodejs"
        )
    folder = folder.resolve()
    printed(ended([node, "example.mjs"], folder, _LIMIT), folder, "Error")
    replay = replay_of(order)
    program, prefix = replay.export.program, order.identity.prefix
    outputs, states = output_names(program), state_names(program)
    columns = {"inputs": input_names(program), "outputs": outputs, "states": states}
    script = [str(FOLDER / "replay.mjs"), str(folder / f"{prefix}.mjs"), json.dumps(columns)]

    def ask(given: Path, found: Path) -> str:
        return printed(ended([node, *script, str(given), str(found)], folder, _LIMIT), folder, "Error")

    told, agreement = asked(replay, f"{prefix}.wasm under node", ask)
    if told["imports"]:
        raise CheckFailed(f"the module has {told['imports']} imports", where=str(folder))
    step = f"{told['step_ns']:.0f} ns a step through the wrapper, the best of five passes"
    return Report({**agreement.record, "step_ns": told["step_ns"]}, (f"node: {agreement.line}", step))


TARGET: Final = Target(deliver, run, bakes=True)
