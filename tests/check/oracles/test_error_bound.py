"""The error bound is a bound, and a tight one: held against sixty digits for operations and random tapes."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmjoint_codegen.check.oracles.error_bound import walk
from pmjoint_codegen.check.oracles.rounding import ROUNDOFF
from pmjoint_codegen.kernels.tape import Instruction, Tape
from pmjoint_codegen.operations import OPERATIONS

EXACT: Mapping[str, Callable[..., Any]] = {
    "neg": lambda m, a: -a, "sq": lambda m, a: a * a, "twice": lambda m, a: 2 * a, "inv": lambda m, a: 1 / a,
    "sqrt": lambda m, a: m.sqrt(a), "exp": lambda m, a: m.exp(a), "log": lambda m, a: m.ln(a),
    "sin": lambda m, a: m.sin(a), "cos": lambda m, a: m.cos(a), "tan": lambda m, a: m.tan(a),
    "tanh": lambda m, a: m.tanh(a), "add": lambda m, a, b: a + b, "sub": lambda m, a, b: a - b,
    "mul": lambda m, a, b: a * b, "div": lambda m, a, b: a / b, "pow": lambda m, a, b: a**b,
    "atan": lambda m, a: m.atan(a), "sinh": lambda m, a: m.sinh(a), "cosh": lambda m, a: m.cosh(a),
    "fabs": lambda m, a: abs(a), "sign": lambda m, a: m.sign(a),
    "fmin": lambda m, a, b: min(a, b), "fmax": lambda m, a, b: max(a, b),
}  # fmt: skip
ARITIES = {item.name: item.arity for item in OPERATIONS}


def tape_of(steps: Sequence[tuple[str, tuple[int, ...]]], inputs: int) -> Tape:
    """A tape of some inputs and operations, whose last value is its result."""
    read = [Instruction("input", (0, i)) for i in range(inputs)]
    work = [Instruction(operation, operands) for operation, operands in steps]
    end = Instruction("output", (0, 0, inputs + len(steps) - 1))
    return Tape("f", (("x", inputs),), (("f", 1),), (*read, *work, end))


def exact_value(tape: Tape, point: Sequence[float]) -> mpmath.mpf | None:
    """The tape's result at sixty digits; None where it has no real value."""
    context = mpmath.MPContext()
    context.dps = 60
    values: list[mpmath.mpf] = []
    for item in tape.instructions:
        if item.operation == "input":
            values.append(context.mpf(point[item.operands[1]]))
        elif item.operation != "output":
            if item.operation in ("sin", "cos", "tan") and abs(values[item.operands[0]]) > sys.float_info.max:
                return None  # no double has such an angle, and pi to as many digits takes hours
            try:
                values.append(EXACT[item.operation](context, *(values[i] for i in item.operands)))
            except (ZeroDivisionError, ValueError, OverflowError):
                return None
            if not (context.isfinite(values[-1]) and isinstance(values[-1], context.mpf)):
                return None
    return values[-1]


def test_every_operation_of_a_tape_has_a_rule_and_a_reference() -> None:
    assert set(EXACT) == set(ARITIES)


def test_a_literal_beyond_the_whole_numbers_of_a_double_is_a_rounded_one() -> None:
    """1e20/3 is whole as a double, and 1/3 away from its exact value's last place."""
    exact = mpmath.mpf(10) ** 20 / 3
    literal = Instruction("const", (), float(exact))
    tape = Tape("f", (("x", 1),), (("f", 1),), (literal, Instruction("output", (0, 0, 0))))
    (found,) = walk(tape, [np.zeros((1, 1))])
    assert found.value[0, 0].is_integer()
    with mpmath.workdps(60):
        assert 0 < abs(mpmath.mpf(found.value[0, 0]) - mpmath.mpf(10) ** 20 / 3) <= found.error[0, 0]


@pytest.mark.parametrize("operation", sorted(ARITIES))
def test_one_operation_on_rounded_operands_stays_within_its_bound(operation: str) -> None:
    random = np.random.default_rng(1)
    arity = ARITIES[operation]
    products = [("mul", (2 * i, 2 * i + 1)) for i in range(arity)]  # so that the operands carry errors
    places = tuple(2 * arity + i for i in range(arity))
    tape = tape_of([*products, (operation, places)], 2 * arity)
    low = 0.5 if operation in ("log", "sqrt", "pow") else -4.0
    points = random.uniform(low, 4.0, (400, 2 * arity))
    if operation == "pow":
        points[:, 2:] = [1.0, 2.5]  # an exponent is a literal
    (found,) = walk(tape, [points])
    ratios = []
    for row, point in enumerate(points):
        exact = exact_value(tape, point)
        if exact is None:
            continue
        error, bound = abs(mpmath.mpf(found.value[row, 0]) - exact), found.error[row, 0]
        assert error <= bound, (operation, point)
        ratios.append(float(error / bound) if bound else 0.0)
    # sign is exact away from its jump, where its bound is 0 as well
    assert operation == "sign" or max(ratios) > 0.02, "the bound is too wide to see anything"


