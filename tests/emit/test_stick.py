"""Kernels of a plant that a kink holds: where they exist, and what they give."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from pmjoint_codegen.emit import compact
from pmjoint_codegen.emit.functions import build_functions
from pmjoint_codegen.emit.loop_table import HELD_LOOPS, LOOPS, lane_rows, loop_rows
from pmjoint_codegen.emit.pipeline import generate
from pmjoint_codegen.emit.table import kernel_table
from pmjoint_codegen.modelfile import model_of
from pmjoint_derive import Derivation, derive

HELD = ("plant_held", "closed_loop_held", "holds", "signals_held")
REST = "-(0.5 + 0.3*(1 - sign(x2)**2) + 0.1*exp(-abs(x2)/0.01))*sign(x2) - 0.2*x2*abs(x2) + 0.1*abs(x1)"

Changed = Callable[[str], Derivation]


def with_force(document: dict[str, Any], force: str) -> dict[str, Any]:
    return {**document, "plant": {**document["plant"], "disturbance": ["0", force]}}


@pytest.fixture
def changed(document: dict[str, Any]) -> Changed:
    return lambda force: derive(model_of(with_force(document, force), "changed"))


@pytest.mark.parametrize(
    ("force", "holds"),
    [
        ("-0.3*sign(x2)", True),
        ("-0.3*sign(x2 - 0.1*sin(t) + x1)", True),
        (REST, True),
        ("-0.3*abs(x2)", False),  # no jump
        ("-0.3*sign(x2)*x2", False),  # none either
        ("0.3*min(x2 - 0.5*x1, 0)", False),
        ("0.3*sign(x1)", False),  # the side is not in x1'
        ("0.3*sign(t - 1)", False),
        ("-0.3*sign(x2)*exp(sign(x2))", False),  # not affine
        ("-0.3*sign(x2 + 0.1*sign(x1))", False),  # a kink inside
        ("-0.3*sign(x2) + 0.1*sign(x1 + sign(x2))", False),  # inside another
    ],
)
def test_kernels_exist_where_a_kink_can_hold(changed: Changed, force: str, holds: bool) -> None:
    names = [row.name for row in kernel_table(changed(force))]
    assert [name for name in names if name in HELD] == (list(HELD) if holds else [])
    assert loop_rows(names) == ((*LOOPS, *HELD_LOOPS) if holds else LOOPS)
    assert len(lane_rows(names)) == len(lane_rows([])) + (7 if holds else 0)


def points(function: ca.Function, count: int = 20) -> list[list[np.ndarray]]:
    random = np.random.default_rng(7)
    return [
        [random.uniform(0.2, 2.0, function.size1_in(i)) for i in range(function.n_in())] for _ in range(count)
    ]


@pytest.mark.parametrize("name", ["plant", "closed_loop"])
def test_without_a_flag_the_plant_is_the_same_and_with_one_it_rests(changed: Changed, name: str) -> None:
    functions = build_functions(changed(REST), 2)
    free, held = functions[name], functions[f"{name}_held"]
    kinks = functions["holds"].size1_out("value")
    (rest,) = np.flatnonzero(np.array(functions["holds"](*points(functions["holds"])[0])[0])[:, 0] != 2.0)
    for given in points(free):
        given[2][-kinks:] = np.sign(given[2][-kinks:] - 1.0)
        flags = np.zeros(kinks)
        same = [np.array(entry) for entry in held(given[0], given[1], np.append(given[2], flags), given[3])]
        for one, other in zip(free(*given), same, strict=True):
            np.testing.assert_allclose(np.array(one), other, rtol=1e-14, atol=1e-14)
        flags[rest] = 1.0
        given[1][1] = 0.0
        rates, *_, channels = held(given[0], given[1], np.append(given[2], flags), given[3])
        assert float(rates[1]) == 0.0
        if name == "plant":
            value, pull, place = functions["holds"](*given)
            assert float(pull[rest]) == pytest.approx(-0.9, rel=1e-15)  # abs(x2) and sign(x2)**2 are 0
            assert float(channels[rest]) == pytest.approx(float(value[rest]), rel=1e-14)
            given[2][len(given[2]) - kinks + rest] = 1.0
            others = float(free(*given)[0][1])
            # At side 1 and speed 0, friction in motion takes 0.6 from the other forces.
            assert float(value[rest]) == pytest.approx((others + 0.6) / 0.9, rel=1e-12)
            assert np.array_equal(np.array(place)[2 * rest : 2 * rest + 2, 0], [given[1][0], 0.0])


def test_friction_is_reported_at_rest(changed: Changed) -> None:
    derivation = changed("-0.5*sign(x2)")
    functions = build_functions(derivation, 2)
    (row,) = [row for row in kernel_table(derivation) if row.name == "signals"]
    names = [symbol.name for symbol in row.outputs[0][1]]
    parameters = [symbol.name for symbol in dict(row.inputs)["p"]]
    for t, X, p in points(functions["signals"]):
        X[1] = 0.0
        held = np.array(functions["signals_held"](t, X, [1.0], p))[:, 0]
        free = np.array(functions["signals_held"](t, X, [0.0], p))[:, 0]
        assert np.array_equal(free, np.array(functions["signals"](t, X, p))[:, 0])
        u = held[names.index("u")]
        value = dict(zip(parameters, p.tolist(), strict=True))
        others = value["b0_plant"] * u + value["d1_plant"] * X[0]
        mismatch = (value["b0_plant"] - value["b0"]) * u + (value["d1_plant"] - value["d1"]) * X[0]
        expected = -np.clip(others, -0.5, 0.5) + mismatch
        assert held[names.index("D2")] == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_long_kernels_of_a_plant_at_rest_are_compact_too(
    document: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compact, "MOST_STRAIGHT", 0)
    changed = with_force(document, "-0.5*sign(x2)")
    text = generate(changed, model_of(changed, "changed"), lanes=False).files["loops.c"]
    assert "static void taylor_sums(" in text and "static void taylor_held_sums(" in text
