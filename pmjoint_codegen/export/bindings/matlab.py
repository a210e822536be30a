"""Target ``matlab``: a MEX function of the exported C and a class around it, for MATLAB and GNU Octave."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from pmjoint_codegen.errors import BuildError, MissingToolError
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
from pmjoint_codegen.export.package import export_c
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.source import banner, filled, joined, words_of
from pmjoint_codegen.export.targets.target import Delivery, Order, Report, Target

FOLDER: Final = Path(__file__).parent / "matlab"
_TOOLS: Final = ("octave-cli", "mkoctfile")
_LIMIT: Final = 240.0  # s; Octave takes three


def deliver(order: Order) -> Delivery:
    """The sources; the reader's MATLAB or Octave compiles them."""
    export = export_c(order.derivation, order.identity, order.precision, order.hold)
    program, prefix = export.program, order.identity.prefix
    words = words_of(program, order.identity, order.precision) | {
        "model": comment(order.identity.model),
        "short": order.identity.model_hash[:16],
        "rho": str(program.derivation.plant.rho),
        "references": str(len(input_names(program)) - 1),
        "y0": repr(program.derivation.model.simulation.x0[0]),
    }
    blocks = _places(program, prefix) | {"banner": banner(program, order.identity, order.precision)}

    def text(template: str, own: dict[str, list[Line]]) -> str:
        return joined(filled((FOLDER / template).read_text(encoding="utf-8"), own, words))

    files: dict[str, str | bytes] = {
        **{name: export.files[name] for name in (f"{prefix}.c", f"{prefix}.h")},
        f"{prefix}_mex.c": text("mex.c.in", blocks),
        f"{prefix}.m": text("controller.m.in", {}),
        "build.m": text("build.m.in", {}),
        f"{prefix}_example.m": text("example.m.in", {}),
        "README.md": text("README.md.in", {"parameters": parameter_rows(program, order.precision)}),
    }
    return Delivery(files, Report())


def _places(program: Program, prefix: str) -> dict[str, list[Line]]:
    """Names and places of fields, from the same list as the header's."""

    def rows(kind: str, items: Iterable[Field]) -> list[Line]:
        return [
            Line(
                f'    {{"{item.name}", offsetof({prefix}_{kind}, {item.name}), {int(item.kind == INTEGER)}}},'
            )
            for item in items
        ]

    return {
        "params": rows("params", fields.parameter_fields(program)),
        "state": rows("state", fields.state_fields(program)),
        "output": rows("output", fields.output_fields(program)),
        "reference": [Line(f"    offsetof({prefix}_input, {name}),") for name in input_names(program)[1:]],
    }


def run(order: Order, folder: Path) -> Report:
    """Run the example and recorded samples under Octave; compare with this machine and with the equations."""
    octave, builder = (shutil.which(tool, path=order.environment.get("PATH")) for tool in _TOOLS)
    if octave is None or builder is None:
        raise MissingToolError(
            "octave-cli and mkoctfile are needed to run the export",
            remedy="install them: apt-get install octave octave-dev",
        )
    folder, prefix = folder.resolve(), order.identity.prefix
    command = [octave, "--norc", "--quiet"]
    built = ended([*command, "--eval", "build"], folder, _LIMIT)
    if built.returncode != 0:
        raise BuildError("mkoctfile fails", where=str(folder), output=built.stderr)
    printed(ended([*command, f"{prefix}_example.m"], folder, _LIMIT), folder, "error:")
    replay = replay_of(order)
    program = replay.export.program
    names = [",".join(output_names(program)), ",".join(state_names(program))]
    script = [str(FOLDER / "replay.m"), prefix, *names, str(replay.given.shape[1])]

    def ask(given: Path, found: Path) -> str:
        done = ended([*command, *script, str(given), str(found)], folder, _LIMIT)
        return printed(done, folder, "error:")

    told, agreement = asked(replay, f"{prefix} under Octave", ask)
    step = f"{told['step_us']:g} us a step through the class, the best of two passes"
    return Report({**agreement.record, "step_us": told["step_us"]}, (f"Octave: {agreement.line}", step))


TARGET: Final = Target(deliver, run, bakes=True)
