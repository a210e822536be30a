"""From a model file to what the derivation takes, and what only mathematics finds wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.schema import DesignSpec
from pmjoint_codegen.values import COMPENSATOR, GAINS, INPUT_SCALE
from pmjoint_derive import Signals
from pmjoint_derive import real_symbol as symbol

Edit = Callable[[dict[str, Any]], dict[str, Any]]


def test_the_papers_model(paper: dict[str, Any]) -> None:
    model = model_of(paper, "m.toml")
    y, t, x2, d1, b0 = (symbol(name) for name in ("y", "t", "x2", "d1", "b0"))
    assert model.plant.Phi == ((0,), (y,)) and model.plant.theta == (d1,) and model.plant.b == (b0,)
    assert model.plant.disturbance == (0, sp.Rational(1, 10) * sp.sin(x2) * sp.cos(t))
    assert model.plant.sigma == 1 and model.reference == sp.sin(t) and model.limit == symbol("u_max")
    assert [item.value for item in model.parameters] == [0.2, 2.0, 10.0]
    assert model.gains.k == (6.0, 8.0) and model.gains.compensator
    assert model.simulation.x0 == (1.5, 0.0) and model.disturbance_bound == 0.1


def test_gains_are_one_table(paper: dict[str, Any]) -> None:
    """The file's keys, the derivation's record and its symbols are what the table says, in its order."""
    kinds = [kind.name for kind in GAINS]
    model = model_of(paper, "m.toml")
    signals = Signals.of(model.plant)
    others = ["compensator", INPUT_SCALE, "poles", "bandwidth", "saturation", "braking", "start"]
    assert [*DesignSpec.model_fields] == ["law", "observer", *kinds, *others]
    assert [*model.gains.by_kind] == [*signals.gains_by_kind] == kinds
    named = [name for kind in GAINS for name in kind.names(model.plant.order, model.plant.rho)]
    assert [str(gain) for gain in signals.gains] == [*named, COMPENSATOR, INPUT_SCALE]


def test_what_is_left_out_is_zero(edited: Edit) -> None:
    left_out = dict.fromkeys(["plant.phi", "plant.Phi", "plant.theta", "plant.disturbance"])
    plant = model_of(edited(left_out), "m.toml").plant
    assert plant.phi == (0, 0) and plant.Phi == ((), ()) and plant.theta == () and plant.disturbance == (0, 0)


def rho_1(b: list[str]) -> dict[str, Any]:
    return {"plant.b": b, "design.c": [1], "design.e": [1], "design.ck": [1]}


def test_stable_zero_dynamics_of_either_sign_pass(edited: Edit) -> None:
    for b in (["b0", "1"], ["-b0", "-1"]):
        assert model_of(edited(rho_1(b)), "m.toml").plant.rho == 1


MISTAKES = [
    (
        {"plant.phi": ["0", "__import__('os')"]},
        "plant.phi, entry 2: \"__import__('os')\": unknown function '__import__'; allowed:",
    ),
    (
        {"plant.phi": ["0", "x2"]},
        "plant.phi: depends on x2, which the controller does not measure; use y and parameters only",
    ),
    ({"plant.phi": ["0", "x1"]}, "plant.phi: depends on x1, which is y here; use y"),
    ({"plant.Phi": [["0"], ["t"]]}, "plant.Phi: depends on t, which the controller does not measure"),
    ({"plant.sigma": "1 + x2**2"}, "plant.sigma: depends on x2, which the controller does not measure"),
    (
        {"plant.phi": ["0", "x3"]},
        "plant.phi, entry 2: 'x3': unknown symbol 'x3'; allowed here: y, d1, b0, u_max, pi",
    ),
    (
        {"plant.sigma": "1 + b_0*y"},
        "plant.sigma: '1 + b_0*y': unknown symbol 'b_0'; did you mean 'b0'? allowed here",
    ),
    (
        {"plant.theta": ["y"]},
        "plant.theta, entry 1: 'y': unknown symbol 'y'; allowed here: d1, b0, u_max, pi",
    ),
    ({"plant.b": ["y"]}, "plant.b, entry 1: 'y': unknown symbol 'y'"),
    ({"plant.disturbance": ["0", "x3"]}, "plant.disturbance, entry 2: 'x3': unknown symbol 'x3'"),
    ({"simulation.reference": "y"}, "simulation.reference: 'y': unknown symbol 'y'; allowed here: t, d1"),
    ({"plant.b": ["0"]}, "plant.b: the leading coefficient b_m is zero"),
    ({"plant.b": ["(d1 + 1)**2 - d1**2 - 2*d1 - 1"]}, "plant.b: the leading coefficient b_m is zero"),
    (
        {"plant.b": ["b0*d1"], "parameters.d1.value": 0.0},
        "plant.b, entry 1: b_m is 0 at the given parameters",
    ),
    (
        {"parameters.b0.value": 0.0},
        "parameters.b0.value: is 0, so b_m = 0 and no input acts; allowed: a number other",
    ),
    ({"plant.sigma": "0"}, "plant.sigma: sigma is zero, so no input acts"),
    (
        {"plant.sigma": "sin(y)**2 + cos(y)**2 - 1"},
        "plant.sigma: sigma is 0 at the initial state",
    ),
    ({"plant.sigma": "d1", "parameters.d1.value": 0.0}, "plant.sigma: sigma is 0 at the initial state"),
    ({"plant.sigma": "y", "simulation.x0": [0, 0]}, "plant.sigma: sigma is 0 at the initial state"),
    (
        {"design.k": [6, -8]},
        "design.k: leaves A0 = A - k e1' unstable, eigenvalues -7.12311, 1.12311; allowed: k1 > 0 and k2 > 0",
    ),
    ({"design.c": [15, 0]}, "design.c, entry 2: is 0; allowed: a number greater than 0"),
    ({"design.e": [-0.1, 1]}, "design.e, entry 1: is -0.1; allowed: a number greater than 0"),
    ({"design.ck": [1, -1]}, "design.ck, entry 2: is -1; allowed: a number greater than 0"),
    ({"parameters.u_max.value": 0.0}, "parameters.u_max.value: is 0; allowed: a number greater than 0"),
    ({"parameters.u_max.value": -10}, "parameters.u_max.value: is -10; allowed: a number greater than 0"),
    (
        rho_1(["b0", "-1"]),
        "plant.b: the zero dynamics are unstable: b_m s^m + ... + b_0 has the roots 0.5; allowed",
    ),
    (rho_1(["b0", "0"]), "plant.b: the zero dynamics are unstable"),
    (
        {"plant.phi": ["0", "y/d1"], "parameters.d1.value": 0},
        "plant.phi, entry 2: 'y/d1' has no finite real value at",
    ),
    (
        {"plant.phi": ["0", "y**d1"], "parameters.d1.value": -1e9, "simulation.x0": [0.5, 0]},
        "plant.phi, entry 2: 'y**d1' has no",
    ),
    ({"simulation.reference": "1/t"}, "simulation.reference: '1/t' has no finite real value"),
]


@pytest.mark.parametrize(("changes", "line"), MISTAKES, ids=[line[:50] for _, line in MISTAKES])
def test_a_mistake_is_one_clear_line(changes: dict[str, Any], line: str, edited: Edit) -> None:
    with pytest.raises(ModelError) as caught:
        model_of(edited(changes), "m.toml")
    assert str(caught.value).startswith(f"m.toml: {line}")
