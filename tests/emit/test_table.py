"""The table predicts what is generated: its names are the functions that stand in ``generated/``."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import sympy as sp

from pmjoint_codegen.emit.loop_table import LANES, LOOPS
from pmjoint_codegen.emit.table import kernel_table
from pmjoint_codegen.emit.vocabulary import vocabulary
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import derive
from pmjoint_derive.signals import partial_name

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = sorted(path.stem for path in (ROOT / "models").glob("*.toml"))
PREFIX = re.compile(r"pmj(oint)?_")
DEFINED = re.compile(r"^(?:CASADI_SYMBOL_EXPORT )?(\w[\w ]*?)[ *]+(\w+)\([^;{}]*\)\s*\{", re.MULTILINE)
# what CasADi's calling convention adds to each function
COMPANION = re.compile(
    r"_(alloc_mem|init_mem|free_mem|checkout|release|incref|decref|n_in|n_out|default_in"
    r"|name_in|name_out|sparsity_in|sparsity_out|work|work_bytes)$"
)


def exported(folder: Path) -> set[str]:
    """Return the functions that the C files of a folder define for others."""
    found = {
        name
        for file in folder.glob("*.c")
        for kind, name in DEFINED.findall(file.read_text(encoding="utf-8"))
        if "static" not in kind.split() and not name.startswith("kernels_casadi_")
    }
    alone = {name for name in found if COMPANION.sub("", name) not in found - {name}}
    assert all(PREFIX.match(name) for name in alone), "a linker's names are everybody's"
    return {PREFIX.sub("", name) for name in alone}


@pytest.mark.parametrize("name", SHIPPED)
def test_its_names_are_the_functions_in_generated(name: str) -> None:
    folder, file = ROOT / "generated" / name, ROOT / "models" / f"{name}.toml"
    kernels = kernel_table(derive(model_of(read_document(file), file.name)))
    rows = [row.name for row in (*kernels, *LOOPS, *LANES)]
    assert len(set(rows)) == len(rows)
    assert exported(folder) == set(rows)
    described = Manifest.read(folder).functions
    assert [item.name for item in described] == [row.name for row in (*kernels, *LOOPS)]
    assert [item.about for item in described] == [row.about for row in (*kernels, *LOOPS)]


def test_every_row_is_made_from_rows_before_it() -> None:
    file = ROOT / "models" / "paper.toml"
    known = {row.name for row in kernel_table(derive(model_of(read_document(file), file.name)))}
    for made in (*LOOPS, *LANES):
        assert {made.of} if isinstance(made.of, str) else set(made.of) <= known, made.name
        known.add(made.name)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_partial_derivative_is_a_column_where_it_does_not_vanish(name: str) -> None:
    file = ROOT / "models" / f"{name}.toml"
    derivation = derive(model_of(read_document(file), file.name))
    s, found = derivation.signals, []
    for alpha in s.alpha:
        value = derivation.expanded(alpha.name)
        found += [partial_name(alpha, by) for by in s.measurable if sp.expand(sp.diff(value, by)) != 0]
    assert found and [item.name for item in vocabulary(derivation).partials] == found
