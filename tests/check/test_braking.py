"""All gates on models that brake and start matched, and what the proof says of another compensator."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import pytest
import sympy as sp

from pmjoint_codegen.check.gates import proof
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.check.table import run_gates, select
from pmjoint_codegen.emit.regenerate import regenerate
from pmjoint_derive import Derivation, Equations, real_symbol
from pmjoint_derive.consistency import sampling_identities

GATES = ("current", "proof", "interpreter", "lanes", "symbolic", "guards", "derivatives", "trajectory")


def variant(root: Path, folder: Path, name: str, **design: str) -> Path:
    """A shipped model with other keys of [design], generated beside its file."""
    text = (root / "models" / f"{name}.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.split("=")[0].strip() not in (*design, "compensator")]
    place = next(i for i, line in enumerate(lines, start=1) if line.startswith("[design]"))
    lines[place:place] = [f"{key} = {value}" for key, value in design.items()]
    (folder / "models").mkdir(exist_ok=True)
    file = folder / "models" / f"{name}.toml"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    regenerate([str(file)])
    return file


BRAKING = {"saturation": '"braking"', "start": '"matched"'}


@pytest.fixture(scope="module")
def braking(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Subject:
    file = variant(root, tmp_path_factory.mktemp("braking"), "paper", ck="[12, 12]", braking="0.5", **BRAKING)
    return load_subject(file, os.environ, lambda _line: None)


def test_the_papers_model_passes(braking: Subject) -> None:
    results = run_gates(braking, select(list(GATES)))
    found = {item.name: item.verdict for item in results}
    wanted = dict.fromkeys(found, Verdict.PASSED) | {"trajectory.golden": Verdict.NOT_RUN}
    assert found == wanted


@pytest.mark.parametrize(
    ("name", "design"), [("third-order", BRAKING), ("joint-lag", {"start": '"matched"'})]
)
def test_other_models_pass(root: Path, tmp_path: Path, name: str, design: dict[str, str]) -> None:
    subject = load_subject(variant(root, tmp_path, name, **design), os.environ, lambda _line: None)
    names = ["proof", "interpreter", "lanes", "symbolic", "trajectory.invariants", "trajectory.certificate"]
    for item in run_gates(subject, select(names)):
        assert item.verdict is Verdict.PASSED, item


def with_equation(derivation: Derivation, name: str, expression: sp.Expr) -> Derivation:
    items = [
        dataclasses.replace(item, expression=expression) if item.name == name else item
        for item in derivation.equations.values()
    ]
    return dataclasses.replace(derivation, equations=Equations(items))


@pytest.mark.parametrize(
    "name",
    ["dbraking_rate_dr1", "dalpha1_dr1", "r1_dot", "r2_dot", "r2_middle", "r1_next", "r2_next"]
    + [f"r1_slope{i}" for i in range(1, 5)]
    + ["braking_rate_start", "r2_start", "v"],
)
def test_a_changed_step_is_no_proof(braking: Subject, name: str) -> None:
    derivation = braking.derivation
    changed = derivation.equations[name].expression * (1 + sp.Rational(1, 1000))
    result = proof.prove_for(with_equation(derivation, name, changed), proof.design_values(derivation))
    assert result.verdict is Verdict.FAILED, name


def test_the_certificate_is_that_of_any_braking_curve(braking: Subject) -> None:
    """It holds with another g in r1_dot and in alpha_1 alike: the curve is the designer's choice."""
    derivation, r1 = braking.derivation, real_symbol("r1")
    other = with_equation(derivation, "braking_rate", r1 + r1**3)
    other = with_equation(other, "dbraking_rate_dr1", 1 + 3 * r1**2)
    assert all(item.holds for item in derivation.design.prove(other))


def test_other_weights_have_a_lower_order(braking: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "pmjoint_derive.braking.combined", lambda r1, T, k: r1 + T * (k[0] + 3 * k[1] + k[2] + k[3]) / 6
    )
    broken = [item.name for item in sampling_identities(braking.derivation) if not item.holds]
    assert broken == ["r1_next", "r1_next, T^3", "r1_next, T^4"]
