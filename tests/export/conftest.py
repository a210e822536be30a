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
INVERSE = {"form": "inverse", "inverse": {"gain": 0.5, "leakage": 0.01}, "leakage": 0.01}
SQUARES = {
    "unknown": ["b0", "d1"],
    "guess": {"b0": 1.2, "d1": -0.5},
    "range": {"b0": [0.3, 6.0], "d1": [-3.0, 3.0]},
    "estimator": "least_squares",
}
NEGATIVE = {"guess": {"b0": -1.2, "d1": -0.5}, "range": {"b0": [-6.0, -0.3], "d1": [-3.0, 3.0]}}
FIRST_ORDER = {"order": 1, "Phi": [["y"]], "theta": ["d1"], "b": ["b0"], "disturbance": ["0"]}
LEARNING: dict[str, dict[str, Any]] = {
    "inverse": INVERSE,
    "squares": SQUARES,
    "negative": NEGATIVE,
    "first-order": {},
}
Make = Callable[..., Export]


def document(name: str) -> dict[str, Any]:
    """Return a model's contents: one of models/ or its gallery, a variant of the paper's, a test's own."""
    if name == "third-nonlinear":
        file = ROOT / "tests" / "reference" / "third-nonlinear.toml"
        return tomllib.loads(file.read_text(encoding="utf-8"))
    if name in LEARNING:
        return learning(name)
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


def learning(name: str) -> dict[str, Any]:
    """Return the paper's model with estimates, in a variant of its own."""
    found = document("paper-adaptive")
    if name == "squares":
        found["adaptation"] = SQUARES
    found["adaptation"] = {**found["adaptation"], **LEARNING[name]}
    if name == "negative":
        found["parameters"]["b0"]["value"] = -2.0
    if name == "first-order":
        found["parameters"]["d1"]["unit"] = "1/s"
        found["parameters"]["b0"]["unit"] = "rad/(s V)"
        found["plant"] = {**FIRST_ORDER, "disturbance_bound": 0.0}
        found["design"] |= {"c": [5], "e": [0.1], "ck": [2], "k": [4]}
        found["simulation"]["x0"] = [1.5]
    return found


@cache
def made(name: str, precision: str) -> Export:
    """Export a model once."""
    model = model_of(document(name), name)
    kind = {"double": DOUBLE, "float": FLOAT}[precision]
    return export_c(derive(model), Identity(name, "0" * 64, "test"), kind)


@pytest.fixture(scope="session")
def exports() -> Make:
    """Export a model by name: a shipped one, a variant of the paper's, or ``third-nonlinear``."""
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
