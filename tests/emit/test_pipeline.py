"""What is generated: complete, deterministic, declared, free of clocks and paths."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp

from pmjoint_codegen.emit.c_text import banner
from pmjoint_codegen.emit.functions import build_function, build_functions
from pmjoint_codegen.emit.loop_table import LOOPS
from pmjoint_codegen.emit.pipeline import TAYLOR_ORDER, Artifacts
from pmjoint_codegen.emit.table import kernel_table
from pmjoint_codegen.emit.vocabulary import vocabulary
from pmjoint_codegen.identity import structure_hash
from pmjoint_codegen.kernels.tape import read_tapes
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.storage import sha256
from pmjoint_derive import Derivation

HASH_OF_ALL = """
from pathlib import Path
from pmjoint_codegen.emit.pipeline import generate
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.storage import sha256
document = read_document(Path("models/paper.toml"))
files = generate(document, model_of(document, "paper")).files
print({name: sha256(text.encode()) for name, text in sorted(files.items())})
"""


@pytest.mark.parametrize("seed", ["0", "1", "4242"])
def test_same_bytes_whatever_the_hash_seed(root: Path, artifacts: Artifacts, seed: str) -> None:
    environment = {**os.environ, "PYTHONHASHSEED": seed}
    run = subprocess.run(
        [sys.executable, "-c", HASH_OF_ALL],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    expected = {name: sha256(text.encode()) for name, text in sorted(artifacts.files.items())}
    assert run.stdout.strip() == str(expected)


def test_neither_clock_nor_path(artifacts: Artifacts, root: Path) -> None:
    for text in artifacts.files.values():
        assert str(root) not in text and str(Path.home()) not in text
        assert not re.search(r"\b20\d\d-\d\d-\d\d\b|\d\d:\d\d:\d\d", text)


def test_a_title_cannot_end_the_comment_that_it_stands_in_or_begin_another() -> None:
    for title in ("a */ int x; /*", "/*/", "*/*"):
        text = banner([title])
        assert (text.count("/*"), text.count("*/")) == (1, 1)


def test_manifest_survives_its_file(artifacts: Artifacts) -> None:
    assert Manifest.from_json(artifacts.files["model.json"], "model.json") == artifacts.manifest
    assert artifacts.manifest.files == {
        name: sha256(text.encode()) for name, text in artifacts.files.items() if name != "model.json"
    }


def test_header_declares_every_kernel_of_the_table(artifacts: Artifacts, paper: Derivation) -> None:
    names = [row.name for row in (*kernel_table(paper), *LOOPS)]
    declared = re.findall(
        r"^int pmjoint_(\w+)\(const double \*\*arg", artifacts.files["kernels.h"], re.MULTILINE
    )
    assert declared == names == [item.name for item in artifacts.manifest.functions]
    assert list(read_tapes(artifacts.files["kernels.tape"])) == names
    made = {row.name for row in LOOPS}
    for name in names:
        file = "loops.c" if name in made else "kernels.c"
        assert re.search(rf"^(?:CASADI_SYMBOL_EXPORT )?int pmjoint_{name}\(", artifacts.files[file], re.M)


def test_kernels_c_is_what_casadi_prints(artifacts: Artifacts, paper: Derivation) -> None:
    """But for the banner, the header's name and fmin, fmax; each function may be printed alone, too."""
    generator = ca.CodeGenerator("kernels", {"static_aux": True, "with_header": False})
    for kernel in kernel_table(paper):
        function = build_function(kernel, paper)
        symbols = function.sx_in()
        labels = function.name_in(), function.name_out()
        generator.add(ca.Function(f"pmjoint_{kernel.name}", symbols, function.call(symbols), *labels))
    head, text = artifacts.files["kernels.c"].split('#include "kernels.h"\n\n')
    pairs = zip(text.splitlines(), generator.dump().splitlines(), strict=True)
    changed = [(ours, printed) for ours, printed in pairs if ours != printed]
    assert changed == [
        ("  return x<=y || y!=y ? x : y;", "  return fmin(x, y);"),
        ("  return x>=y || y!=y ? x : y;", "  return fmax(x, y);"),
    ]
    assert re.fullmatch(r"/\*[^/]*\*/\n", head)


