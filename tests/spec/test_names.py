"""Which names a parameter may bear."""

from __future__ import annotations

import pytest
import sympy as sp

from derive import Signals
from derive.model import Plant
from pmjoint_codegen.spec.names import FUNCTIONS, key_path, why_not


@pytest.mark.parametrize(
    "name", ["d1", "b0", "u_max", "J", "b_v", "k_u", "k0", "u0", "C1", "eps0", "tau", "a", "damping_d2"]
)
def test_a_physicists_names_are_free(name: str) -> None:
    assert why_not(name) is None


@pytest.mark.parametrize("name", ["", "1a", "a b", "a-b", "ä", "a.b", "_a", "x" * 41, "a\n"])
def test_ill_formed(name: str) -> None:
    assert "is not a name" in str(why_not(name))


@pytest.mark.parametrize("name", ["lambda", "double", "if", "None", "int"])
def test_words_of_the_languages(name: str) -> None:
    assert why_not(name) == "is a word of C or Python"


@pytest.mark.parametrize(
    "name", [*FUNCTIONS, "pi", "t", "y", "c1", "ck12", "D1", "x_hat2", "dalpha1_dy", "x1_dot", "nan"]
)
def test_names_that_mean_something_already(name: str) -> None:
    assert "already names" in str(why_not(name))


def test_no_signal_of_any_design_can_be_shadowed() -> None:
    zero = (sp.Integer(0),) * 9
    signals = Signals.of(Plant(9, zero, (zero,) * 9, zero, (sp.Integer(1),), sp.Integer(1), zero))
    groups = [getattr(signals, field) for field in signals.__dataclass_fields__]
    flat = [group if isinstance(group, tuple) else (group,) for group in groups]
    symbols = [
        entry for group in flat for item in group for entry in (item if isinstance(item, tuple) else (item,))
    ]
    assert len(symbols) > 100
    assert [str(symbol) for symbol in symbols if why_not(str(symbol)) is None] == []


def test_places_are_written_as_a_reader_counts() -> None:
    assert key_path(("plant", "Phi", 1, 0)) == "plant.Phi, entry 2, entry 1"
    assert key_path(("parameters", "a b", "value")) == "parameters.'a b'.value"
