"""Which numbers a design may have, in a model file or set for one run.

The rules are the assumptions of the design: positive gains (23), (25), (29), a Hurwitz filter matrix
``A0 = A - k e1'`` (14), a positive actuator limit (10) and an input coefficient ``b_m`` other than zero (11).
Rules of one model, such as a joint's positive inertia, come with its manifest as `Rule` over expressions.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import ModelError, PmjointError
from pmjoint_codegen.operations import by_name
from pmjoint_codegen.poles import poles_text

SI = "1"  # the scale of a parameter that is stated in SI units, or in units that its author keeps consistent
ZERO, MATCHED = "zero", "matched"  # starts of the controller
STARTS = (ZERO, MATCHED)
BACKSTEPPING, ADRC = "backstepping", "adrc"  # laws
OBSERVER = "observer"  # bandwidth of an extended-state observer
BRAKING = "braking"  # share of the limit that a braking compensator reckons with
CLIP = "clip"
SATURATIONS = ("compensator", CLIP, BRAKING)
COMPENSATOR = "compensator"  # the switch between (23) and plain clipping
FILTER_GAINS = "gains k"  # all of them, in a message; a parameter may be called k
INPUT_SCALE = "input_scale"  # kappa: the law is that of the input kappa u
SETTLED = 0.02  # fraction of |e(0)|: e has settled once it stays within it
OWN_SUFFIX = "_plant"  # of the simulated plant's own value of a parameter that the controller uses too

Numbers = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = MappingProxyType(
    {  # of every expression, in model files and in rules
        ast.Add: operator.add,
        ast.Sub: operator.sub,
        ast.Mult: operator.mul,
        ast.Div: operator.truediv,
        ast.Pow: operator.pow,
    }
)
_CONSTANTS: Mapping[str, float] = MappingProxyType({"pi": math.pi})


_RULES: Mapping[str, Callable[[Numbers], Mask]] = MappingProxyType(
    {
        "positive": lambda terms: terms > 0,
        "nonnegative": lambda terms: terms >= 0,
        "whole": lambda terms: (terms >= 0) & (terms <= 2.0**53) & (terms == np.floor(terms)),
        "nonzero": lambda terms: terms != 0,
        "zero": lambda terms: terms == 0,
    }
)


@dataclass(frozen=True)
class GainKind:
    """A list of gains under ``[design]``; its entries are parameters such as ``c1``, ``c2``.

    Attributes:
        name: key of the list, and what its parameters' names begin with.
        latex: the same in the paper's notation.
        about: what an entry is; its number follows.
        of_filters: one entry per state, together such that A0 is Hurwitz (14); else one positive entry
            per step.
    """

    name: str
    latex: str
    about: str
    of_filters: bool = False

    def names(self, n: int, rho: int) -> tuple[str, ...]:
        """Names of the parameters, for order n and relative degree rho."""
        return gain_names((self.name,), n if self.of_filters else rho)


GAINS = (
    GainKind("c", "c", "damping of backstepping error"),
    GainKind("e", "e", "damping against the estimation error, step"),
    GainKind("ck", "c_k", "decay rate of compensator state"),
    GainKind("k", "k", "filter gain", of_filters=True),
)


@dataclass(frozen=True)
class Rule:
    """A rule for one model's parameters, whoever sets them; the manifest holds it, so a run can test it.

    Attributes:
        name: the parameter or coefficient at the start of a message.
        kind: of the terms, which are always ``finite``: one that is ``positive``, ``nonnegative``, ``whole``
            (0, 1, 2, ... up to 2^53), ``nonzero`` or ``zero``, or a polynomial's coefficients, highest power
            first, which is ``hurwitz``: all its roots lie in the open left half plane.
        terms: expressions of parameters, in Python's notation.
        what: what is wrong if the rule is broken; empty if the value shows it.
        allowed: what is allowed.
    """

    name: str
    kind: Literal["finite", "positive", "nonnegative", "whole", "nonzero", "zero", "hurwitz"]
    terms: tuple[str, ...]
    what: str
    allowed: str

    @cached_property
    def trees(self) -> tuple[ast.expr, ...]:
        """The terms' syntax; a name may be a word of Python, such as lambda."""
        return tuple(
            ast.Name(term) if term.isidentifier() else ast.parse(term, mode="eval").body
            for term in self.terms
        )

    @cached_property
    def names(self) -> frozenset[str]:
        """Parameters in the rule, and functions."""
        return frozenset(
            node.id for tree in self.trees for node in ast.walk(tree) if isinstance(node, ast.Name)
        )


