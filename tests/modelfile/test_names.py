"""Which names a parameter may bear."""

from __future__ import annotations

import keyword
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.emit.pipeline import generate
from pmjoint_codegen.emit.vocabulary import vocabulary
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.names import key_path, why_not
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.operations import functions
from pmjoint_derive import OutsideClassError, Parameter, Plant, Signals, derive


@pytest.mark.parametrize(
    "name",
    [
        *"abcdefghijklmnopqrswxz",
        *"ABCDEFGHIJKLMNOPQRSTUVWXYZ",
        *("d1", "b0", "u_max", "b_v", "k_u", "k0", "u0", "C1", "eps0", "tau", "damping_d2"),
        *("theta", "phi", "sigma", "lamda", "omega", "int", "double", "register", "static"),
    ],
)
def test_a_physicists_names_are_free(name: str) -> None:
    assert why_not(name) is None


@pytest.mark.parametrize("name", ["", "1a", "a b", "a-b", "ä", "a.b", "_a", "x" * 41, "a\n"])
def test_ill_formed(name: str) -> None:
    assert "is not a name" in str(why_not(name))


@pytest.mark.parametrize("name", keyword.kwlist)
def test_words_of_the_language_of_expressions(name: str) -> None:
    assert why_not(name) == "is a word of Python, in whose notation expressions are written"


@pytest.mark.parametrize(
    "name",
    [
        *functions(),
        "abs",
        "sign",
        "min",
        "max",
        "pi",
        "t",
        "y",
        "u",
        "v",
        "du",
        "y_r",
        "c1",
        "ck12",
        "D1",
        "x_hat2",
        "dalpha1_dy",
        "x1_dot",
        "nan",
    ],
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


Edit = Callable[..., dict[str, Any]]
MODELS = sorted((Path(__file__).resolve().parents[2] / "models").glob("*.toml"))
PHYSICISTS = {"d1", "b0", "a", "kappa", "P1", "P2", "p1", "p2", "q1", "q2"}  # taken in [joint] alone


def names_of(document: dict[str, Any]) -> set[str]:
    """Return every name in a model's derivation and kernels but those of its parameters."""
    derivation = derive(model_of(document, "model"))
    words = vocabulary(derivation)
    blocks = (words.p, words.x, words.s, words.w, words.g, words.h)
    found = {symbol.name for block in blocks for symbol in block} | set(derivation.equations)
    for equation in derivation.equations.values():
        found |= {symbol.name for symbol in equation.expression.free_symbols}
    return found - {item.name for item in derivation.model.parameters}


@pytest.mark.parametrize("path", MODELS, ids=[path.stem for path in MODELS])
def test_no_parameter_can_bear_the_name_of_an_equation(path: Path) -> None:
    """Each name that the derivation defines, given to a parameter of the same model, is refused.

    The tracking error alone makes room: it is called e_y beside a parameter e.
    """
    document = read_document(path)
    for name in sorted(names_of(document) - {"e"}):
        document["parameters"][name] = {"value": 1.0}
        with pytest.raises(ModelError, match=rf"parameters\.{name}: (already|is a word of)"):
            model_of(document, "model")
        del document["parameters"][name]


def test_composite_coefficients_are_names_of_the_derivation(paper: dict[str, Any]) -> None:
    document = {**paper, "plant": {**paper["plant"], "b": ["2*b0"], "theta": ["d1 + 1"]}}
    assert {"b_0", "theta_1"} <= names_of(document)
    assert {name for name in names_of(document) if why_not(name) is None} == {"e"}


@pytest.mark.parametrize("name", sorted(PHYSICISTS))
def test_a_plant_may_use_the_joints_names(edited: Edit, name: str) -> None:
    model = model_of(edited({f"parameters.{name}": {"value": 1.0}}), "model")
    assert name in {item.name for item in model.parameters}


def test_the_derivation_itself_refuses_what_a_reader_let_through(paper: dict[str, Any]) -> None:
    model = model_of(paper, "model")
    parameters = (*model.parameters, Parameter("Omega", 1.0, "1", ""))
    with pytest.raises(OutsideClassError, match=r"parameters\.Omega: already names an equation"):
        derive(replace(model, parameters=parameters))
    with pytest.raises(ModelError, match=r"paper: parameters\.Omega: already names an equation"):
        generate(paper, replace(model, parameters=parameters))


def test_the_tracking_error_makes_room_for_a_parameter_e(edited: Edit) -> None:
    document = edited({"parameters.e": {"value": 0.5}, "plant.phi": ["0", "-e*y"]})
    derivation = derive(model_of(document, "model"))
    error, known = derivation.equations["e_y"], derivation.equations["x2_dot"].expression.free_symbols
    assert (error.meaning, error.symbol.name) == ("tracking error, e = z1 + r1", "e_y")
    assert sp.Symbol("e", real=True) in known
    manifest = generate(document, model_of(document, "model"), order=4, lanes=False).manifest
    assert [item.name for item in manifest.signals][:3] == ["y", "y_r", "e"]


def test_two_names_for_the_tracking_error_leave_it_none(edited: Edit) -> None:
    document = edited({"parameters.e": {"value": 0.5}, "parameters.e_y": {"value": 0.5}})
    with pytest.raises(ModelError, match=r"parameters\.e_y: already names an equation"):
        generate(document, model_of(document, "model"))


def test_a_parameter_k_is_not_the_gains_k(edited: Edit) -> None:
    document = edited({"parameters.k": {"value": -1.0}, "actuator.limit": "k"})
    with pytest.raises(ModelError, match=r"model: parameters\.k\.value: is -1"):
        model_of(document, "model")
