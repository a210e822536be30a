"""The space that is searched: bounds, and filter gains that cannot leave the Hurwitz ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.tune.gains import make_space
from pmjoint_codegen.values import INPUT_SCALE, gain_names, is_hurwitz


def test_the_model_is_where_the_search_starts(paper: Manifest) -> None:
    space = make_space(paper, ())
    own = {item.name: item.value for item in paper.parameters}
    for name, value in space.decode(space.start[np.newaxis, :]).items():
        assert value[0] == pytest.approx(own[name], rel=1e-4), name  # five digits are kept
    gains = {item.name for item in paper.parameters if item.kind == "gain"}
    assert set(space.gains) == gains - {INPUT_SCALE}  # which stands for a unit


@pytest.mark.parametrize("model", ["paper", "third-order"])
def test_every_point_has_a_hurwitz_filter(root: Path, model: str) -> None:
    manifest = Manifest.read(root / "generated" / model)
    space = make_space(manifest, ("poles=0.01:1000", "damping=0.01:10"))
    low, high = space.limits.T
    u = np.random.default_rng(1).random((500, space.size))
    gains = space.decode(low + u * (high - low))
    rows = np.column_stack([gains[name] for name in gain_names(("k",), manifest.n)])
    assert all(is_hurwitz([1.0, *row]) for row in rows.tolist())


def test_poles_are_the_roots_of_the_filter(paper: Manifest) -> None:
    space = make_space(paper, ("poles=1:100", "damping=0.3:2"))
    gains = space.decode(np.log([[20.0, 1.0]]))
    assert [gains["k1"][0], gains["k2"][0]] == [40.0, 400.0]


def test_bounds_hold_and_groups_spread(paper: Manifest) -> None:
    space = make_space(paper, ("c=2:60", "ck2"))
    assert [(bound.name, bound.low, bound.high) for bound in space.bounds] == [
        ("c1", 2.0, 60.0),
        ("c2", 2.0, 60.0),
        ("ck2", 0.2, 5.0),
    ]
    assert space.gains == ("c1", "c2", "ck2")


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (("q",), "no gain 'q'"),
        (("c1=5",), "--gain: is 'c1=5'"),
        (("c1=5:2",), "LOW < HIGH"),
        (("c1=0:2",), "0 < LOW"),
        (("c1=a:b",), "c1=a:b"),
        (("c", "c1"), "c1 is given twice"),
        (("k", "poles"), "the same gains"),
        (("b0",), "no gain 'b0'"),
    ],
)
def test_misuse_is_refused(paper: Manifest, wanted: tuple[str, ...], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        make_space(paper, wanted)
