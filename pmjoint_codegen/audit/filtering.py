"""The filters and what they say of the state: (12)-(22)."""

from __future__ import annotations

import sympy as sp

from pmjoint_codegen.audit.context import Context
from pmjoint_codegen.audit.findings import Case, Evidence, Finding, Remedy, derived_text, undefined, yes
from pmjoint_codegen.audit.judgement import Verdict
from pmjoint_codegen.audit.notation import value
from pmjoint_codegen.audit.paper import DESIGN


def system_in_matrices(context: Context) -> Finding:
    """(12)."""
    return Case(context, "(12)", calm="(11) in matrices").judged()


def matrices(context: Context) -> Finding:
    """(13)."""
    return Case(
        context, "(13)", calm="the matrices that make (12) equal to (11)", otherwise=Verdict.DEFINITION
    ).judged()


def filters(context: Context) -> Finding:
    """(14)."""
    names = [f"{state}_dot" for state in context.signals.controller_state[:6]]
    standing = undefined(context, "E_2", "E_2")
    nowhere = standing[-1].value == "no display"
    missing = ", and E_2, which nothing defines, is the second unit vector" if nowhere else ""
    return Case(
        context,
        "(14)",
        calm=f"the filters that are derived and generated; the third needs the applied input u{missing}",
        otherwise=Verdict.DEFINITION,
        derived=derived_text(context, *names),
    ).judged(
        *standing,
        Evidence("b_0 E_2 less the column of (12), with E_2 the second unit vector", _column_gap(context)),
    )


def lyapunov_equation(context: Context) -> Finding:
    """A_0 and P, with the example's numbers."""
    scope, numbers = context.scope(DESIGN), dict(context.numbers())
    poles = [float(sp.re(pole)) for pole in scope["A_0"].xreplace(numbers).eigenvals()]
    P = context.P.xreplace(numbers)
    return Case(
        context,
        "A_0, P",
        calm="P exists, is unique, and is positive for the example's gains",
        derived=(f"P = {context.P.tolist()}",),
    ).judged(
        *undefined(context, "E_1", "E_1"),
        Evidence("eigenvalues of A_0 for k = (6, 8)", str(sorted(poles)), "1/s"),
        Evidence("P", str([[float(entry) for entry in P.row(i)] for i in range(P.rows)])),
        Evidence("P is positive definite", yes(P.is_positive_definite)),
    )


def _column_gap(context: Context) -> str:
    """What (18) needs to be zero: the difference of the two ways in which u enters."""
    return str(list(value("b_0*E_2 - [[0], [b_0]]", context.scope(DESIGN))))


def state_estimate(context: Context) -> Finding:
    """(15)."""
    return Case(
        context,
        "(15)",
        calm="the estimate that is derived and generated",
        otherwise=Verdict.DEFINITION,
        derived=derived_text(context, "x_hat1", "x_hat2"),
    ).judged()


def estimate_rate(context: Context) -> Finding:
    """(16)."""
    return Case(context, "(16)", calm="follows from (14) and (15), step by step").judged()


def estimation_error(context: Context) -> Finding:
    """(17)."""
    return Case(context, "(17)", calm="names the error", otherwise=Verdict.DEFINITION).judged()


def error_dynamics(context: Context) -> Finding:
    """(18)."""
    return Case(
        context,
        "(18)",
        calm="the error obeys its own stable dynamics, whatever u is",
        corrected="the result is right, whatever u is; the first line lacks a dot over the estimate",
        remedy=Remedy((("= dot(x) - hat(x) =", "= dot(x) - dot(hat(x)) ="),)),
        reading="doubtful: the dot may have been lost in the copy that was read; nothing below depends on it",
    ).judged()


def error_function(context: Context) -> Finding:
    """(19)."""
    return Case(
        context, "(19)", calm="names a positive function of the error", otherwise=Verdict.DEFINITION
    ).judged()


def error_function_rate(context: Context) -> Finding:
    """(20), by completing a square, and Remark 3's bound."""
    numbers = dict(context.numbers())
    largest = sp.N(max(context.P.xreplace(numbers).eigenvals(), key=sp.N))
    bound = largest**3 * (context.derivation.model.disturbance_bound or 0.0) ** 2
    square = "norm(epsilon - P*D)**2"
    return Case(
        context,
        "(20)",
        calm="follows: P^T A_0 has the quadratic form of A_0^T P, which is meant; the inequality is Young's",
        proofs={(0, 3): square},
    ).judged(
        Evidence("what the inequality gives away", square),
        Evidence("bound on V_epsilon, as Remark 3 says (example, from rest)", float(bound)),
    )


def output_rate(context: Context) -> Finding:
    """(21)."""
    return Case(
        context,
        "(21)",
        calm="the output's rate, as the law uses it",
        corrected="the result is right; the scalar x_hat_1 and the vector epsilon are added for epsilon_1",
        remedy=Remedy((("dot(epsilon) =", "dot(epsilon_1) ="),)),
        derived=derived_text(context, "Omega"),
        reading="doubtful: an index that may have been lost in the copy that was read",
    ).judged()


def regressors(context: Context) -> Finding:
    """(22), and that both regressors say the same of the output's rate."""
    scope = context.scope(DESIGN)
    same = value("T(omega)*Theta - b_0*v_0_2 - T(bar(omega))*Theta", scope)
    return Case(context, "(22)", calm="names the regressors", otherwise=Verdict.DEFINITION).judged(
        Evidence("omega' Theta - b_0 v_0,2 - bar(omega)' Theta", str(sp.expand(same)))
    )


def input_filter_entries(context: Context) -> Finding:
    """The sentence below (22), from which v_{0,3} can be read."""
    entry = value("T(E_2)*A*v_0", context.scope(DESIGN))
    return Case(
        context,
        "below (22)",
        calm="names the entries",
        corrected="v_0,2 is said twice, as two different things; the second sentence gives v_0,3 = 0",
        otherwise=Verdict.DEFINITION,
        remedy=Remedy((("v_0_2 = T(E_2)*A", "v_0_3 = T(E_2)*A"),), ("v_0_3 = 0",)),
        reading="doubtful: that the second sentence means v_0,3, which (28) uses and nothing defines",
    ).judged(Evidence("second entry of A v_0", str(entry)))
