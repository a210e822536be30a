"""``[adaptation]`` as the record that the derivation takes, with its defaults, and as a hash."""

from __future__ import annotations

import math

import pytest

from pmjoint_codegen.identity import model_hash, structure, structure_hash
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import real_symbol
from pmjoint_derive.adaptation import Adaptation, Entry, Inverse, LeastSquares
from tests.modelfile.adaptations import BOTH, INVERTED, RANGES, SQUARES, Table, adapted, of_file
from tests.modelfile.conftest import PAPER, Edit, Made


def test_the_example_is_this_record(made: Made) -> None:
    model = made(BOTH)
    b0 = Entry(
        name="b0",
        place=0,
        guess=1.2,
        unknown=True,
        range=(0.3, 6.0),
        gain=1.0,
        prior=1.2,
        unit="rad/(s^2 V)",
        about="input gain (8)",
    )
    d1 = Entry("d1", 1, -0.5, True, (-3.0, 3.0), 1.0, -0.5, "1/s^2", "stiffness term (8)")
    assert model.adaptation == Adaptation((b0, d1), leakage=0.0)
    assert model.design == "adaptive"


def test_without_the_table_all_is_known(paper: Table) -> None:
    model = model_of(paper, "paper.toml")
    assert model.adaptation is None and model.design == "backstepping"


# Defaults


def test_what_follows_where_the_file_gives_no_more_than_ranges(made: Made) -> None:
    """Guesses are the values of the parameters; gains are 0.3 times the square of half the range."""
    found = adapted(made({"unknown": ["d1", "b0"], "range": RANGES}))
    assert [entry.name for entry in found.entries] == ["b0", "d1"]  # in the order of Theta
    assert [entry.guess for entry in found.entries] == [2.0, 0.2]
    assert [entry.prior for entry in found.entries] == [2.0, 0.2]
    assert [entry.gain for entry in found.entries] == pytest.approx([0.3 * 2.85**2, 0.3 * 3.0**2])
    assert found.leakage == 0.01
    assert found.inverse is None and found.least_squares is None and not found.force


def test_priors_are_the_guesses_unless_given(made: Made) -> None:
    found = adapted(made({**BOTH, "prior": {"d1": 1.5}}))
    assert [entry.prior for entry in found.entries] == [1.2, 1.5]


def test_a_load_is_estimated_from_0_with_a_greater_gain(made: Made) -> None:
    table = {"load": True, "range": {"w": [-5.0, 5.0]}}
    model = made(table, parameters__w={"value": 1.0})
    (w,) = adapted(model).entries
    assert (w.unknown, w.guess, w.prior, w.gain) == (True, 0.0, 0.0, 4.0 * 25.0)


def test_the_inverse_follows_from_the_guess_and_the_range_of_b_m(made: Made) -> None:
    table = {"unknown": ["b0"], "form": "inverse", "guess": {"b0": 1.25}, "range": {"b0": [0.5, 4.0]}}
    found = adapted(made({**table, "leakage": 0.02}))
    assert found.inverse == Inverse(0.8, 0.3 * 0.875**2, 0.02, 0.8)


def test_the_inverse_as_it_is_given(made: Made) -> None:
    inverse = {"guess": 0.83, "gain": 1.5, "leakage": 0.0, "prior": 0.9}
    found = adapted(made({**INVERTED, "inverse": inverse}))
    assert found.inverse == Inverse(0.83, 1.5, 0.0, 0.9)
    assert found.entries[0].range is None and found.entries[0].gain == 2.0
    assert adapted(made({**INVERTED, "inverse": {"guess": 0.5, "gain": 1.0}})).inverse == Inverse(
        0.5, 1.0, 0.01, 0.5
    )


def test_least_squares(made: Made) -> None:
    assert adapted(made(SQUARES)).least_squares == LeastSquares(100.0, 0.5, 5.0, 100.0)
    given = {"kappa": 30.0, "forgetting": 0.0, "P0": 2.0, "k_max": 40.0}
    found = adapted(made({**SQUARES, "least_squares": given}))
    assert found.least_squares == LeastSquares(**given)
    assert {entry.gain for entry in found.entries} == {0.0}  # its gain is a state


