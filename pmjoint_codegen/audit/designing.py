"""The auxiliary system, the errors and the law: (23)-(29)."""

from __future__ import annotations

import sympy as sp

from pmjoint_codegen.audit.context import Context
from pmjoint_codegen.audit.findings import (
    Case,
    Evidence,
    Finding,
    Remedy,
    derived_text,
    design,
    one_unit,
    undefined,
    units_of,
)
from pmjoint_codegen.audit.judgement import Verdict
from pmjoint_codegen.report.notation import text_expression

_UNDEFINED = "v_0_3"


def auxiliary_system(context: Context) -> Finding:
    """(23)."""
    return Case(
        context,
        "(23)",
        calm="the compensator that is derived and generated",
        otherwise=Verdict.DEFINITION,
        derived=derived_text(context, "r1_dot", "r2_dot"),
    ).judged()


def lost_input(context: Context) -> Finding:
    """The input of (23)."""
    return Case(
        context,
        "Delta u",
        calm="what saturation takes away; it needs the applied input u",
        otherwise=Verdict.DEFINITION,
    ).judged()


def errors(context: Context) -> Finding:
    """(24)."""
    return Case(
        context,
        "(24)",
        calm="the errors that are derived and generated",
        otherwise=Verdict.DEFINITION,
        derived=derived_text(context, "z1", "z2"),
    ).judged()


def first_rate(context: Context) -> Finding:
    """Step 1."""
    return Case(
        context, "step 1", calm="follows from (21), (23) and (24); neither u nor Delta u is in it"
    ).judged()


def virtual_control(context: Context) -> Finding:
    """(25)."""
    return Case(
        context,
        "(25)",
        calm="equals the derived virtual control, term by term",
        derived=derived_text(context, "alpha1"),
    ).judged()


def first_function(context: Context) -> Finding:
    """(26)."""
    terms = "z_1**2", "epsilon_1**2/e_1", "epsilon_2**2/e_1"
    mixed = "" if one_unit(context, *terms) else "; it adds different units, joined by weights of size one"
    return Case(
        context, "(26)", calm=f"names a positive function{mixed}", otherwise=Verdict.DEFINITION
    ).judged(units_of(context, *terms))


def first_function_rate(context: Context) -> Finding:
    """(27)."""
    slack = "1/(2*e_1)*norm(epsilon - P*D)**2"
    young = "e_1*(z_1 - epsilon_2/(2*e_1))**2 + 1/(4*e_1)*epsilon_1**2"
    return Case(
        context,
        "(27)",
        calm="follows",
        corrected="the bound is right; the first sign is an inequality, since (20) is one",
        proofs={(0, 0): slack, (0, 3): young},
        remedy=Remedy((("dot(V_1) =", "dot(V_1) <="),)),
    ).judged(
        Evidence("what the first relation gives away", slack), Evidence("what the last one gives away", young)
    )


def second_rate(context: Context) -> Finding:
    """(28): the print uses v_{0,3}, which it nowhere defines; for two states it is zero."""
    return Case(
        context,
        "(28)",
        calm="follows",
        corrected="follows with v_0,3 = 0; u and Delta u leave it together: the errors do not see saturation",
        remedy=Remedy(given=(f"{_UNDEFINED} = 0",)),
    ).judged(*undefined(context, _UNDEFINED, "v_0,3"))


def control_law(context: Context) -> Finding:
    """(29)."""
    mixed = (
        ""
        if one_unit(context, "v", "b_0*z_1")
        else "; b_0 z_1 has not the unit of v: in other units the same gains are another law"
    )
    return Case(
        context,
        "(29)",
        calm=f"equals the derived law, term by term{mixed}",
        corrected=f"equals the derived law, term by term, with v_0,3 = 0{mixed}",
        setting=design(context, law=True),
        remedy=Remedy(given=(f"{_UNDEFINED} = 0",)),
        derived=derived_text(
            context, "dalpha1_dy", "dalpha1_dxi2", "dalpha1_dXi21", "dalpha1_dr1", "dalpha1_dy_r", "v"
        ),
    ).judged(
        units_of(context, "v", "b_0*z_1"),
        Evidence(
            "with u counted in q-ths of its unit and every gain carried over, v/q is larger by",
            _change_of_units(context),
        ),
    )


def _change_of_units(context: Context) -> str:
    """What becomes of the derived law, gains carried over, when the input's unit is a q-th of what it was."""
    units, input_unit = context.derivation.units, context.derivation.model.u_unit
    q = sp.Symbol("q", positive=True)
    law = context.expand(context.signals.v, law=True)
    scaled = law.xreplace(
        {symbol: symbol * q ** units.of(symbol).powers.get(input_unit, 0) for symbol in law.free_symbols}
    )
    z_1 = context.expand(context.signals.z[0])
    change = sp.factor(sp.expand(scaled / q - law))
    ratio = sp.cancel(change / z_1)
    return (
        f"z_1*({text_expression(sp.expand(ratio))})"
        if not ratio.has(*z_1.free_symbols)
        else text_expression(change)
    )
