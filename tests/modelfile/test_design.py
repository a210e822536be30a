"""What the keys of ``[design]`` come to: poles, a bandwidth, an input scale."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.design import polynomial

from .conftest import Edit


@pytest.mark.parametrize(
    ("poles", "wanted"),
    [
        (20.0, (40.0, 400.0)),
        ((3.0, 4.0), (7.0, 12.0)),
        (((3.0, 4.0),), (6.0, 25.0)),
        (((3.0, 4.0), 0.1), (6.1, 25.6, 2.5)),
    ],
)
def test_poles_give_their_polynomial_exactly(poles: Any, wanted: tuple[float, ...]) -> None:
    assert polynomial(poles, len(wanted)) == wanted
    roots = np.roots([1.0, *polynomial(poles, len(wanted))])
    assert np.all(roots.real < 0)


def test_poles_stand_for_k(edited: Edit) -> None:
    gains = model_of(edited({"design.k": None, "design.poles": [[3.0, 1.0]]}), "m.toml").gains
    assert gains.k == (6.0, 10.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"design.poles": 20.0}, "design.poles: k and poles are both given"),
        ({"design.k": None}, "design.k: is missing; .* or give poles or bandwidth"),
        ({"design.e": None}, "design.e: is missing; .* or give bandwidth"),
        ({"design.k": None, "design.poles": [1.0, 2.0, 3.0]}, r"design.poles: has 3 entries; allowed: 2"),
        ({"design.k": None, "design.poles": [[1.0, 2.0, 3.0]]}, "design.poles: is a list of 1"),
        ({"design.k": None, "design.poles": -2.0}, "design.poles: is -2"),
        ({"design.input_scale": 0.0}, "design.input_scale: is 0"),
        ({"design.input_scale": "much"}, 'design.input_scale: is the text .*; allowed: .* or "auto"'),
        ({"design.input_scale": True}, "design.input_scale: is true"),
        ({"design.bandwidth": 0.0}, "design.bandwidth: is 0"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(edited: Edit, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message) as caught:
        model_of(edited(changes), "m.toml")
    assert "\n" not in str(caught.value)


def test_auto_is_the_size_of_b_m_at_the_files_values(edited: Edit) -> None:
    model = model_of(edited({"design.input_scale": "auto", "plant.b": ["-3*b0"]}), "m.toml")
    assert model.gains.input_scale == 6.0
    assert model.chosen == ("design of the model: input_scale = 6",)
    assert model_of(edited({}), "m.toml").chosen == ()


def test_a_bandwidth_gives_what_is_left_out_and_explicit_gains_win(edited: Edit) -> None:
    """Of the paper's plant, b_m = 2 and d1 > 0; by hand: e2 = 0.05 w (b_m/w)^2."""
    left_out = dict.fromkeys(("design.c", "design.e", "design.ck", "design.k"))
    gains = model_of(edited(left_out | {"design.bandwidth": 10.0}), "m.toml").gains
    assert gains.by_kind == {
        "c": (10.0, 10.0), "e": (0.1, 0.02), "ck": (2.0, 2.0), "k": (20.0, 100.0)
    }  # fmt: skip
    scaled = {"design.bandwidth": 10.0, "design.input_scale": "auto"}
    assert model_of(edited(left_out | scaled), "m.toml").gains.e == (0.1, 0.005)
    stable = {"design.bandwidth": 10.0, "parameters.d1.value": -100.0}
    assert model_of(edited(left_out | stable), "m.toml").gains.ck == (17.5, 17.5)
    mixed = model_of(edited({"design.k": None, "design.bandwidth": 10.0, "design.poles": 7.0}), "m.toml")
    assert mixed.gains.c == (15.0, 15.0) and mixed.gains.k == (14.0, 49.0)
    assert mixed.chosen == ("design of bandwidth 10.0, poles 7.0: k = [14.0, 49.0]",)
