"""Advice about names: where one that is not known here belongs."""

from __future__ import annotations

import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.simulate import command as simulate
from pmjoint_codegen.cli.tune import command
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.misplaced import _OPTIONS, advice
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.tune.gains import OFFERED, make_space


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
    with pytest.raises(UsageError, match="has no gain 'J'; it stays as it is in the model file; names: c, "):
        make_space(manifest, ("J=1:2",))
    with pytest.raises(UsageError, match="has no gain 'tolerance'; names: c, "):
        make_space(manifest, ("tolerance=1:2",))


def test_a_search_advises_the_options_that_it_has() -> None:
    options = {option for item in command.params for option in item.opts}
    run = {option for item in simulate.params for option in item.opts}
    assert {*OFFERED} == options & run & {*advised()}
    assert "--set" in run - options


def advised() -> set[str]:
    """The options that advice may name."""
    return {"--x0", *_OPTIONS.values()}


def test_names_without_another_meaning_are_listed(manifest: Manifest) -> None:
    assert advice(manifest, "foo", ("a", "b")) == "names: a, b"
