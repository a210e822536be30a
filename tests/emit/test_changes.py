"""What two versions of generated files differ in, whatever version of this package wrote them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import pytest

from pmjoint_codegen.emit.changes import EQUATIONS, Change, changes, content_of
from pmjoint_codegen.emit.pipeline import Artifacts
from pmjoint_codegen.manifest import FILE_NAME


def test_what_is_gone_stands_where_it_was_and_what_is_new_where_it_is() -> None:
    before = {"a": 1, "gone": 2, "b": 3, "c": 4, "last": 5}
    after = {"new": 0, "a": 1, "b": 30, "between": 6, "c": 4}
    assert changes(before, after) == (
        Change("new", None, 0),
        Change("gone", 2, None),
        Change("b", 3, 30),
        Change("between", None, 6),
        Change("last", 5, None),
    )
    assert changes(before, before) == ()


def test_names_that_moved_are_no_change() -> None:
    assert changes({"a": 1, "b": 2, "c": 3}, {"c": 3, "a": 1, "b": 2}) == ()


@pytest.mark.parametrize(
    ("change", "lines"),
    [
        (Change("v", "1", "2"), ["- v = 1", "+ v = 2"]),
        (Change("v", None, "2"), ["+ v = 2"]),
        (Change("v", "1", None), ["- v = 1"]),
    ],
)
def test_an_equation_is_told_as_a_diff(change: Change, lines: list[str]) -> None:
    assert list(change.equation_lines()) == lines


def test_a_value_is_told_without_none() -> None:
    assert str(Change("d3", None, -0.5)) == "d3: new, -0.5"
    assert str(Change("d3", -0.5, None)) == "d3: gone, was -0.5"
    assert str(Change("d3", 1, 2)) == "d3: 1 -> 2"


def test_equations_are_read_where_any_version_put_them(artifacts: Artifacts) -> None:
    files = {name: text.encode() for name, text in artifacts.files.items()}
    now = content_of(files)
    assert {"z1", "alpha1", "v"} <= now.equations.keys()
    manifest: dict[str, Any] = json.loads(files["model.json"])
    items = [{"name": name, "text": text} for name, text in now.equations.items()]
    bare = {name: data for name, data in files.items() if name != EQUATIONS}
    inside = {**bare, "model.json": json.dumps({**manifest, "equations": items}).encode()}
    manifest.pop("equations", None)
    apart = {
        **bare,
        "model.json": json.dumps(manifest).encode(),
        EQUATIONS: json.dumps({"equations": items}).encode(),
    }
    assert content_of(inside).equations == content_of(apart).equations == now.equations


def test_values_are_those_of_the_model_file(artifacts: Artifacts) -> None:
    content = content_of({name: text.encode() for name, text in artifacts.files.items()})
    assert content.values["d1"] == 0.2
    assert content.values["unit of b0"] == "rad/(s^2 V)"
    assert content.values["x0"] == [1.5, 0.0]
    assert content.values["D_max"] == 0.1
    assert not any(name.endswith("_plant") for name in content.values)
    assert content.sizes["kernels.c"] == len(artifacts.files["kernels.c"].encode())


def test_a_parameter_with_the_name_of_another_statement_is_seen_to_change() -> None:
    def content(value: float) -> Mapping[str, object]:
        manifest = {
            "parameters": [{"name": "horizon", "kind": "plant", "value": value, "unit": "s", "about": ""}],
            "simulation": {"horizon": 20.0},
            **{"disturbance_bound": None, "limit": "u_max", "title": "", "source": ""},
            **{"functions": [], "states": [], "signals": []},
        }
        files = {FILE_NAME: json.dumps(manifest).encode(), EQUATIONS: b'{"equations": []}'}
        return content_of(files).values

    assert changes(content(1.0), content(2.0)) == (Change("parameter horizon", 1.0, 2.0),)