def test_a_guess_alone_is_a_mismatch_run(made: Made) -> None:
    """Nothing is estimated: the design stays as it was, with its own value of b0, under clipping too."""
    model = made({"guess": {"b0": 1.2}}, design__compensator=False)
    assert model.design == "backstepping"
    assert adapted(model).entries == (
        Entry("b0", 0, 1.2, prior=1.2, unit="rad/(s^2 V)", about="input gain (8)"),
    )
    assert adapted(model).leakage == 0.0


def test_a_load_that_the_controller_knows(made: Made) -> None:
    """``unknown = []`` keeps the column; with a guess, the controller takes a load that is not there."""
    known = made({"load": True, "unknown": []}, parameters__w={"value": 1.0})
    assert known.adaptation is None and known.plant.theta[-1] == real_symbol("w")
    wrong = made({"load": True, "unknown": [], "guess": {"w": 0.5}})
    assert [entry.guess for entry in adapted(wrong).entries] == [0.5] and wrong.design == "backstepping"


def test_force_allows_clipping(made: Made) -> None:
    model = made({**BOTH, "force": True}, design__compensator=False)
    assert adapted(model).force and not model.gains.compensator


# Names


@pytest.mark.parametrize("name", ["b0", "gain"])
def test_an_entry_of_b_by_its_place_or_by_its_parameter(made: Made, name: str) -> None:
    model = made(
        {"unknown": [name], "range": {name: [1.0, 3.0]}},
        parameters__b0=None,
        parameters__gain={"value": 2.5},
        plant__b=["gain"],
    )
    (entry,) = adapted(model).entries
    assert (entry.name, entry.place, entry.guess) == (name, 0, 2.5)


def test_expressions_are_entries_too(made: Made) -> None:
    """Theta = (b1, b0, theta): expressions of theta are named by their place, b by its power of s."""
    table = {
        "unknown": ["b1", "b0", "theta1", "d1"],
        "range": {"b1": [1.0, 9.0], "b0": [1.0, 90.0], "theta1": [-1.0, 1.0], "d1": [-1.0, 1.0]},
    }
    found = adapted(
        made(
            table,
            plant__b=["2*b0", "6"],
            plant__theta=["d1**2", "d1"],
            plant__Phi=[["0", "0"], ["y**3", "y"]],
            design__c=[15],
            design__e=[0.1],
            design__ck=[1],
        )
    )
    assert [entry.name for entry in found.entries] == ["b1", "b0", "theta1", "d1"]
    assert [entry.place for entry in found.entries] == [0, 1, 2, 3]
    assert [entry.guess for entry in found.entries] == pytest.approx([4.0, 6.0, 0.04, 0.2])
    assert [entry.unit for entry in found.entries] == ["rad/(s V)", "rad/(s^2 V)", "", "1/s^2"]


def test_a_parameter_that_is_two_entries_names_neither(made: Made) -> None:
    keys: Table = {"plant__theta": ["d1", "d1"], "plant__Phi": [["0", "0"], ["y", "y**3"]]}
    found = adapted(made({"unknown": ["theta2"], "range": {"theta2": [-1, 1]}}, **keys))
    assert [(entry.name, entry.place) for entry in found.entries] == [("theta2", 2)]


# The load


def test_a_load_is_a_column_of_phi_and_a_parameter(made: Made) -> None:
    model = made({"load": True, "unknown": ["w", "d1"], "range": {"w": [-5, 5], "d1": [-3, 3]}})
    assert [[str(entry) for entry in row] for row in model.plant.Phi] == [["0", "0"], ["y", "1"]]
    assert model.plant.theta == (real_symbol("d1"), real_symbol("w"))
    w = model.parameters[-1]
    assert (w.name, w.value, w.unit, w.about) == ("w", 0.0, "rad/s^2", "constant load")
    assert [(entry.name, entry.place, entry.unit) for entry in adapted(model).entries] == [
        ("d1", 1, "1/s^2"),
        ("w", 2, "rad/s^2"),
    ]


