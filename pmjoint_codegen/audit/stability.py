"""Section IV: the Lyapunov function, its decay, and the bound on V; (30)-(35)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import sympy as sp

from pmjoint_codegen.audit.context import Context, disturbance_symbol, spectral_norm
from pmjoint_codegen.audit.findings import (
    Case,
    Evidence,
    Finding,
    Remedy,
    Setting,
    design,
    one_unit,
    units_of,
    yes,
)
from pmjoint_codegen.audit.judgement import Evaluate, Verdict, vanishes
from pmjoint_codegen.audit.notation import chain, value
from pmjoint_codegen.audit.paper import DESIGN, YOUNG
from pmjoint_derive.lyapunov import error_weight

_SLACKS = tuple(f"1/(2*e_{i})*norm(epsilon - P*D)**2" for i in (1, 2))
_YOUNG = (
    "e_1*(z_1 - epsilon_2/(2*e_1))**2 + 1/(4*e_1)*epsilon_1**2",
    "e_2*(partial(alpha_1, y)*z_2 + epsilon_2/(2*e_2))**2 + 1/(4*e_2)*epsilon_1**2",
)
_OTHER_GAIN = Remedy((("1/(4*e_1))", "1/(4*e_2))"),))  # the last entry of the minimum


@dataclass(frozen=True)
class Constants:
    """The certificate's numbers for the example.

    Attributes:
        largest: largest eigenvalue of P.
        f_minus, f_plus, f, Y: of (33)-(35), with the corrected f_minus.
        bound: ultimate bound on |z| that V gives.
    """

    largest: float
    f_minus: float
    f_plus: float
    f: float
    Y: float

    @property
    def bound(self) -> float:
        """``sqrt(2 Y / f)``."""
        return float(sp.sqrt(2 * self.Y / self.f))


def certificate(context: Context) -> Constants:
    """The numbers of (33)-(35) from the printed formulas, (34) corrected."""
    numbers = dict(context.numbers())
    largest = max(sp.re(sp.N(value_, 30)) for value_ in context.P.xreplace(numbers).eigenvals())
    known = {
        **numbers,
        spectral_norm(): largest,
        value("D_max", context.scope(DESIGN)): context.derivation.model.disturbance_bound,
    }
    f_minus = _constant(context, _corrected(context)).xreplace(known)
    f_plus = _constant(context, context.paper["(34)"].lines[2]).xreplace(known)
    Y = _constant(context, context.paper["(33)"].lines[0]).xreplace(known)
    return Constants(float(largest), float(f_minus), float(f_plus), float(f_minus / f_plus), float(Y))


def _corrected(context: Context) -> str:
    """``f_-`` of (34) with the remedy."""
    return _OTHER_GAIN.mend(context.paper["(34)"].lines)[1]


def _constant(context: Context, line: str) -> sp.Expr:
    return value(chain(line)[0][1], context.scope(DESIGN))


def lyapunov_function(context: Context) -> Finding:
    """(30)."""
    terms = "z_1**2", "z_2**2"
    mixed = "" if one_unit(context, *terms) else "; it adds different units, joined by weights of size one"
    return Case(
        context,
        "(30)",
        calm=f"names a positive function of z and epsilon; x_1, r_1 and r_2 are not in it{mixed}",
        otherwise=Verdict.DEFINITION,
    ).judged(units_of(context, *terms))


def _printed_law(context: Context) -> Setting:
    """Evaluate with (29) as it is printed in place of v, its undefined v_0,3 included: (31) takes it so."""

    def setting(definitions: Sequence[str]) -> Evaluate:
        evaluate = design(context)(definitions)
        law = {context.signals.v: evaluate(chain(context.paper["(29)"].lines[0])[0][1])}
        return lambda text: evaluate(text).xreplace(law)

    return setting


def function_rate(context: Context) -> Finding:
    """(31)."""
    slack = " + ".join((*_SLACKS, _YOUNG[0]))
    return Case(
        context,
        "(31)",
        calm="follows",
        corrected="the result is right, exactly; the first sign is an inequality, as in (27), and v_0,3 = 0",
        setting=_printed_law(context),
        proofs={(0, 0): slack},
        remedy=Remedy((("dot(V_2) =", "dot(V_2) <="),), ("v_0_3 = 0",)),
    ).judged(Evidence("what the first relation gives away", slack))


def youngs_inequality(context: Context) -> Finding:
    """The display between (31) and (32)."""
    scope = context.scope(YOUNG)

    def setting(definitions: object) -> Evaluate:
        return lambda text: value(text, scope)

    square = "d_1*(a - b/(2*d_1))**2"
    return Case(
        context,
        "Young",
        calm="true; its d_1 is a free constant and not the plant's",
        setting=setting,
        proofs={(0, 0): square},
    ).judged(Evidence("what it gives away", square))


def function_bound(context: Context) -> Finding:
    """(32): squares for the first inequality, the norm of P for the second."""
    squares = " + ".join((*_SLACKS, *_YOUNG))
    numbers = dict(context.numbers())
    P = context.P.xreplace(numbers)
    margin = certificate(context).largest ** 2 - float(sum(entry**2 for entry in P[:, 1]))
    return Case(
        context,
        "(32)",
        calm="follows: the remainder is a sum of squares, exactly",
        setting=design(context, law=True),
        proofs={(0, 0): squares, (0, 1): lambda gap: _norm_bound(context, gap)},
    ).judged(
        Evidence("what the first relation gives away", squares),
        Evidence("|P|^2 - |P E_2|^2, which the second one gives away (example)", margin),
    )


def _norm_bound(context: Context, gap: sp.Expr) -> bool:
    """Whether a gap is ``sum 1/(2 e_i) (|P|^2 D_max^2 - |P D|^2)``, not negative by (9)."""
    bound = spectral_norm() * value("D_max", context.scope(DESIGN))
    actual = sum((entry**2 for entry in context.P * sp.Matrix([0, disturbance_symbol()])), sp.Integer(0))
    return vanishes(gap - error_weight(context.signals) * (bound**2 - actual))


def residual(context: Context) -> Finding:
    """(33): the constant part of (32)."""
    last = chain(context.paper["(32)"].lines[0])[0][-1]
    signals = (*context.signals.z, *context.signals.epsilon)
    constant = value(last, context.scope(DESIGN)).xreplace(dict.fromkeys(signals, sp.Integer(0)))
    return _named(context, "(33)", {"Y": constant}, "the constant part of (32)").judged(
        Evidence("Y (example)", certificate(context).Y)
    )


def comparison(context: Context) -> Finding:
    """The two inequalities above (34), with the corrected constants, for gains of all sizes."""
    numbers, display = certificate(context), context.paper["above (34)"]
    low, high = (list(_violations(context, line, _corrected(context))) for line in display.lines)
    same = not low and not high and _between()
    return Finding(
        "above (34)",
        display.title,
        Verdict.FOLLOWS if same else Verdict.FAILS,
        "both hold for every choice of gains, with f_- corrected as below"
        if same
        else "fails for some gains",
        display.lines,
        evidence=(
            Evidence("gains tried, sizes 1/10, 1, 10 each", len(list(_gain_choices(context)))),
            Evidence("2 min(a, b) <= a + b <= 2 max(a, b), either by |a - b|", yes(_between())),
            Evidence("f_- (example)", numbers.f_minus, "1/s"),
            Evidence("f_+ (example)", numbers.f_plus),
        ),
    )


def decay_constants(context: Context) -> Finding:
    """(34): 1/(4 e_1) stands twice, so the first inequality above fails when e_2 > e_1."""
    display = context.paper["(34)"]
    above = context.paper["above (34)"].lines
    violated = [found for line in above for found in _violations(context, line, display.lines[1])]
    mended = [found for line in above for found in _violations(context, line, _corrected(context))]
    verdict = Verdict.DEFINITION if not violated else Verdict.FAILS if mended else Verdict.CORRECTED
    wrong = verdict is Verdict.CORRECTED
    return Finding(
        "(34)",
        display.title,
        verdict,
        f"1/(4 e_1) is printed twice, the second must be 1/(4 e_2); for the example {_effect(context)}"
        if wrong
        else "constants for which the inequalities above hold",
        display.lines,
        (_corrected(context),) if wrong else (),
        (),
        "",
        (Evidence("as printed, the first inequality above (34) fails for", violated[0]),) if violated else (),
    )


def _effect(context: Context) -> str:
    """What the correction of f_- changes in the example."""
    lines = context.paper["(34)"].lines[1], _corrected(context)
    before, after = (_constant(context, line).xreplace(dict(context.numbers())) for line in lines)
    return "nothing changes" if before == after else f"f_- becomes {float(after):.4g}"


def _gain_choices(context: Context) -> Iterator[Mapping[sp.Symbol, sp.Expr]]:
    """Gains of very different sizes, in all combinations; P from the example's k."""
    s = context.signals
    sizes = (sp.Rational(1, 10), sp.Integer(1), sp.Integer(10))
    for choice in product(sizes, repeat=4):
        yield {**context.numbers(), **dict(zip((*s.c, *s.e), choice, strict=True))}


