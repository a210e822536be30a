"""The exception tree: exit codes, one line each, and nothing lost on the way between processes."""

from __future__ import annotations

import pickle
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmjoint_codegen import errors
from pmjoint_codegen.errors import BuildError, ModelError, PmjointError, SimulationError, quoted

KINDS = [kind for name in errors.__all__ if isinstance(kind := getattr(errors, name), type)]


@pytest.mark.parametrize("kind", KINDS)
def test_the_docstring_is_the_tree(kind: type[PmjointError]) -> None:
    line = re.search(rf"^ +{kind.__name__} +exit (\d)", errors.__doc__ or "", re.MULTILINE)
    if kind is PmjointError:
        assert line is None
    else:
        assert line is not None and int(line[1]) == kind.exit_code


def test_parts_make_one_line() -> None:
    assert str(ModelError("is 0", where="m.toml: plant.order", remedy="allowed: 1 to 9")) == (
        "m.toml: plant.order: is 0; allowed: 1 to 9"
    )
    assert str(PmjointError("failed")) == "failed"


@given(st.text(), st.text(), st.text())
def test_whatever_the_parts_hold_it_is_one_printable_line(what: str, where: str, remedy: str) -> None:
    text = str(PmjointError(what, where=where, remedy=remedy))
    assert text.isprintable()


@pytest.mark.parametrize("kind", KINDS)
def test_survives_pickling(kind: type[PmjointError]) -> None:
    error = pickle.loads(pickle.dumps(kind("what", where="where", remedy="remedy")))
    assert type(error) is kind
    assert str(error) == "where: what; remedy"


def test_pickling_keeps_what_a_kind_adds() -> None:
    assert pickle.loads(pickle.dumps(BuildError("x", output="line 1\nline 2"))).output == "line 1\nline 2"
    assert pickle.loads(pickle.dumps(SimulationError("x", run=[1, 2]))).run == [1, 2]


def test_quoting_shows_short_text_and_cuts_long_text() -> None:
    assert quoted("a'b") == '"a\'b"'
    assert len(quoted("x" * 10**6)) <= 60
    assert quoted(float("nan")) == "nan"
    assert "digits" in quoted(10**5000)