def test_a_load_of_the_authors_own(made: Made) -> None:
    """A parameter w of the file is that of the load; theta may have one without ``load`` too."""
    model = made({"load": True, "gain": {"w": 10.0}}, parameters__w={"value": 1.5, "about": "payload"})
    w = next(item for item in model.parameters if item.name == "w")
    assert (w.value, w.unit, w.about) == (1.5, "rad/s^2", "payload")
    keys: Table = {"parameters__w": {"value": 1.5}, "plant__theta": ["w"], "plant__Phi": [["0"], ["1"]]}
    model = made({"unknown": ["w"], "range": {"w": [-5, 5]}}, **keys)
    (entry,) = adapted(model).entries
    assert (entry.guess, entry.gain, entry.unit) == (0.0, 100.0, "rad/s^2")


def test_a_parameter_w_that_is_no_load_is_as_any_other(made: Made) -> None:
    keys: Table = {"parameters__w": {"value": 1.5}, "plant__theta": ["w"], "plant__Phi": [["0"], ["y"]]}
    (entry,) = adapted(made({"unknown": ["w"], "range": {"w": [-5, 5]}}, **keys)).entries
    assert (entry.guess, entry.gain) == (1.5, 0.3 * 25.0)


@pytest.mark.parametrize(
    ("line", "value", "shown"),
    [
        (None, 0.0, 0.0),
        ({"value": 5.0}, 5.0, 5.0),  # without a unit: in that of the load, deg/s^2
        ({"value": 5.0, "unit": "deg/s^2"}, 5.0, 5.0),
        ({"value": 5.0, "unit": "rad/s^2"}, 286.4788975654116, 5.0),  # 5 * 180/pi
    ],
)
def test_a_joints_load_is_in_the_unit_of_its_columns(line: Table | None, value: float, shown: float) -> None:
    parameters = read_document(PAPER.parent / "joint.toml")["parameters"]
    if line is not None:
        parameters = {**parameters, "w": line}
    model = of_file(
        "joint",
        {
            "load": True,
            "unknown": ["b0", "d1", "w"],
            "range": {"b0": [100, 9000], "d1": [-900, 0], "w": [-9, 9]},
        },
        parameters=parameters,
        units={"y": "deg", "u": "V"},
    )
    w = next(item for item in model.parameters if item.name == "w")
    assert w.value == pytest.approx(value, rel=1e-15)
    assert w.value / float(w.scale) == pytest.approx(shown, rel=1e-15)
    assert [row[-1] for row in model.plant.Phi] == [0, 1]
    b0, d1, load = adapted(model).entries
    degrees = 180 / 3.141592653589793
    assert b0.guess == pytest.approx(32.06805 * degrees) and b0.unit == "deg/(s^2 V)"
    assert d1.guess == pytest.approx(-58.3365) and d1.unit == "1/s^2"
    assert load.unit == "deg/s^2"


def test_a_systems_load() -> None:
    model = of_file("gallery/maglev", {"load": True, "range": {"w": [-2.0, 2.0]}})
    assert [row[-1] for row in model.plant.Phi] == [0, 1]
    assert model.plant.theta[-1] == real_symbol("w")
    (w,) = adapted(model).entries
    assert (w.name, w.guess, w.unit) == ("w", 0.0, "m/s^2")


def test_a_system_whose_b_m_is_negative() -> None:
    table = {"unknown": ["b0"], "form": "inverse", "range": {"b0": [-400.0, -1.0]}, "guess": {"b0": -20.0}}
    found = adapted(of_file("gallery/maglev", table))
    assert found.sign == -1
    assert found.inverse is not None and found.inverse.guess == -0.05