def _violations(context: Context, line: str, minus: str) -> Iterator[str]:
    """Gains and a direction for which an inequality above (34) fails."""
    scope = context.scope(DESIGN)
    P = context.P.xreplace(dict(context.numbers()))
    largest = max((sp.N(entry, 30) for entry in P.eigenvals()), key=sp.re)
    constants = {
        "f_minus": _constant(context, minus),
        "f_plus": _constant(context, context.paper["(34)"].lines[2]),
    }
    form = {"bar(V_2)": _constant(context, context.paper["(34)"].lines[0])}
    left, right = (value(text, {**scope, **constants, **form}) for text in chain(line)[0])
    signals = (*context.signals.z, *context.signals.epsilon)
    hessian = sp.hessian(sp.expand(right - left), signals).xreplace({spectral_norm(): largest})
    for gains in _gain_choices(context):
        matrix = np.array(hessian.xreplace(dict(gains)).tolist(), dtype=np.float64)
        values, vectors = np.linalg.eigh(matrix)
        if (
            values[0] < -1e-12 * abs(values).max()
        ):  # far above rounding, far below any violation by a wrong constant
            chosen = ", ".join(
                f"{symbol} = {gains[symbol]}" for symbol in (*context.signals.c, *context.signals.e)
            )
            place = int(np.argmax(abs(vectors[:, 0])))
            excess = f"{-matrix[place, place] / 2:.4g} {signals[place]}^2"
            yield f"{chosen}: along {signals[place]} the left side is larger by {excess}"