def test_states_parameters_and_blocks_agree_with_the_vocabulary(
    artifacts: Artifacts, paper: Derivation
) -> None:
    manifest, words = artifacts.manifest, vocabulary(paper)
    assert [item.name for item in manifest.states] == [symbol.name for symbol in (*words.x, *words.s)]
    assert list(manifest.parameter_names) == [symbol.name for symbol in words.p]
    assert manifest.blocks == {"x": (0, 2), "xi": (2, 4), "Xi": (4, 6), "lambda": (6, 8), "r": (8, 10)}
    assert {item.name: item.unit for item in manifest.states}["lambda2"] == "V s"


def test_values_do_not_shape_the_kernels(document: dict[str, Any]) -> None:
    """Another value leaves the structure as it is; another expression, name or size does not."""
    same = {**document, "design": {**document["design"], "c": [1, 2]}, "title": "another"}
    assert structure_hash(same) == structure_hash(document)
    for other in (
        {**document, "plant": {**document["plant"], "sigma": "1 + y**2"}},
        {**document, "simulation": {**document["simulation"], "reference": "cos(t)"}},
        {**document, "parameters": {**document["parameters"], "extra": {"value": 1}}},
    ):
        assert structure_hash(other) != structure_hash(document)


@pytest.mark.parametrize("seed", range(5))
def test_law_kernel_equals_the_symbolic_law_at_random_points(paper: Derivation, seed: int) -> None:
    generator = np.random.default_rng(seed)
    law = build_functions(paper, 2)["law"]
    rows = {kernel.name: kernel for kernel in kernel_table(paper)}
    arguments = [generator.uniform(0.2, 3.0, len(symbols)) for _, symbols in rows["law"].inputs]
    point = {
        symbol: sp.Rational(float(value))
        for (_, symbols), values in zip(rows["law"].inputs, arguments, strict=True)
        for symbol, value in zip(symbols, values, strict=True)
    }
    results = np.concatenate([np.array(item).ravel() for item in law(*arguments)])
    names = ["z1", "z2", "alpha1", "v"]
    for name, found in zip(names, results, strict=True):
        expression = sp.expand(paper.expanded(name))
        exact = expression.xreplace(point)
        # the sum of the terms' sizes times the roundings on the longest path (54 operations) bounds the error
        size = sum(abs(term.xreplace(point)) for term in sp.Add.make_args(expression))
        assert abs(found - float(exact)) <= 54 * 2.0**-53 * float(size)


def test_taylor_kernel_starts_with_state_and_rates(paper: Derivation) -> None:
    """Row 0 is (X, v, e), row 1 the rates of the closed loop in the same mode."""
    functions = build_functions(paper, TAYLOR_ORDER)
    generator = np.random.default_rng(7)
    X, g, p = generator.normal(size=10), np.array([10.0, 0.0]), generator.uniform(0.5, 2.0, 15)
    rows = np.array(functions["taylor"](0.3, X, g, p)).reshape(TAYLOR_ORDER + 1, 12)
    rates, *values = (np.array(part).ravel() for part in functions["closed_loop"](0.3, X, g, p))
    np.testing.assert_array_equal(rows[0, :10], X)
    np.testing.assert_allclose(rows[1, :10], rates, rtol=1e-13)
    np.testing.assert_allclose(rows[0, 10:], np.concatenate(values), rtol=1e-13)
    names = [symbol.name for symbol in vocabulary(paper).signals]
    signals = np.array(functions["signals"](0.3, X, p)).ravel()
    assert rows[0, 10] == pytest.approx(signals[names.index("v")], rel=1e-14)
    assert rows[0, 11] == pytest.approx(signals[names.index("e")], rel=1e-14)
