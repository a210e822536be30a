"""Functions over lanes, and their C text: the same values as the kernels that they are composed from."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest

from pmjoint_codegen.emit.functions import build_functions, lane_functions
from pmjoint_codegen.emit.lane_text import lanes_header, lanes_source
from pmjoint_codegen.emit.lanes import LANE_ORDER, lane_sizes
from pmjoint_codegen.emit.pipeline import Artifacts
from pmjoint_codegen.emit.print_c import steps
from pmjoint_codegen.emit.tape import tape_of, tapes_of
from pmjoint_codegen.emit.vocabulary import neutral_entry, vocabulary
from pmjoint_derive import Derivation

EPSILON = np.finfo(float).eps


@pytest.fixture(scope="module")
def kernels(paper: Derivation) -> dict[str, ca.Function]:
    return build_functions(paper, LANE_ORDER)


@pytest.fixture(scope="module")
def lanes(paper: Derivation, kernels: dict[str, ca.Function]) -> dict[str, ca.Function]:
    return lane_functions(kernels, neutral_entry(paper))


def point(function: ca.Function, seed: int) -> list[np.ndarray]:
    generator = np.random.default_rng(seed)
    return [generator.uniform(0.5, 2.0, function.size1_in(i)) for i in range(function.n_in())]


def close(found: np.ndarray, wanted: np.ndarray, operations: int) -> bool:
    """Equal up to one rounding an operation, relative to the largest entry."""
    return bool(np.max(np.abs(found - wanted)) <= operations * EPSILON * max(1.0, np.max(np.abs(wanted))))


def test_taylor_lanes_give_what_taylor_gives(
    kernels: dict[str, ca.Function], lanes: dict[str, ca.Function]
) -> None:
    arguments = point(lanes["taylor_lanes"], 1)
    states = kernels["closed_loop"].size1_in("X")
    c = np.array(lanes["taylor_lanes"](*arguments)).reshape(LANE_ORDER + 1, states + 2)
    known = np.array(kernels["taylor"](*arguments)).reshape(LANE_ORDER + 1, states + 2)
    assert close(c, known, kernels["taylor"].n_instructions())
    t, X, _, _ = arguments
    k = np.arange(LANE_ORDER + 1)
    sine = np.sin(t[0] + k * np.pi / 2) / np.cumprod(np.maximum(k, 1))  # coefficients of y_r = sin t
    assert close(c[:, -1], c[:, 0] - sine, 100)
    assert c[0, -1] == pytest.approx(X[0] - np.sin(t[0]), abs=4 * EPSILON)


def test_lanes_and_single_runs_take_the_same_sample(
    kernels: dict[str, ca.Function], lanes: dict[str, ca.Function]
) -> None:
    """What the kernel computes, its own test says; plant_lanes are the coefficients in it."""
    t, X, h, p = point(lanes["sample_lanes"], 0)
    one, other = lanes["sample_lanes"](t, X, h, p), kernels["sample"](t, X, h, p)
    assert all(np.array_equal(np.array(a), np.array(b)) for a, b in zip(one, other, strict=True))
    c = np.array(lanes["plant_lanes"](t, X[:2], one[1], p))
    assert close(c, np.array(one[2]), 300)


def test_a_step_arrives_where_its_polynomial_does(lanes: dict[str, ca.Function]) -> None:
    function = lanes["arrive_lanes"]
    c, h = point(function, 3)
    rows = c.reshape(LANE_ORDER + 1, -1)
    X, slope, ends, v, e, _ = (np.array(part).ravel() for part in function(c, h))
    powers = h[0] ** np.arange(LANE_ORDER + 1)
    k = np.arange(LANE_ORDER + 1)
    assert close(X, (powers @ rows)[: len(X)], 50)
    assert close(slope, ((k[1:] * powers[:-1]) @ rows[1:])[: len(slope)], 50)
    assert close(ends, (powers @ rows)[len(X) :], 50)
    assert close(v, powers * rows[:, -2], 50)
    assert close(e, powers * rows[:, -1], 50)


def test_the_mean_of_a_converging_error_is_exact_enough(lanes: dict[str, ca.Function]) -> None:
    k = np.arange(LANE_ORDER + 1)
    for ratio in (0.1, 0.3, 0.5):  # of neighbouring terms; 0.3 leaves 5e-7 at the last one
        c = np.zeros((LANE_ORDER + 1, 12))
        c[:, -1] = ratio**k * (-1.0) ** (k // 2)
        square = float(lanes["arrive_lanes"](c.ravel(), 1.0)[5])
        product = np.convolve(c[:, -1], c[:, -1])
        degrees = np.arange(len(product))
        nodes, weights = np.polynomial.legendre.leggauss(5)
        missed = np.abs(((nodes[:, None] + 1) / 2) ** degrees * (weights / 2)[:, None]).sum(0) - 1 / (
            degrees + 1
        )
        exact = float(np.sum(product / (degrees + 1)))
        assert abs(square - exact) <= 1e-14 + float(np.sum(np.abs(product * missed)))
        assert abs(square - exact) <= 1e-9 * exact or ratio > 0.3


def test_bernstein_coefficients_end_at_the_ends_and_enclose(lanes: dict[str, ca.Function]) -> None:
    generator = np.random.default_rng(4)
    for _ in range(20):
        a = generator.uniform(-1, 1, LANE_ORDER + 1)
        b = np.array(lanes["bernstein_lanes"](a)).ravel()
        s = np.linspace(0, 1, 301)
        values = np.polynomial.polynomial.polyval(s, a)
        slack = LANE_ORDER**2 * EPSILON * np.sum(np.abs(a))
        assert abs(b[0] - values[0]) <= slack
        assert abs(b[-1] - values[-1]) <= slack
        assert np.min(b) - slack <= np.min(values)
        assert np.max(values) <= np.max(b) + slack


def test_every_value_has_a_name_of_its_own(lanes: dict[str, ca.Function]) -> None:
    for function in lanes.values():
        names = [step.result for step in steps(tape_of(function))]
        assert len(names) == len(set(names))


def test_sine_and_cosine_of_one_angle_are_one_call_and_a_common_divisor_is_inverted_once() -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    entries = ca.vertcat(ca.sin(x[0]) + ca.cos(x[0]), x[0] / y, x[1] / y, ca.sin(x[1]), x[0] / (3 + x[1]))
    text = lanes_source([tape_of(ca.Function("f", [x, y], [entries], ["x", "y"], ["z"]))], "")
    assert len(re.findall(r"pmj_sincos\(x\[0\]", text)) == 1
    assert text.count("pmj_sin(") == 1
    assert text.count("1.0 / y[0]") == 1
    assert "/ y[0];" not in text.replace("1.0 / y[0];", "")


def test_an_input_that_is_not_read_is_said_to_be_unused_and_constants_fill_all_lanes() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [ca.vertcat(2 * x, 0.25)], ["x", "y"], ["z"])
    text = lanes_source([tape_of(function)], "")
    assert "(void)y;" in text
    assert "z[1] = pmj_all(0.25);" in text


def test_the_header_holds_sizes_and_every_declaration(
    paper: Derivation,
    kernels: dict[str, ca.Function],
    lanes: dict[str, ca.Function],
    artifacts: Artifacts,
) -> None:
    sizes = lane_sizes(vocabulary(paper), kernels)
    tapes = tapes_of(lanes.values())
    header = lanes_header(tapes, sizes, "")
    assert dict(re.findall(r"#define (PMJ_\w+) (.+)", header)) == {k: str(v) for k, v in sizes.items()}
    assert sizes["PMJ_PLANT_BENT_STATES_LIST"] == "{1}"  # of the plant, only sin(x2) is not linear in x
    assert all(f"void pmj_{name}(" in header for name in lanes)
    assert all(len(line) <= 120 for line in artifacts.files["lanes.h"].splitlines())
    assert artifacts.files["lanes.c"].endswith(lanes_source(tapes, "").removeprefix('#include "lanes.h"\n\n'))