def _between() -> bool:
    """``2 min(a, b) <= a + b <= 2 max(a, b)``: either difference is ``|a - b|``."""
    a, b = sp.symbols("a b", positive=True)
    below = a + b - 2 * sp.Min(a, b).rewrite(sp.Abs)
    above = 2 * sp.Max(a, b).rewrite(sp.Abs) - a - b
    return all(sp.expand(side - sp.Abs(a - b)) == 0 for side in (below, above))


def decay(context: Context) -> Finding:
    """(35): what is left over is f times ``f_+ bar(V_2) - V_2``, not negative by the line above (34)."""
    minus, plus, form, Y, V = sp.symbols("f_minus f_plus V_bar Y V_2", positive=True)
    rate = value(chain(context.paper["below (35)"].lines[0])[0][1], {"f_minus": minus, "f_plus": plus})
    scope = {"f": rate, "Y": Y, "V_2": V}
    right = value(chain(context.paper["(35)"].lines[0])[0][1], scope)
    left_over = sp.factor(right - (-minus * form + Y))
    holds = vanishes(left_over - minus / plus * (plus * form - V))
    numbers = certificate(context)
    return Finding(
        "(35)",
        context.paper["(35)"].title,
        Verdict.FOLLOWS if holds else Verdict.FAILS,
        "follows from (32)-(34)" if holds else "the printed relation does not hold",
        context.paper["(35)"].lines,
        evidence=(
            Evidence("what it gives away", str(left_over)),
            Evidence("f (example)", numbers.f, "1/s"),
            Evidence("ultimate bound on |z|, sqrt(2 Y/f) (example)", numbers.bound),
        ),
    )


def value_bound(context: Context) -> Finding:
    """The bound on V below (35), by solving the comparison equation."""
    t = sp.Symbol("t", nonnegative=True)
    f, Y, initial = sp.symbols("f Y V_0", positive=True)
    V = sp.Function("V")
    solution = sp.dsolve(sp.Derivative(V(t), t) + f * V(t) - Y, V(t), ics={V(0): initial}).rhs
    scope = {"V_2(0)": initial, "Y": Y, "f": f}
    bound = value(chain(context.paper["below (35)"].lines[1])[0][1], scope)
    fading = sp.exp(-f * t)
    left_over = sp.factor(sp.expand(bound - solution))
    holds = vanishes(sp.expand(left_over - (initial * (1 - fading) + Y / f * fading)))
    return Finding(
        "below (35)",
        context.paper["below (35)"].title,
        Verdict.FOLLOWS if holds else Verdict.FAILS,
        "V, and with it z and epsilon, is bounded" if holds else "the printed relation does not hold",
        context.paper["below (35)"].lines,
        evidence=(Evidence("what it gives away", str(left_over)),),
    )


def _named(context: Context, number: str, known: Mapping[str, sp.Expr], calm: str) -> Case:
    """A display that names something, with that thing put in the name's place."""
    scope = {**context.scope(DESIGN), **known}

    def setting(definitions: object) -> Evaluate:
        return lambda text: value(text, scope)

    kept: Setting = setting
    return Case(context, number, calm=calm, otherwise=Verdict.DEFINITION, setting=kept)
