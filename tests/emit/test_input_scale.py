"""An input scale of 1 changes no bit of any kernel, single or over lanes."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy as sp

from pmjoint_codegen.emit.functions import build_functions, lane_functions
from pmjoint_codegen.emit.vocabulary import neutral_entry
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import Derivation, derive
from pmjoint_derive.signals import Signals

MODELS = ("paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order")
ORDER = 16


def derived(root: Path, name: str) -> Derivation:
    return derive(model_of(read_document(root / "models" / f"{name}.toml"), name))


def kernels(derivation: Derivation, *, neutral: bool) -> dict[str, ca.Function]:
    made = build_functions(derivation, ORDER)
    return made | lane_functions(made, neutral_entry(derivation) if neutral else None)


def results(function: ca.Function, scale: int, seed: int) -> list[np.ndarray]:
    """Every output at a random point where the input scale is 1; nothing else is special."""
    draw = np.random.default_rng(seed)
    arguments = []
    for i, label in enumerate(function.name_in()):
        values = draw.normal(size=function.size1_in(i))
        if label == "p":
            values[scale] = 1.0
        arguments.append(values)
    return [np.array(entries).ravel() for entries in function.call(arguments)]


def differing(a: ca.Function, b: ca.Function, scale: int) -> int:
    """How many of 20 random points give other bits."""
    return sum(
        not np.array_equal(found, expected, equal_nan=True)
        for seed in range(20)
        for found, expected in zip(results(a, scale, seed), results(b, scale, seed), strict=True)
    )


@pytest.mark.parametrize("name", MODELS)
def test_at_one_every_kernel_has_the_bits_of_the_law_without_a_scale(
    root: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scaled = derived(root, name)
    scale = neutral_entry(scaled)[1]
    now = kernels(scaled, neutral=True)
    with monkeypatch.context() as patch:
        patch.setattr(Signals, "weights", property(lambda s: (sp.Integer(1),) * len(s.z)))
        former = kernels(derived(root, name), neutral=True)
    assert now.keys() == former.keys()
    assert {kernel: differing(now[kernel], former[kernel], scale) for kernel in now} == dict.fromkeys(now, 0)


def test_a_scale_that_counts_as_any_factor_changes_the_order_of_additions(root: Path) -> None:
    """What the test above guards against: the paper's Taylor kernel has other bits without the entry."""
    paper = derived(root, "paper")
    scale = neutral_entry(paper)[1]
    counted, neutral = (kernels(paper, neutral=wanted)["taylor_lanes"] for wanted in (False, True))
    assert differing(counted, neutral, scale) > 0
