"""What the audit finds in the paper as printed, against figures worked out independently."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest
import sympy as sp

from pmjoint_codegen.audit import claims, designing, filtering, stability
from pmjoint_codegen.audit.context import Context
from pmjoint_codegen.audit.examination import COMPARISONS
from pmjoint_codegen.audit.findings import Finding
from pmjoint_codegen.audit.judgement import Verdict
from pmjoint_codegen.audit.paper import printed_equations
from pmjoint_codegen.audit.stability import certificate
from pmjoint_derive import derive, real_symbol
from pmjoint_derive.equation import Equations

Findings = Mapping[str, Finding]


def fact(findings: Findings, number: str, label: str) -> float | str:
    """Return the one computed fact of a finding whose label contains a text."""
    (found,) = (item.value for item in findings[number].evidence if label in item.label)
    return found


def figure(findings: Findings, number: str, label: str) -> float:
    """Return such a fact that is a number."""
    found = fact(findings, number, label)
    assert isinstance(found, float | int)
    return float(found)


def test_every_numbered_equation_has_a_finding(findings: Findings) -> None:
    assert {f"({number})" for number in range(1, 38)} <= set(findings)
    assert set(printed_equations()) - set(findings) == {"radii"}  # part of (1)


def test_verdicts_on_the_print(findings: Findings) -> None:
    by_verdict = {
        verdict: {n for n, item in findings.items() if item.verdict is verdict} for verdict in Verdict
    }
    assert by_verdict[Verdict.FAILS] == {"Theorem 1, all signals"}
    assert by_verdict[Verdict.CORRECTED] == {
        "(5)", "(8)", "(18)", "(21)", "below (22)", "(27)", "(28)", "(29)", "(31)", "(34)",
        "u_M unknown", "compensation", "notation", "Section III",
    }  # fmt: skip
    assert {"(11)", "(12)", "(16)", "(20)", "(25)", "(32)", "(35)"} <= by_verdict[Verdict.FOLLOWS]
    assert {"(1)", "(2)", "(3)", "(4)", "(9)", "d(t)", "Assumption 1"} <= by_verdict[Verdict.ASSUMPTION]


def test_the_physics_differs_in_three_places(findings: Findings) -> None:
    assert fact(findings, "(5)", "damping") == fact(findings, "(5)", "stiffness") == "1"
    assert fact(findings, "(5)", "input gain") == fact(findings, "(8)", "printed b_0") == "k_0"
    assert fact(findings, "(5)", "disturbance") == "J"
    assert fact(findings, "(5)", "theta^2 u") == "2*C_1*k_u*r**3/(J*l_0**2)"
    assert fact(findings, "(5)", "derived and simulated here") == "yes"
    assert fact(findings, "(1)", "one radius") == "0"  # C_4 cancels
    assert fact(findings, "(8)", "ideal braid") == "yes"
    assert figure(findings, "(8)", "(model joint): d_1") < 0


def test_the_certificates_numbers(context: Context, findings: Findings) -> None:
    numbers = certificate(context)
    assert round(numbers.largest, 4) == 2.2575
    assert (numbers.f_minus, round(numbers.f_plus, 3), round(numbers.f, 4)) == (2.5, 11.288, 0.2215)
    assert (round(numbers.Y, 4), round(numbers.bound, 2)) == (0.5097, 2.15)
    assert fact(findings, "A_0, P", "eigenvalues") == "[-4.0, -2.0]"
    assert fact(findings, "A_0, P", "positive definite") == "yes"
    assert round(figure(findings, "Theorem 1, z and epsilon", "|z_1|"), 3) == 0.006


def test_undefined_filter_entry_is_zero(findings: Findings) -> None:
    assert fact(findings, "(28)", "is used in") == "(28), (29), (31)"
    assert fact(findings, "(28)", "defined in") == "no display"
    assert fact(findings, "below (22)", "second entry") == "0"
    assert findings["(29)"].corrected == ("v_0_3 = 0",)
    # with (29) as printed, v_0,3 leaves the last step of (31): the law takes it away again
    broken = [item.label for item in findings["(31)"].evidence if "does not hold" in item.label]
    assert broken == ["relation 1 of 3 does not hold", "relation 2 of 3 does not hold"]


def test_unit_vectors_are_used_before_anything_defines_them(context: Context, findings: Findings) -> None:
    assert str(fact(findings, "(14)", "E_2 is used in")).startswith("(14), (16)")
    assert fact(findings, "A_0, P", "E_1 is used in") == "A_0, P, (18)"
    assert fact(findings, "(14)", "defined in") == fact(findings, "A_0, P", "defined in") == "no display"
    assert fact(findings, "(14)", "less the column of (12)") == "[0, 0]"
    defined = replace(context.paper["(13)"], lines=("E_2 = [[0], [1]]",))
    told = filtering.filters(replace(context, paper={**context.paper, "(13)": defined}))
    assert fact({"(14)": told}, "(14)", "defined in") == "(13)"
    assert "nothing defines" in findings["(14)"].summary
    assert "nothing defines" not in told.summary


def test_the_certificate_adds_different_units(context: Context, findings: Findings) -> None:
    assert fact(findings, "(26)", "units of") == "rad^2, s rad^2, rad^2/s"
    assert fact(findings, "(30)", "units of") == "rad^2, V^2 s^2"
    assert fact(findings, "(29)", "units of") == "V, rad^2/(s^2 V)"
    assert all("different units" in findings[number].summary for number in ("(26)", "(30)"))
    assert "another law" in findings["(29)"].summary
    model = replace(context.derivation.model, y_unit="V s")  # the unit of z_2
    same = stability.lyapunov_function(replace(context, derivation=derive(model)))
    assert "different units" not in same.summary


def test_in_other_units_the_law_gains_a_multiple_of_z1(context: Context, findings: Findings) -> None:
    said = str(fact(findings, "(29)", "q-ths"))
    q, b0, z_1 = (sp.Symbol(name) for name in ("q", "b0", "z_1"))
    assert sp.expand(sp.sympify(said) - b0 * z_1 * (1 - 1 / q**2)) == 0  # b_0 z_1 counts as u^-1, v as u
    law = context.derivation.equations["v"]
    uncoupled = replace(law, expression=law.expression + context.signals.z[0] * real_symbol("b0"))
    equations = Equations(
        uncoupled if item.name == "v" else item for item in context.derivation.equations.values()
    )
    other = designing.control_law(
        replace(context, derivation=replace(context.derivation, equations=equations))
    )
    assert fact({"(29)": other}, "(29)", "q-ths") == "z_1*(0)"  # all other terms carry the unit of u


def test_damping_is_not_small_on_the_measured_joint(findings: Findings) -> None:
    assert round(figure(findings, "d(t)", "b_v/J"), 9) == 2.18
    assert figure(findings, "d(t)", "b_v/J") > figure(findings, "d(t)", "sqrt(d_1) of the example")
    assert round(figure(findings, "d(t)", "right-most"), 9) == -1.09  # -b_v/(2 J): complex poles
    assert figure(findings, "d(t)", "without the damping") == 0.0
    assert "all the damping" in findings["d(t)"].summary


def test_nothing_adapts(context: Context, findings: Findings) -> None:
    assert fact(findings, "Section III", "law needs") == "d1, b0"
    assert fact(findings, "Section III", "tracking error drives") == "none"
    law = context.derivation.equations["Xi21_dot"]
    adapting = replace(law, expression=law.expression + context.signals.z[0])
    equations = Equations(
        adapting if item.name == "Xi21_dot" else item for item in context.derivation.equations.values()
    )
    other = replace(context, derivation=replace(context.derivation, equations=equations))
    nothing: object = None
    finding = claims.adaptive_title(other, nothing)  # type: ignore[arg-type]
    assert (finding.verdict, finding.evidence[-1].value) == (Verdict.FOLLOWS, "Xi21")


def test_the_twice_printed_term_fails_only_for_unequal_gains(findings: Findings) -> None:
    example = str(fact(findings, "(34)", "as printed"))
    gains = dict(part.split(" = ") for part in example.partition(":")[0].split(", "))
    e1, e2 = float(gains["e1"]), float(gains["e2"])
    f_minus = min(float(gains["c1"]), float(gains["c2"]), 1 / (4 * e1))
    assert 1 / (4 * e1) + 1 / (4 * e2) < 2 * f_minus  # the coefficient of |epsilon|^2 on either side
    assert "for the example nothing changes" in findings["(34)"].summary


def test_boundedness_ends_near_seventy_and_at_the_strip(findings: Findings) -> None:
    theorem = "Theorem 1, all signals"
    for law, boundary in (("law, no disturbance", 70.17), ("law with (37)", 70.15)):
        held, lost = (figure(findings, theorem, f"{law}: {fate} from") for fate in ("bounded", "diverging"))
        assert held < boundary < lost < held + 0.03
    clipped = [figure(findings, theorem, f"clipping): {fate} from") for fate in ("bounded", "diverging")]
    strip = figure(findings, theorem, "beyond b_0 u_M/d_1")
    assert clipped[0] < strip == 100.0 < clipped[1]
    assert round(figure(findings, theorem, "(b_0 u_M - D_max)/d_1"), 9) == 99.5
    assert fact(findings, theorem, "below 1e-6") == "yes"
    assert fact(findings, theorem, "w'") == "(d + b0*u)/sqrt(d_1)"


def test_the_errors_do_not_see_the_input(findings: Findings) -> None:
    assert fact(findings, "Theorem 1, z and epsilon", "/du") == "0, 0"
    assert figure(findings, "Theorem 1, all signals", "combinations of the states") == 4


def test_the_compensators_cost(findings: Findings) -> None:
    assert round(figure(findings, "compensation", "e^2, with r"), 2) == 9.42
    assert round(figure(findings, "compensation", "e^2, r = 0"), 3) == 0.423
    assert round(figure(findings, "compensation", "largest |e|, with r"), 3) == 2.205
    assert figure(findings, "compensation", "largest |e|, r = 0") == 1.5
    assert round(figure(findings, "compensation", "above 2 % of the first, with r"), 3) == 7.464


def test_the_controller_needs_the_applied_input(findings: Findings) -> None:
    assert fact(findings, "u_M unknown", "whose rates hold u") == "lambda2, r2"
    assert fact(findings, "u_M unknown", "u_assumed") == "0, b0*(u - u_assumed)"


def test_names_with_two_meanings_are_found(findings: Findings) -> None:
    labels = [item.label for item in findings["notation"].evidence]
    assert labels[:3] == ["C_1 is", "C_2 is", "d_1 is"]
    assert {"C_1 and c_1 are one thing", "C_k1 and c_k1 are one thing"} <= set(labels)


def test_what_the_example_leaves_open_is_called_assumed(findings: Findings) -> None:
    assert fact(findings, "Section V", "do not agree") == "none"
    assert fact(findings, "Section V", "y_r is among") == "no"
    assert "assumed" in findings["Section V"].summary
    assert "assumed" in findings["compensation"].reading


def test_every_doubt_says_so(findings: Findings) -> None:
    doubtful = {number for number, item in findings.items() if item.reading.startswith("doubtful")}
    assert doubtful == {"(18)", "(21)", "below (22)", "Section V"}


def test_two_names_for_one_letter_would_be_silent(context: Context) -> None:
    """Without the gains' second spelling and the clashing displays, the notation is clean."""
    kept = {"(9)", "(11)", "(12)", "(13)", "(14)", "(15)"}
    paper = {number: display for number, display in context.paper.items() if number in kept}
    nothing: object = None
    finding = claims.one_name_two_meanings(replace(context, paper=paper), nothing)  # type: ignore[arg-type]
    assert finding.verdict is Verdict.FOLLOWS


@pytest.mark.parametrize("compare", COMPARISONS, ids=lambda compare: compare.__name__)
def test_comparisons_explain_themselves(compare: object) -> None:
    assert compare.__doc__