# What shapes kernels, and what is a number of a run


@pytest.mark.parametrize(
    "changes",
    [
        {"guess": {"b0": 3.0, "d1": 0.5}},  # of d1, a sign is a number too
        {"range": {"b0": [0.4, 5.0], "d1": [-2.0, 3.0]}},
        {"gain": {"b0": 2.0}},
        {"leakage": 0.5},
        {"prior": {"b0": 2.0}},
        {"inverse": {"gain": 5.0}},
        {"least_squares": {"kappa": 5.0}},
    ],
)
def test_numbers_leave_the_structure_as_it_is(edited: Edit, changes: Table) -> None:
    before, after = (edited({"adaptation": table}) for table in (BOTH, {**BOTH, **changes}))
    assert structure_hash(before) == structure_hash(after)
    assert model_hash(before) != model_hash(after)


@pytest.mark.parametrize(
    "changes",
    [
        {"unknown": ["b0"]},
        {"load": True},
        {"form": "inverse"},
        {"estimator": "least_squares"},
        {"force": True},
        {"range": {"b0": [0.3, 6.0]}},
        {"guess": {"b0": -1.2, "d1": -0.5}},
    ],
)
def test_what_is_estimated_and_how_is_structure(edited: Edit, changes: Table) -> None:
    before, after = (edited({"adaptation": table}) for table in (BOTH, {**BOTH, **changes}))
    assert structure_hash(before) != structure_hash(after)


def test_a_guess_of_what_is_not_estimated_is_structure(edited: Edit) -> None:
    """It puts a symbol of its own into the law."""
    before, after = (edited({"adaptation": {"guess": guess}}) for guess in ({"b0": 1.0}, {"d1": 1.0}))
    assert structure_hash(before) != structure_hash(after)


def test_a_range_states_the_sign_of_b_m_too(edited: Edit) -> None:
    ends = ([0.3, 6.0], [-6.0, -0.3], [-5.0, -0.2])
    tables = ({"unknown": ["b0"], "range": {"b0": pair}} for pair in ends)
    positive, negative, other = (structure_hash(edited({"adaptation": table})) for table in tables)
    assert positive != negative and negative == other


def test_a_model_without_the_table_has_the_structure_that_it_had(paper: Table) -> None:
    assert "adaptation" not in structure(paper)


def test_a_guess_of_what_is_estimated_is_a_number(edited: Edit) -> None:
    """It has one, given or not."""
    table = {"unknown": ["d1"], "range": {"d1": [-3.0, 3.0]}}
    before, after = (edited({"adaptation": {**table, **more}}) for more in ({}, {"guess": {"d1": 1.0}}))
    assert structure_hash(before) == structure_hash(after)


@pytest.mark.parametrize(("unit", "half"), [("rad", 2.0), ("deg", 2.0 * 180.0 / math.pi)])
def test_a_gain_that_follows_does_not_depend_on_the_unit_of_y(unit: str, half: float) -> None:
    """A load in deg/s^2 has its range in other numbers, and y too: the gain in 1/s^4 is the same."""
    document = {
        "schema": 1,
        "name": "arm",
        "parameters": {"J": {"value": 0.05}, "K": {"value": 4.0}, "u_max": {"value": 2.5}},
        "system": {
            "states": ["theta", "omega"],
            "rates": ["omega", "K*p/J"],
            "input": "p",
            "output": "theta",
            "units": [unit, f"{unit}/s"],
        },
        "actuator": {"limit": "u_max"},
        "units": {"y": unit, "u": "bar"},
        "adaptation": {"load": True, "range": {"w": [-half, half]}},
        "design": {"bandwidth": 15, "start": "matched"},
        "simulation": {"reference": "0", "x0": [0.1, 0.0], "horizon": 1.0, "output_step": 0.01},
    }
    adaptation = model_of(document, "arm.toml").adaptation
    assert adaptation is not None
    assert adaptation.unknown[0].gain == pytest.approx(16.0, rel=1e-12)
