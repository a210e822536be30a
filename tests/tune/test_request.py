"""Requests: what is refused before anything is computed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.tune.request import make_request


def test_plants_follow_from_the_seed(paper: Manifest) -> None:
    def draw(seed: int) -> list[float]:
        drawn: list[float] = (
            make_request(paper, perturb=("b0~uniform(1.6,2.4)",), seed=seed).plants["b0_plant"].tolist()
        )
        return drawn

    assert draw(7) == draw(7) != draw(8)
    assert draw(7)[0] == 2.0
    assert len(draw(7)) == 17
    assert np.all((np.array(draw(7)) > 1.6) & (np.array(draw(7)) < 2.4))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"max_v": 0.0}, "--max-v"),
        ({"max_v": float("nan")}, "--max-v"),
        ({"plants": 3}, "--plants"),
        ({"perturb": ("b0",)}, "--perturb: is 'b0'"),
        ({"perturb": ("b00~uniform(1,2)",)}, "did you mean b0"),
        ({"perturb": ("c1~uniform(1,2)",)}, "no 'c1' to perturb"),
        ({"perturb": ("b0~uniform(1,2)", "b0~uniform(1,2)")}, "b0_plant is given twice"),
        ({"perturb": ("b0~uniform(1,2)",), "plants": 0}, "--plants"),
        ({"perturb": ("u_max~normal(10,10)",)}, "--perturb: draws . plants that break a rule"),
        ({"seed": -1}, "seed from 0"),
        ({"generations": 0}, "--generations"),
        ({"population": 10_000_000}, "at most"),
        ({"horizon": -1.0}, "horizon"),
    ],
)
def test_misuse_is_refused(paper: Manifest, settings: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        make_request(paper, **settings)


def test_plants_that_no_joint_can_be_are_refused(root: Path) -> None:
    joint = Manifest.read(root / "generated" / "joint")
    with pytest.raises(UsageError, match=r"--perturb: draws \d+ plants that break a rule"):
        make_request(joint, perturb=("J~uniform(-0.05,0.05)",))