def check_values(
    values: Mapping[str, float],
    *,
    n: int,
    rho: int,
    limit: str | None,
    leading: str | None,
    where: str,
    error: type[PmjointError] = ModelError,
    key: Callable[[str], str] = str,
    scales: Mapping[str, str] | None = None,
) -> None:
    """Check the value of every parameter, gain and switch of a design.

    Args:
        values: name -> number: plant parameters, ``c1..``, ``e1..``, ``ck1..``, ``k1..``, ``compensator``,
            ``input_scale``; a design that has ``observer`` in place of gains is without these.
        n: order of the plant.
        rho: relative degree.
        limit: name of the parameter that limits the actuator on both sides; None: there are two.
        leading: name of the parameter that is b_m; None where b_m is an expression, which the caller checks.
        where: file or option at the start of a message.
        error: kind of error to raise: `ModelError` for a file, `UsageError` for a command.
        key: turns a name into the reader's name for it, such as ``design.c, entry 1``.
        scales: of names that are stated in non-SI units, so that a message shows what was written.

    Raises:
        PmjointError: of the kind `error`, for the first rule that a value breaks.
    """

    def refuse(name: str, what: str, allowed: str) -> PmjointError:
        return error(
            what, where=f"{where}: {key(name)}" if where else key(name), remedy=f"allowed: {allowed}"
        )

    for name, value in values.items():
        if not math.isfinite(value):
            raise refuse(name, f"is {value}", "a finite number")
    for name in (*positive_gains(rho), OBSERVER, INPUT_SCALE, *([] if limit is None else [limit])):
        if name in values and not values[name] > 0:
            written = from_si(values[name], (scales or {}).get(name, SI))
            raise refuse(name, f"is {written:g}", "a number greater than 0")
    if leading is not None and values[leading] == 0:
        raise refuse(leading, "is 0, so b_m = 0 and no input acts", "a number other than 0")
    if values[COMPENSATOR] not in (0, 1):
        raise refuse(COMPENSATOR, f"is {values[COMPENSATOR]:g}", "1 (on) or 0 (off)")
    gains = [values[name] for name in filter_gains(n) if name in values]  # an observer has none
    if gains and not is_hurwitz([1.0, *gains]):
        raise refuse(
            FILTER_GAINS,
            f"leaves A0 = A - k e1' unstable, eigenvalues {roots_text([1.0, *gains])}",
            _hurwitz_rule(n),
        )


def check_rules(
    values: Mapping[str, float],
    rules: Iterable[Rule],
    *,
    error: type[PmjointError] = ModelError,
    key: Callable[[str], str] = str,
    scales: Mapping[str, str] | None = None,
) -> None:
    """Check the rules that a model adds to those of every design.

    Args:
        values: name -> number.
        rules: of the model.
        error: kind of error to raise.
        key: turns a name into the reader's name for it, such as ``actuator.lag``.
        scales: of names that are stated in non-SI units, so that a message shows what was written.

    Raises:
        PmjointError: of the kind `error`, for the first rule that is broken.
    """
    columns = {name: np.array([value]) for name, value in values.items()}
    for rule in rules:
        if not obeys(rule, columns)[0]:
            found = [float(term[0]) for term in _terms(rule, columns)]
            if rule.terms == (rule.name,):
                found = [from_si(found[0], (scales or {}).get(rule.name, SI))]
            raise error(_broken(rule, found), where=key(rule.name), remedy=f"allowed: {rule.allowed}")


def obeys(rule: Rule, columns: Mapping[str, Numbers]) -> Mask:
    """Which of many designs satisfy a rule; a term without a finite value violates it.

    Args:
        rule: of the model.
        columns: name -> numbers, one per design.
    """
    terms = np.column_stack(_terms(rule, columns))
    good: Mask = np.all(np.isfinite(terms), axis=1)
    if rule.kind == "finite":
        return good
    if rule.kind == "hurwitz":
        good[good] = hurwitz_rows(terms[good])
        return good
    result: Mask = good & np.all(_RULES[rule.kind](terms), axis=1)
    return result


def _broken(rule: Rule, found: Sequence[float]) -> str:
    """Describe how a rule is broken, with the value that breaks it."""
    if not all(math.isfinite(value) for value in found):
        return "has no finite value at these parameters"
    if rule.kind == "hurwitz":
        return f"{rule.what} has the roots {roots_text(found) or 'of no polynomial'}"
    if rule.kind == "zero":  # the value is the user's, perhaps in another unit
        return rule.what
    return f"is {found[0]:g}" if not rule.what else f"{rule.what}: {rule.terms[0]} = {found[0]:g}"


def _terms(rule: Rule, columns: Mapping[str, Numbers]) -> list[Numbers]:
    size = len(next(iter(columns.values())))
    with np.errstate(all="ignore"):  # a non-finite value breaks the rule
        found = (np.asarray(evaluate(tree, columns), dtype=np.float64) for tree in rule.trees)
        return [np.broadcast_to(term, size) for term in found]


