"""Tables ``[adaptation]`` that tests change, and models with one."""

from __future__ import annotations

from typing import Any

from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import Model
from pmjoint_derive.adaptation import Adaptation
from tests.modelfile.conftest import PAPER

Table = dict[str, Any]
RANGES: Table = {"b0": [0.3, 6.0], "d1": [-3.0, 3.0]}
BOTH: Table = {
    "unknown": ["b0", "d1"],
    "guess": {"b0": 1.2, "d1": -0.5},
    "range": RANGES,
    "gain": {"b0": 1.0, "d1": 1.0},
    "leakage": 0.0,
}
INVERTED: Table = {"unknown": ["b0"], "form": "inverse", "guess": {"b0": 1.2}, "gain": {"b0": 2.0}}
SQUARES: Table = {"unknown": ["b0", "d1"], "range": RANGES, "estimator": "least_squares"}


def adapted(model: Model) -> Adaptation:
    assert model.adaptation is not None
    return model.adaptation


def of_file(name: str, table: Table, **tables: Any) -> Model:
    document = read_document(PAPER.parent / f"{name}.toml")
    return model_of({**document, **tables, "adaptation": table}, name)
