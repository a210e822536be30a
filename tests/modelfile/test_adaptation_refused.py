"""What ``[adaptation]`` refuses, each with its place and its remedy in one line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.names import why_not
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import derive
from tests.modelfile.adaptations import BOTH, INVERTED, SQUARES, Table, of_file
from tests.modelfile.conftest import PAPER, Made

ONE_EQUATION: Table = {"design__c": [15], "design__e": [0.1], "design__ck": [1]}


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {},
            'adaptation: neither unknown nor guess nor load is given; give unknown = ["b0"], '
            "guess = { b0 = 1.0 } or load = true, or leave the table out",
        ),
        (
            {"unknown": []},
            'adaptation: neither unknown nor guess nor load is given; give unknown = ["b0"], '
            "guess = { b0 = 1.0 } or load = true, or leave the table out",
        ),
        (
            {"unknown": ["b_0"]},
            "adaptation.unknown, entry 1: 'b_0' is no entry of b or theta; did you mean 'b0'? "
            "allowed: b0, d1",
        ),
        (
            {"guess": {"u_max": 2.0}},
            "adaptation.guess.u_max: 'u_max' is no entry of b or theta; allowed: b0, d1",
        ),
        (
            {"unknown": ["w"], "range": {"w": [-1, 1]}},
            "adaptation.unknown, entry 1: 'w' is no entry of theta; give load = true, which adds it",
        ),
        (
            {"unknown": ["d1", "d1"], "range": {"d1": [-1, 1]}},
            "adaptation.unknown, entry 2: 'd1' is there twice; give it once",
        ),
        (
            {"unknown": ["b0"]},
            "adaptation.range.b0: is missing, so b0_hat may pass 0, and the law divides by it; "
            'give a range without 0, or form = "inverse"',
        ),
        (
            {"unknown": ["b0"], "range": {"b0": [-1.0, 6.0]}},
            "adaptation.range.b0: [-1.0, 6.0] contains 0, and the sign of b_m must be known; "
            "allowed: two numbers greater than 0, or two less than 0",
        ),
        (
            {"unknown": ["b0"], "range": {"b0": [0, 6.0]}},
            "adaptation.range.b0: [0.0, 6.0] contains 0, and the sign of b_m must be known; "
            "allowed: two numbers greater than 0, or two less than 0",
        ),
        (
            {"unknown": ["b0"], "range": {"b0": [1.0, 6.0]}, "guess": {"b0": 6.0}},
            "adaptation.guess.b0: is 6, not within the range [1.0, 6.0]; "
            "allowed: a number greater than 1 and less than 6",
        ),
        (
            {"unknown": ["d1"], "range": {"d1": [1.0, 6.0]}},
            "adaptation.guess.d1: is by default 0.2, the value of d1, not within the range [1.0, 6.0]; "
            "allowed: a number greater than 1 and less than 6",
        ),
        (
            {"unknown": ["d1"], "range": {"d1": [-1.0, 6.0]}, "prior": {"d1": -1.0}},
            "adaptation.prior.d1: is -1, not within the range [-1.0, 6.0]; "
            "allowed: a number greater than -1 and less than 6",
        ),
        (
            {"guess": {"b0": 0.0}},
            "adaptation.guess.b0: is 0, and with b_m = 0 no input acts; allowed: another number",
        ),
        (
            {"unknown": ["b0"], "range": {"b0": [0.3, 6.0]}, "guess": {"b0": -1.2}},
            "adaptation.guess.b0: is -1.2, but the range [0.3, 6.0] is positive; "
            "give guess and range of one sign",
        ),
        (
            {"unknown": ["b0"], "range": {"b0": [-6.0, -0.3]}},
            "adaptation.guess.b0: is by default 2, the value of b0, but the range [-6.0, -0.3] is negative; "
            "give guess and range of one sign",
        ),
        (
            {"unknown": ["d1"], "range": {"d1": [3.0, -3.0]}},
            "adaptation.range.d1: is [3.0, -3.0]; allowed: [least, greatest], two different numbers",
        ),
        (
            {"unknown": ["d1"], "range": {"d1": [3.0]}},
            "adaptation.range.d1: is [3.0]; allowed: [least, greatest], two different numbers",
        ),
        (
            {"unknown": ["d1"]},
            "adaptation.gain.d1: is missing, and so is a range, from which it would follow; "
            "give gain or range",
        ),
        *(
            (
                {"unknown": ["d1"], "range": {"d1": [-1, 1], **more}, **other},
                f"adaptation.{key}.b0: has no effect, since b0 is not unknown; "
                'add "b0" to unknown, or leave this out',
            )
            for key, more, other in (
                ("range", {"b0": [1, 3]}, {}),
                ("gain", {}, {"gain": {"b0": 1.0}}),
                ("prior", {}, {"prior": {"b0": 1.0}}),
            )
        ),
        (
            {"unknown": ["d1"], "range": {"d1": [-1, 1]}, "form": "inverse"},
            'adaptation.form: is "inverse", but b_m is known; give form = "divide"',
        ),
        (
            {**BOTH, "inverse": {"gain": 1.0}},
            'adaptation.inverse: has no effect with form = "divide"; give form = "inverse"',
        ),
        (
            {"unknown": ["b0"], "form": "inverse", "gain": {"b0": 1.0}},
            "adaptation.guess.b0: is missing, and so is a range of b0: one of them states the sign of b_m; "
            "give a guess",
        ),
        (
            INVERTED,
            "adaptation.inverse.gain: is missing, and so is a range of b0, from which it would follow; "
            "give a gain",
        ),
        (
            {**INVERTED, "inverse": {"guess": -0.8, "gain": 1.0}},
            "adaptation.inverse.guess: is -0.8, and the guess of b_m is 1.2; give both of one sign",
        ),
        (
            {**SQUARES, "form": "inverse"},
            'adaptation.estimator: least squares estimates b_m, and form = "inverse" needs tuning functions; '
            'give form = "divide", or estimator = "tuning"',
        ),
        (
            {**BOTH, "least_squares": {}},
            'adaptation.least_squares: has no effect with estimator = "tuning"; '
            'give estimator = "least_squares"',
        ),
        (
            {**SQUARES, "least_squares": {"P0": 5.0, "k_max": 9.0}},
            "adaptation.least_squares.k_max: is 9, less than the initial trace 10 of the gain matrix; "
            "allowed: a number of 10 or greater",
        ),
        *(
            (
                {**SQUARES, key: value},
                f"adaptation.{key}: has no effect with least squares, whose gain is a state; "
                'leave it out, or give estimator = "tuning"',
            )
            for key, value in (("gain", {"b0": 1.0}), ("leakage", 0.0), ("prior", {"b0": 2.0}))
        ),
    ],
)
def test_refusal(made: Made, table: Table, message: str) -> None:
    with pytest.raises(ModelError) as caught:
        made(table)
    assert str(caught.value) == f"paper.toml: {message}"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"unknwon": ["b0"]},
            "adaptation.unknwon: unknown key; did you mean 'unknown'? allowed: unknown, load,",
        ),
        (
            {"gain": {"b0": -1.0}},
            "adaptation.gain.b0: is -1.0; allowed: a table of finite numbers, 0 or greater",
        ),
        (
            {"leakage": -1},
            "adaptation.leakage: is -1; allowed: a finite number, 0 or greater; by default 0.01",
        ),
        ({"form": "R"}, 'adaptation.form: is the text \'R\'; allowed: "divide" or "inverse"'),
        ({"estimator": "rls"}, "adaptation.estimator: is the text 'rls'; allowed: \"tuning\" or"),
        ({"load": 1}, "adaptation.load: is 1; allowed: true or false;"),
        (
            {"inverse": {"gain": -1.0}},
            "adaptation.inverse.gain: is -1.0; allowed: a finite number, 0 or greater",
        ),
        (
            {"least_squares": {"P0": 0.0}},
            "adaptation.least_squares.P0: is 0.0; allowed: a finite number greater",
        ),
        ({"guess": {"b0": "2"}}, "adaptation.guess.b0: is the text '2'; allowed: a table of finite numbers"),
    ],
)
def test_a_key_or_a_type_that_is_none(made: Made, table: Table, message: str) -> None:
    with pytest.raises(ModelError) as caught:
        made(table)
    assert str(caught.value).startswith(f"paper.toml: {message}")


@pytest.mark.parametrize(
    ("table", "changes", "message"),
    [
        (
            {"unknown": ["b0"], "guess": {"gain": 2.0}},
            {"parameters__gain": {"value": 2.0}, "plant__b": ["gain"]},
            "adaptation.guess.gain: gain and b0 are one entry; call it by one of these names",
        ),
        (
            {"unknown": ["b0"]},
            {"parameters__b1": {"value": 2.0}, "plant__b": ["b0", "b1"], **ONE_EQUATION},
            "adaptation.unknown, entry 1: 'b0' may be entry 1 of b or entry 2 of b; "
            "give the parameter another name",
        ),
        (
            {"unknown": ["theta2"]},
            {"plant__theta": ["d1*b0"]},
            "adaptation.unknown, entry 1: 'theta2' is no entry of b or theta; did you mean 'theta1'? "
            "allowed: b0, theta1 ('b0*d1')",
        ),
        (
            BOTH,
            {"design__compensator": False},
            "design.compensator: plain clipping misleads the estimates, which can destroy the loop; "
            'give saturation = "compensator", or force = true in [adaptation]',
        ),
        (
            BOTH,
            {"design__compensator": None, "design__saturation": "clip"},
            "design.saturation: plain clipping misleads the estimates, which can destroy the loop; "
            'give saturation = "compensator", or force = true in [adaptation]',
        ),
        (
            {**BOTH, "force": True},
            {"design__compensator": None, "design__saturation": "braking"},
            "design.saturation: braking is not proved for a design with estimates; "
            'give saturation = "compensator"',
        ),
        *(
            (
                table,
                {f"parameters__{name}": {"value": 1.0}},
                f"parameters.{name}: already names an estimate, a number or a step of the controller; "
                "choose another name",
            )
            for table, name in (
                (BOTH, "b0_guess"),
                (BOTH, "b0_low"),
                (BOTH, "d1_high"),
                (BOTH, "d1_prior"),
                (BOTH, "gamma_d1"),
                (BOTH, "leakage"),
                (BOTH, "b0_hat"),
                (BOTH, "chi1"),
                (BOTH, "chi2"),
                (BOTH, "V"),
                ({**INVERTED, "inverse": {"gain": 1.0}}, "rho_hat"),
                ({**INVERTED, "inverse": {"gain": 1.0}}, "gamma_rho"),
                (SQUARES, "ls_kappa"),
                (SQUARES, "Gamma12"),
                ({"guess": {"d1": 1.0}}, "d1_guess"),
            )
        ),
        (
            {"unknown": ["b0", "rho"], "form": "inverse", "range": {"b0": [1, 3], "rho": [0, 1]}},
            {"parameters__rho": {"value": 0.5}, "plant__theta": ["rho"]},
            "parameters.rho: rho_guess of the entry rho already names a number of the controller; "
            "choose another name",
        ),
        (
            {"load": True, "range": {"w": [-1, 1]}},
            {"parameters__w": {"value": 1.0}, "simulation__reference": "sin(w*t)"},
            "adaptation.load: takes the parameter w for the load, and simulation.reference uses w too; "
            "give the w of simulation.reference another name",
        ),
        (
            {"load": True, "range": {"w": [-1, 1]}},
            {"plant__disturbance": ["0", "w*sin(t)"]},
            "adaptation.load: takes the parameter w for the load, and plant uses w too; "
            "give the w of plant another name",
        ),
        (
            {"load": True, "range": {"w": [-1, 1]}},
            {"parameters__w": {"value": 1.0}, "actuator__limit": "w"},
            "adaptation.load: takes the parameter w for the load, and actuator uses w too; "
            "give the w of actuator another name",
        ),
        (
            {"load": True},
            {"parameters__w": {"value": 1.0}, "plant__theta": ["w"]},
            'adaptation.load: theta has w already; leave it out, and give unknown = ["w"]',
        ),
        (
            {"load": True},
            {"plant__theta": ["d1"] * 9, "plant__Phi": [["0"] * 9, ["y"] * 9]},
            "adaptation.load: theta has 9 entries already; allowed: 9 with the load",
        ),
    ],
)
def test_refusal_beside_another_table(made: Made, table: Table, changes: Table, message: str) -> None:
    with pytest.raises(ModelError) as caught:
        made(table, **changes)
    assert str(caught.value) == f"paper.toml: {message}"


def test_names_of_estimates_are_free_where_nothing_is_estimated(made: Made) -> None:
    made({"guess": {"d1": 1.0}}, parameters__V={"value": 1.0}, parameters__chi1={"value": 1.0})


def test_least_squares_stops_at_relative_degree_2(made: Made) -> None:
    keys: Table = {
        "plant__order": 3,
        "plant__phi": ["0", "0", "0"],
        "plant__Phi": [["0"], ["0"], ["y"]],
        "plant__disturbance": ["0", "0", "0"],
        "simulation__x0": [1.5, 0.0, 0.0],
        **{f"design__{key}": [1.0, 1.0, 1.0] for key in ("c", "e", "ck")},
        "design__k": [6.0, 12.0, 8.0],
    }
    assert made(BOTH, **keys).design == "adaptive"
    with pytest.raises(ModelError) as caught:
        made(SQUARES, **keys)
    assert str(caught.value) == (
        "paper.toml: adaptation.estimator: least squares is proved up to relative degree 2, and this model "
        "has 3; "
        'give estimator = "tuning"'
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"states": ["x", "w"], "rates": ["w", "u"], "output": "x"}, "a state is called w"),
        ({"states": ["x", "s"], "rates": ["s", "w"], "output": "x", "input": "w"}, "the input is called w"),
    ],
)
def test_a_system_that_calls_something_else_w(changes: Mapping[str, Any], message: str) -> None:
    document = {key: value for key, value in read_document(PAPER).items() if key != "plant"}
    document |= {"system": dict(changes), "adaptation": {"load": True, "range": {"w": [-1, 1]}}}
    with pytest.raises(ModelError) as caught:
        model_of(document, "s.toml")
    assert str(caught.value) == (
        f"s.toml: adaptation.load: adds the parameter w, and {message}; give that another name"
    )


def test_a_state_with_the_name_of_an_estimate() -> None:
    document = {key: value for key, value in read_document(PAPER).items() if key != "plant"}
    document |= {
        "system": {"states": ["x", "chi2"], "rates": ["chi2", "2*u"], "output": "x"},
        "adaptation": {"load": True, "range": {"w": [-1, 1]}},
    }
    with pytest.raises(ModelError) as caught:
        model_of(document, "s.toml")
    assert str(caught.value) == (
        "s.toml: system.states, entry 2: already names an estimate, a number or a step of the controller; "
        "choose another name"
    )


def test_a_load_of_another_dimension_is_refused() -> None:
    parameters = read_document(PAPER.parent / "joint.toml")["parameters"]
    with pytest.raises(ModelError) as caught:
        of_file("joint", {"load": True}, parameters={**parameters, "w": {"value": 1.0, "unit": "N m"}})
    assert str(caught.value).startswith("joint: parameters.w.unit: 'N m' does not convert to rad/s^2;")


@pytest.mark.parametrize(
    "table",
    [{**INVERTED, "inverse": {"gain": 1.0}}, SQUARES, {"load": True, "gain": {"w": 1.0}}],
    ids=["inverse", "least squares", "load"],
)
def test_every_name_of_the_derivation_is_refused(made: Made, table: Table) -> None:
    """Those that any model refuses aside, and the tracking error, which makes room."""
    derivation = derive(made(table))
    own = {item.name for item in derivation.model.parameters} | {"e"}
    for name in sorted(name for name in {*derivation.equations} - own if why_not(name) is None):
        with pytest.raises(ModelError, match=rf"parameters\.{name}: already names"):
            made(table, **{f"parameters__{name}": {"value": 1.0}})