@pytest.mark.parametrize(("operation", "size"), [("fmin", 1e139), ("fmax", -1e139)])
def test_a_value_far_beyond_its_limit_passes_on_no_error(operation: str, size: float) -> None:
    """A command of 1e278 V, known to some digits only, is clipped to exactly its limit."""
    tape = tape_of([("mul", (0, 1)), (operation, (2, 3))], 3)
    (product,) = walk(tape_of([("mul", (0, 1))], 2), [np.array([[size, 1e139]])])
    (clipped,) = walk(tape, [np.array([[size, 1e139, 3.0]])])
    assert product.error[0, 0] > 1e250
    assert (clipped.value[0, 0], clipped.error[0, 0]) == (3.0, 0.0)


def test_the_sign_of_an_exact_zero_is_exact_and_that_of_a_rounded_one_is_not() -> None:
    """A gain of 0 is switched off by its sign, in a quotient that would have no bound otherwise."""
    (exact,) = walk(tape_of([("sign", (0,))], 1), [np.array([[0.0]])])
    assert (exact.value[0, 0], exact.error[0, 0]) == (0.0, 0.0)
    (rounded,) = walk(tape_of([("mul", (0, 0)), ("sign", (1,))], 1), [np.array([[1e-200]])])
    assert (rounded.value[0, 0], rounded.error[0, 0]) == (0.0, 2.0 * (1 + 32 * ROUNDOFF))


STEPS = st.lists(
    st.tuples(st.sampled_from(sorted(ARITIES)), st.integers(0, 30), st.integers(0, 30)),
    min_size=1,
    max_size=12,
)
NUMBERS = st.floats(-1e3, 1e3) | st.sampled_from([0.0, -0.0, 1.0, 5e-324, 1e-310, 1e-160, 1e150])


@given(STEPS, st.lists(NUMBERS, min_size=3, max_size=3))
def test_random_tapes_stay_within_their_bounds(raw: list[tuple[str, int, int]], point: list[float]) -> None:
    steps = []
    for k, (operation, a, b) in enumerate(raw):
        operation = "mul" if operation == "pow" else operation  # whose exponent is a literal
        steps.append((operation, tuple(place % (3 + k) for place in (a, b)[: ARITIES[operation]])))
    tape = tape_of(steps, 3)
    (found,) = walk(tape, [np.array([point])])
    exact, bound = exact_value(tape, point), float(found.error[0, 0])
    if exact is None or not math.isfinite(bound):
        return
    assert abs(mpmath.mpf(float(found.value[0, 0])) - exact) <= bound


def test_literals_are_exact_when_whole_and_rounded_otherwise() -> None:
    for value, error in ((3.0, 0.0), (0.1, 2 * ROUNDOFF * 0.1)):
        tape = Tape(
            "f", (("x", 1),), (("f", 1),), (Instruction("const", (), value), Instruction("output", (0, 0, 0)))
        )
        (found,) = walk(tape, [np.zeros((1, 1))])
        assert found.error[0, 0] == pytest.approx(error, rel=1e-12)


@pytest.mark.parametrize(
    ("operation", "point"),
    [
        ("log", [-1.0]),
        ("sqrt", [-1.0]),
        ("div", [1.0, 0.0]),
        ("inv", [0.0]),
        ("exp", [1e4]),
        ("pow", [-2.0, 0.5]),
    ],
)
def test_what_has_no_value_has_no_finite_bound(operation: str, point: list[float]) -> None:
    places = tuple(range(ARITIES[operation]))
    (found,) = walk(tape_of([(operation, places)], len(point)), [np.array([point])])
    assert not np.isfinite(found.error[0, 0])


def test_cancellation_widens_the_bound_and_nothing_else_does() -> None:
    tape = tape_of([("mul", (0, 1)), ("sub", (3, 2))], 3)
    (near,) = walk(tape, [np.array([[3.0, 1 / 3, 1.0]])])
    (far,) = walk(tape, [np.array([[3.0, 1 / 3, -1.0]])])
    assert near.error[0, 0] == pytest.approx(ROUNDOFF, rel=1e-9)  # the product's rounding alone
    assert far.error[0, 0] == pytest.approx(3 * ROUNDOFF, rel=1e-9)
