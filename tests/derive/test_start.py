"""The matched start: z(0) = 0 and a matched estimate, as identities, for shipped and for drawn plants."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import sympy as sp
from hypothesis import given, settings

from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import Derivation, Model, derive, real_symbol
from pmjoint_derive.consistency import start_identities
from pmjoint_derive.equation import Equations
from pmjoint_derive.start import SECTION

from .test_properties import models

MODELS = ("paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order")


def derived(root: Path, name: str) -> Derivation:
    return derive(model_of(read_document(root / "models" / f"{name}.toml"), name))


@pytest.mark.parametrize("name", MODELS)
def test_nothing_is_left_of_the_errors_of_a_shipped_model(root: Path, name: str) -> None:
    derivation = derived(root, name)
    identities = start_identities(derivation)
    assert len(identities) == derivation.plant.rho + derivation.plant.order
    assert [item.name for item in identities if not item.holds] == []


@settings(max_examples=25, deadline=None)
@given(models())
def test_nothing_is_left_of_the_errors_of_a_drawn_model(model: Model) -> None:
    assert [item.name for item in start_identities(derive(model)) if not item.holds] == []


def test_the_paper_starts_as_written_by_hand(root: Path) -> None:
    equations = derived(root, "paper").equations
    y, y_r, dy_r, ck1 = map(real_symbol, ("y", "y_r", "dy_r", "ck1"))
    signals = frozenset({y, y_r, dy_r})
    found = {name: equations.expand(item.expression, signals) for name, item in equations.items()}
    assert found["xi1_start"] == y
    assert found["r1_start"] == y - y_r
    assert sp.expand(found["r2_start"] - (ck1 * (y - y_r) - dy_r)) == 0
    zeros = ("xi2_start", "Xi11_start", "Xi21_start", "lambda1_start", "lambda2_start")
    assert [found[name] for name in zeros] == [0] * len(zeros)


@pytest.mark.parametrize("name", ["xi2_start", "r1_start", "r2_start", "r3_start", "alpha2_start"])
def test_another_start_leaves_something(root: Path, name: str) -> None:
    derivation = derived(root, "joint-lag")
    item = derivation.equations[name]
    assert item.section == SECTION
    changed = replace(item, expression=item.expression + real_symbol("y") / 10)
    table = [changed if known.name == name else known for known in derivation.equations.values()]
    broken = replace(derivation, equations=Equations(table))
    assert any(not identity.holds for identity in start_identities(broken))
