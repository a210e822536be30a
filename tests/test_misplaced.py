"""Advice about names: where one that is not known here belongs."""

from __future__ import annotations

import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.misplaced import advice
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.tune.gains import make_space


@pytest.fixture(scope="module")
def manifest() -> Manifest:
    """Return the manifest of a joint, whose x0 has physical names."""
    return ClosedLoop.load("joint").manifest


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("c", "here: c1, c2"),
        ("theta", "give --x0 with theta, theta_dot, in this order"),
        ("y_r", "give --reference"),
        ("horizon", "give --horizon"),
        ("disturbance", "give --disturbance"),
        ("c12", "names: J, b_v"),
    ],
)
def test_a_parameter_that_is_something_else(manifest: Manifest, name: str, said: str) -> None:
    with pytest.raises(UsageError) as caught:
        make_settings(manifest, parameters={name: 2.0})
    assert caught.value.what == f"joint has no parameter {name!r}"
    assert said in caught.value.remedy


def test_a_sweep_and_a_search_advise_too(manifest: Manifest) -> None:
    with pytest.raises(UsageError, match=r"has no 'c' to vary.*here: c1, c2"):
        make_request(manifest, make_plan(("c=1,2",), (), None, 0, "sobol"))
    with pytest.raises(UsageError, match="has no gain 'theta'; it is an initial value"):
        make_space(manifest, ("theta=1:2",))
    with pytest.raises(UsageError, match="has no gain 'J'; it is a parameter: give --set J=VALUE"):
        make_space(manifest, ("J=1:2",))


def test_names_without_another_meaning_are_listed(manifest: Manifest) -> None:
    assert advice(manifest, "foo", ("a", "b")) == "names: a, b"
