"""Target fmu: both units in one loop in FMPy against ``simulate --controller sampled``."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.errors import CheckFailed, MissingToolError
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.targets import fmu
from pmjoint_codegen.export.targets.target import Order
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import derive

MODELS = Path(__file__).resolve().parents[3] / "models"


def ordered(name: str) -> Order:
    """Order the units of a model by the name of its file."""
    file = MODELS / f"{name}.toml"
    document = read_document(file)
    derivation = derive(model_of(document, name))
    return Order(derivation, Identity("unit", "0" * 64, "test"), document, DOUBLE, os.environ, file)


def written(order: Order, folder: Path) -> Path:
    """Write the four files."""
    for name, contents in fmu.deliver(order).files.items():
        (folder / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    return folder


@pytest.fixture
def with_compiler() -> None:
    """Skip where nothing can be compiled."""
    if find_compiler(os.environ) is None:
        pytest.skip("no C compiler")


@pytest.mark.usefixtures("with_compiler")
@pytest.mark.parametrize("name", ["paper", "gallery/laas-axis", "paper-adaptive"])
def test_the_units_follow_the_sampled_run(name: str, tmp_path: Path) -> None:
    order = ordered(name)
    record: dict[str, Any] = dict(fmu.run(order, written(order, tmp_path)).record)
    for version in (2, 3):
        assert 0.0 <= record[f"fmi{version}_y_difference"] <= 1e-12
        assert record[f"fmi{version}_v_difference"] <= record["v_bound"]


@pytest.mark.usefixtures("with_compiler")
def test_a_controller_with_another_gain_is_found(tmp_path: Path) -> None:
    order = ordered("paper")
    design = order.document["design"]
    changed = {**order.document, "design": {**design, "c": [15.0 * (1 + 1e-7), *design["c"][1:]]}}
    other = dataclasses.replace(order, derivation=derive(model_of(changed, "changed")))
    written(other, tmp_path)
    with pytest.raises(CheckFailed, match="differ from simulate"):
        fmu.run(order, tmp_path)


def test_without_fmpy_one_line_says_what_installs_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingToolError) as told:
        fmu.run(ordered("paper"), tmp_path)
    assert "pmjoint-codegen[fmu]" in told.value.remedy
