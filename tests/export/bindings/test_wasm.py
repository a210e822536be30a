"""The WebAssembly module under node: the host's bits, its interface, and what its run must find."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import pytest

from pmjoint_codegen.errors import CheckFailed, MissingToolError
from pmjoint_codegen.export import fields
from pmjoint_codegen.export.bindings import wasm
from pmjoint_codegen.export.bindings.replay import input_names
from pmjoint_codegen.export.elsewhere import library_functions
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.statements import program_of
from pmjoint_codegen.export.targets.target import Order
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.modelfile import model_of
from pmjoint_derive import derive

from ..conftest import document

pytest.importorskip("ziglang", reason="the package ziglang is not installed")
pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="no node")


@dataclass(frozen=True)
class Written:
    """An export on disk."""

    order: Order
    folder: Path


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Written]:
    """Export a model once."""

    @cache
    def write(name: str) -> Written:
        contents = document(name)
        derivation = derive(model_of(contents, name))
        identity = Identity(contents["name"], "0" * 64, "test")
        order = Order(derivation, identity, contents, DOUBLE, os.environ, Path(f"{name}.toml").absolute())
        folder = tmp_path_factory.mktemp(name)
        for place, data in wasm.deliver(order).files.items():
            (folder / place).write_bytes(data.encode() if isinstance(data, str) else data)
        return Written(order, folder)

    return write


@pytest.mark.parametrize("name", ["paper", "braking", "third-nonlinear", "paper-adaptive"])
def test_recorded_samples_have_the_bits_of_this_machine_or_are_within_the_bound(
    written: Callable[[str], Written], name: str
) -> None:
    made = written(name)
    record = wasm.run(made.order, made.folder).record
    assert record["samples"] >= 1000 and record["step_over_bound"] <= 1.0
    functions = library_functions(program_of(made.order.derivation))
    assert record["library_functions"] == list(functions)
    assert functions or record["other_bits"] == 0


def test_one_other_literal_is_noticed(written: Callable[[str], Written], tmp_path: Path) -> None:
    made = written("paper")
    folder = shutil.copytree(made.folder, tmp_path / "changed")
    wrapper = folder / "pmjoint_paper.mjs"
    text = wrapper.read_text()
    assert "const flags = this.#exports.controller_init();" in text
    changed = text.replace("const flags =", "this.params.d1 *= 1 + 2 ** -40;\n    const flags =")
    wrapper.write_text(changed)
    with pytest.raises(CheckFailed, match="other bits"):
        wasm.run(made.order, folder)


def test_controllers_are_apart_and_wrong_use_is_an_error(written: Callable[[str], Written]) -> None:
    made = written("paper")
    program = """
import { BAD_INPUT, BAD_PARAMETER, Controller, load } from "./pmjoint_paper.mjs";
const module = await load();
const [a, b] = [new Controller(module), new Controller(module)];
const at = (y) => ({ y, ...EXTRA });
function caught(action) {
  try { action(); return "nothing"; } catch (error) { return error.constructor.name; }
}
const told = { early: caught(() => a.step(at(1))) };
a.init(at(1)); b.init(at(1));
a.step(at(1));
const saved = a.save();
a.step(at(0.5));
const first = a.output.v;
b.step(at(1)); b.step(at(0.5));
told.apart = b.output.v === first;
a.restore(saved); a.step(at(0.5));
told.restored = a.output.v === first;
told.nan = a.step(at(NaN)).flags === BAD_INPUT;
const { y, ...without } = at(1);
told.without = caught(() => a.step(without));
told.short = caught(() => a.restore(new Uint8Array(3)));
a.params.sample_time = -1;
told.bad = a.init(at(1)) === BAD_PARAMETER;
told.after = caught(() => a.step(at(1)));
console.log(JSON.stringify(told));
"""
    names = [name for name in input_names(program_of(made.order.derivation)) if name != "y"]
    extra = "{" + ", ".join(f"{name}: 0" for name in names) + "}"
    text = program.replace("EXTRA", extra)
    (made.folder / "use.mjs").write_text(text)
    done = subprocess.run(["node", "use.mjs"], cwd=made.folder, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == {
        **{"early": "Error", "apart": True, "restored": True, "nan": True, "without": "TypeError"},
        **{"short": "TypeError", "bad": True, "after": "Error"},
    }


def test_the_types_name_every_field(written: Callable[[str], Written]) -> None:
    made = written("paper")
    text = (made.folder / "pmjoint_paper.d.mts").read_text()
    program = program_of(made.order.derivation)
    for kind, items in (
        ("Params", fields.parameter_fields(program)),
        ("Output", fields.output_fields(program)),
    ):
        body = text.split(f"export interface {kind} {{", 1)[1].split("\n}", 1)[0]
        assert re.findall(r"^  (\w+): number;$", body, re.MULTILINE) == [item.name for item in items]


def test_the_module_has_the_same_bytes_from_another_cache_entry(written: Callable[[str], Written]) -> None:
    made = written("paper")
    module = (made.folder / "pmjoint_paper.wasm").read_bytes()
    assert len(module) < 15_000
    folder = Path(os.environ["PMJOINT_CACHE"]) / "wasm"
    for place in folder.iterdir():
        shutil.rmtree(place)
    assert wasm.deliver(made.order).files["pmjoint_paper.wasm"] == module


def test_without_node_one_line_names_it(written: Callable[[str], Written], tmp_path: Path) -> None:
    made = written("paper")
    order = replace(made.order, environment={"PATH": str(tmp_path)})
    with pytest.raises(MissingToolError, match="apt-get install nodejs"):
        wasm.run(order, made.folder)
