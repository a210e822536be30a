"""Exports of the models that these tests need, each made once."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.export.package import Export, export_c
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.tree import DOUBLE, FLOAT
from pmjoint_codegen.modelfile import model_of
from pmjoint_derive import derive

ROOT = Path(__file__).resolve().parents[2]
CHAIN = {
    "actuator": {"lower": -8.0, "upper": 10.0, "rate": 2000.0, "dead_zone": 0.3},
    "sensor": {"resolution": 0.001, "filter": 300.0},
}
Make = Callable[..., Export]


def document(name: str) -> dict[str, Any]:
    """Return a model's contents: one of models/ or its gallery, a variant of the paper's, a test's own."""
    if name == "third-nonlinear":
        file = ROOT / "tests" / "reference" / "third-nonlinear.toml"
        return tomllib.loads(file.read_text(encoding="utf-8"))
    shipped = name if name not in ("braking", "chain", "pi") else "paper"
    place = ROOT / "models" / f"{shipped}.toml"
    file = place if place.is_file() else ROOT / "models" / "gallery" / f"{shipped}.toml"
    found = tomllib.loads(file.read_text(encoding="utf-8"))
    if name == "braking":
        found["design"] |= {"saturation": "braking", "braking": 0.5}
        del found["design"]["compensator"]
    if name == "chain":
        found |= CHAIN
    if name == "pi":  # a number that no literal of the C holds exactly
        found["plant"]["b"] = ["4*b0/pi"]
    return found


@cache
def made(name: str, precision: str) -> Export:
    """Export a model once."""
    model = model_of(document(name), name)
    kind = {"double": DOUBLE, "float": FLOAT}[precision]
    return export_c(derive(model), Identity(name, "0" * 64, "test"), kind)


@pytest.fixture(scope="session")
def exports() -> Make:
    """Export a model by name: a shipped one, ``braking``, ``chain``, ``pi`` or ``third-nonlinear``."""
    return lambda name, precision="double": made(name, precision)


@pytest.fixture(scope="session")
def load(cache: Path) -> Callable[..., Exported]:
    """Compile and load an export of double precision."""
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    return lambda name: Exported.load(made(name, "double"), compiler, cache)


@pytest.fixture(scope="session")
def documents() -> Callable[[str], Mapping[str, Any]]:
    """Return the contents of a model by name."""
    return document