def evaluate(node: ast.expr, columns: Mapping[str, Numbers]) -> Any:
    """Evaluate the syntax of a model's expressions, and nothing else.

    Args:
        node: syntax of an expression of parameters.
        columns: name -> numbers, one per design.

    Raises:
        ValueError: for any other syntax.
    """
    match node:
        case ast.Constant(value=int() | float() as value):
            return value
        case ast.Name(id=name):
            return columns[name] if name in columns else _CONSTANTS[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -evaluate(operand, columns)
        case ast.BinOp(left=left, op=op, right=right):
            return OPERATORS[type(op)](evaluate(left, columns), evaluate(right, columns))
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return by_name()["fabs" if name == "abs" else name].of(np)(evaluate(argument, columns))
    raise ValueError(f"not an expression of parameters: {ast.unparse(node)}")


def to_si(value: float, scale: str) -> float:
    """Convert a number in a model file's own unit to SI units, rounded once: 14.7 mm is 0.0147 m.

    Args:
        value: as written.
        scale: how many SI units the unit is, as a decimal.
    """
    if scale == SI or not math.isfinite(value):
        return value
    from decimal import Decimal

    return float(Decimal(repr(value)) * Decimal(scale))


def from_si(value: float, scale: str) -> float:
    """The shortest number in a model file's own unit that `to_si` maps to `value`, or the nearest."""
    if scale == SI or not math.isfinite(value):
        return value
    from decimal import Decimal

    exact = Decimal(repr(value)) / Decimal(scale)
    nearest = float(exact)
    found = [float(f"{exact:.{digits}g}") for digits in (15, 16)]
    found += [nearest, math.nextafter(nearest, math.inf), math.nextafter(nearest, -math.inf)]
    return next((number for number in found if to_si(number, scale) == value), nearest)


def all_to_si(values: Numbers, scale: str) -> Numbers:
    """`to_si` of many numbers; equal ones are converted once."""
    if scale == SI:
        return values
    different, places = np.unique(values, return_inverse=True)
    return np.array([to_si(value, scale) for value in different.tolist()])[places.reshape(values.shape)]


def of_plant(values: Mapping[str, float], name: str) -> float:
    """The simulated plant's value of a parameter, whatever the controller's value is."""
    return values.get(f"{name}{OWN_SUFFIX}", values[name])


def positive_gains(rho: int) -> tuple[str, ...]:
    """Names of the gains that are positive, for relative degree rho."""
    return gain_names((kind.name for kind in GAINS if not kind.of_filters), rho)


def filter_gains(n: int) -> tuple[str, ...]:
    """Names of the gains of A0, for order n."""
    return gain_names((kind.name for kind in GAINS if kind.of_filters), n)


def gain_names(kinds: Iterable[str], count: int) -> tuple[str, ...]:
    """Names ``c1 ... cN`` of gains, kind by kind."""
    return tuple(f"{kind}{i}" for kind in kinds for i in range(1, count + 1))


def is_hurwitz(coefficients: Sequence[float]) -> bool:
    """Whether all roots of a polynomial, highest power first, lie in the open left half plane.

    Routh's criterion in exact integer arithmetic, so that no rounding decides near the imaginary axis.
    """
    exact = _integers(coefficients)
    if exact[0] == 0:
        return False
    if exact[0] < 0:
        exact = [-entry for entry in exact]
    upper, lower = exact[0::2], exact[1::2]
    while lower:
        if lower[0] <= 0:
            return False
        padded = [*lower[1:], *[0] * (len(upper) - len(lower))]
        row = [lower[0] * a - upper[0] * b for a, b in zip(upper[1:], padded, strict=True)]
        divisor = math.gcd(*row) or 1  # positive: changes no sign; keeps the integers short
        upper, lower = lower, [entry // divisor for entry in row]
    return True


def hurwitz_rows(polynomials: Numbers) -> Mask:
    """`is_hurwitz` of many polynomials, shape (designs, coefficients); equal ones are tested once."""
    rows, which = np.unique(polynomials, axis=0, return_inverse=True)
    verdicts = np.array([is_hurwitz(row) for row in rows.tolist()], dtype=bool)
    return verdicts[which.reshape(-1)]


def _integers(values: Sequence[float]) -> list[int]:
    """Scale floats, which are dyadic fractions, to integers of the same ratios."""
    ratios = [float(value).as_integer_ratio() for value in values]
    scale = max(denominator for _, denominator in ratios)  # powers of two: the largest is a multiple of each
    return [numerator * (scale // denominator) for numerator, denominator in ratios]


def roots_text(coefficients: Sequence[float]) -> str:
    """Show the roots of a polynomial, highest power first, to six digits."""
    with np.errstate(all="ignore"):
        try:
            roots = np.sort_complex(np.roots(np.asarray(coefficients, dtype=float)))
        except np.linalg.LinAlgError:  # coefficients near the largest float
            return "that overflow floating point"
    return poles_text(roots)


def _hurwitz_rule(n: int) -> str:
    rule = {1: "k1 > 0", 2: "k1 > 0 and k2 > 0", 3: "k1 > 0, k3 > 0 and k1 k2 > k3"}
    return rule.get(n, "gains for which every eigenvalue has a negative real part")
