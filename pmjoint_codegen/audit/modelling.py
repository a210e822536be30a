"""Section II and the system of Section V, from torque balance to simulated plant: (1)-(11), (36), (37)."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

from pmjoint_codegen.audit.context import Context, disturbance_symbol
from pmjoint_codegen.audit.findings import Case, Evidence, Finding, Remedy, derived_text, joint, yes
from pmjoint_codegen.audit.joint import MEASURED, equation_of_motion, measured_joint, modelled_acceleration
from pmjoint_codegen.audit.judgement import Verdict, vanishes
from pmjoint_codegen.audit.notation import chain, value
from pmjoint_codegen.audit.paper import JOINT
from pmjoint_codegen.report.notation import text_expression

_ONE_FACTOR = ("k_0*k_u", "k_u")
_QUADRATIC_GAIN = ("+ C_3)", "+ C_3 + C_1*(r*l_0**-1*theta)**2)")
_PER_INERTIA = ("+ vartheta", "+ 1/J*vartheta")


def torque_balance(context: Context) -> Finding:
    """(1)."""
    scope = context.scope(JOINT)
    _, inertial, applied = (value(text, scope) for text in chain(context.paper["(1)"].lines[0])[0])
    forces = _forces(context)
    slope = sp.diff(applied.xreplace(forces), scope["C_4"])
    return _assumed(
        context,
        "(1)",
        "where everything starts: inertia and viscous damping against two muscles and a disturbance",
        Evidence(
            "acceleration enters linearly, with coefficient", str(sp.diff(inertial, scope["ddot(theta)"]))
        ),
        Evidence("C_4 enters the torque with coefficient", str(slope)),
        Evidence("and with one radius, b_1 = b_2 = r, with", str(slope.xreplace(_radii(context)))),
    )


def muscle_forces(context: Context) -> Finding:
    """(2)."""
    forces = _forces(context)
    pressures = [context.scope(JOINT)[name] for name in ("P_1", "P_2")]
    orders = [
        sp.Poly(force, pressure).degree() for force, pressure in zip(forces.values(), pressures, strict=True)
    ]
    return _assumed(
        context,
        "(2)",
        "a static muscle: force is pressure times a quadratic in the contraction rate",
        Evidence("degree of the forces in their pressures", str(orders)),
    )


def contraction_rates(context: Context) -> Finding:
    """(3)."""
    scope = context.scope(JOINT)
    one, two = (value(chain(line)[0][1], scope) for line in context.paper["(3)"].lines)
    return _assumed(
        context,
        "(3)",
        "geometry: one muscle shortens by what the other is stretched",
        Evidence("varepsilon_1 + varepsilon_2", str(sp.expand(one + two))),
    )


def pressures(context: Context) -> Finding:
    """(4): both printed forms agree, and pressures that stay positive bound the input."""
    scope = context.scope(JOINT)
    forms = [[value(text, scope) for text in chain(line)[0][1:]] for line in context.paper["(4)"].lines]
    unknown = scope["P_0"], scope["Delta_P"]
    (agreed,) = sp.solve([first - second for first, second in forms], unknown, dict=True)
    (emptied,) = sp.solve(forms[1][1], scope["u"])
    return _assumed(
        context,
        "(4)",
        "pressures proportional to voltages; k_0 multiplies u_0 only, which (5) loses sight of",
        *(Evidence(f"the two forms agree for {symbol}", str(meaning)) for symbol, meaning in agreed.items()),
        Evidence("dP_1/du", str(sp.diff(forms[0][1], scope["u"]))),
        Evidence("the second muscle is empty at u", str(emptied)),
    )


def equation_of_motion_printed(context: Context) -> Finding:
    """(5) against (1)-(4)."""
    scope = context.scope(JOINT)
    derived = equation_of_motion(context.paper, scope)
    return Case(
        context,
        "(5)",
        calm="exactly what (1)-(4) give",
        corrected="stiffness and damping are right; the input gain has a factor k_0 too many and lacks"
        " C_1 (r theta/l_0)^2, and the disturbance is not divided by J",
        setting=joint(context, {scope["ddot(theta)"]: derived}),
        remedy=Remedy((_ONE_FACTOR, _QUADRATIC_GAIN, _PER_INERTIA)),
        derived=(f"ddot(theta) = {text_expression(_collected(derived, scope))}",),
    ).judged(
        *_terms(context, derived),
        Evidence(
            "the joint that is derived and simulated here obeys the derived form",
            yes(vanishes(derived - modelled_acceleration(scope))),
        ),
    )


def damping_moved(context: Context) -> Finding:
    """The display below (5): (5) with the damping hidden in d."""
    scope = context.scope(JOINT)
    meaning = {scope["ddot(theta)"]: _right_side(context, "(5)"), scope["d"]: _right_side(context, "d(t)")}
    return Case(
        context,
        "below (5)",
        calm="(5) as printed, with the damping and the disturbance gathered in d(t)",
        setting=joint(context, meaning),
    ).judged()


def states(context: Context) -> Finding:
    """(6)."""
    scope = context.scope(JOINT)
    meaning = {scope["x_1"]: scope["theta"], scope["x_2"]: scope["dot(theta)"]}
    return Case(
        context, "(6)", calm="names the states", otherwise=Verdict.DEFINITION, setting=joint(context, meaning)
    ).judged()


def system_model(context: Context) -> Finding:
    """(7) from the display below (5), with (6) and (8)."""
    scope = context.scope(JOINT)
    angle, speed = scope["theta"], scope["dot(theta)"]
    meaning = {scope["x_1"]: angle, scope["x_2"]: speed, scope["y"]: angle, scope["dot(x_1)"]: speed}
    meaning |= {scope["dot(x_2)"]: _right_side(context, "below (5)")}
    meaning |= {scope["b_0"]: _right_side(context, "(8)", 0), scope["d_1"]: _right_side(context, "(8)", 1)}
    return Case(
        context,
        "(7)",
        calm="follows from the display below (5) with (6) and (8), and inherits what these lack",
        setting=joint(context, meaning),
    ).judged()


def constants(context: Context) -> Finding:
    """(8) against the coefficients that (1)-(4) give."""
    scope = context.scope(JOINT)
    derived = equation_of_motion(context.paper, scope)
    angle, u = scope["theta"], scope["u"]
    gain = sp.diff(derived, u)
    meaning = {
        scope["b_0"]: gain.xreplace({angle: sp.Integer(0)}),
        scope["d_1"]: derived.coeff(u, 0).coeff(angle, 1),
    }
    ratio = sp.factor(_right_side(context, "(8)", 0) / meaning[scope["b_0"]])
    varying = sp.factor((gain - meaning[scope["b_0"]]) / angle**2)
    return Case(
        context,
        "(8)",
        calm="the coefficients that (1)-(4) give at theta = 0",
        corrected="d_1 is right; b_0 has a factor k_0 too many, and is the input gain at theta = 0 only",
        setting=joint(context, meaning),
        remedy=Remedy((_ONE_FACTOR,)),
        derived=tuple(f"{symbol} = {text_expression(sp.factor(entry))}" for symbol, entry in meaning.items()),
    ).judged(
        Evidence("printed b_0 over derived b_0", str(ratio)),
        Evidence("what the gain gains with theta^2", str(varying)),
        Evidence(
            "d_1 < 0 for an ideal braid, whatever its contraction",
            yes(_ideal_muscle(meaning[scope["d_1"]], scope)),
        ),
        *_measured(context, gain, meaning[scope["d_1"]]),
    )


def disturbance_bound(context: Context) -> Finding:
    """(9), tried on the example's disturbance (37)."""
    model = context.derivation.model
    return _assumed(
        context,
        "(9)",
        "an assumption, which the example's disturbance satisfies",
        Evidence("largest value of (37)", float(_amplitude(context)), "rad/s^2"),
        Evidence("D_max used here for the example", model.disturbance_bound or 0.0, "rad/s^2"),
    )


def saturation(context: Context) -> Finding:
    """(10): two points on each of the three straight pieces decide."""
    display, s = context.paper["(10)"], context.signals
    limit = context.derivation.model.limit
    printed = value(chain(display.lines[0])[0][-1], context.scope("design"))
    derived = context.derivation.equations["u"].expression
    points = [sp.Rational(number, 2) for number in (-5, -3, -1, 1, 3, 5)]
    same = all(
        printed.subs({limit: 1, s.v: point}) == derived.subs({limit: 1, s.v: point}) for point in points
    )
    return Finding(
        "(10)",
        display.title,
        Verdict.DEFINITION if same else Verdict.FAILS,
        "clipping at plus and minus u_M" if same else "is not what clipping at plus and minus u_M means",
        display.lines,
        derived=derived_text(context, "u"),
    )


def saturated_system(context: Context) -> Finding:
    """(11)."""
    return Case(
        context,
        "(11)",
        calm="(7) with (10), and the plant that is derived from and simulated",
        derived=derived_text(context, "x1_dot", "x2_dot"),
    ).judged()


def simulated_system(context: Context) -> Finding:
    """(36): (11) again; its numbers make an unstable plant."""
    stiffness = value("d_1", context.scope("design")).xreplace(dict(context.numbers()))
    pole = sp.sqrt(stiffness)
    unstable = "unstable, which makes the example a hard one" if sp.re(pole) > 0 else "stable"
    calm = f"(11) again; with d_1 = {float(stiffness):g} the open loop is {unstable}"
    return Case(context, "(36)", calm).judged(
        Evidence("right-most open-loop pole", float(sp.re(pole)), "1/s")
    )


def simulated_disturbance(context: Context) -> Finding:
    """(37) against the disturbance that is simulated here."""
    s = context.signals
    simulated = context.derivation.model.plant.disturbance[1]
    printed = value(chain(context.paper["(37)"].lines[0])[0][1], {"x_2": s.x[1], "t": s.t})
    same = vanishes(printed - simulated)
    return Finding(
        "(37)",
        context.paper["(37)"].title,
        Verdict.DEFINITION if same else Verdict.FAILS,
        "smooth, and bounded as (9) asks" if same else "is not what the model file simulates",
        context.paper["(37)"].lines,
        derived=derived_text(context, "D2"),
        evidence=(Evidence("largest value", float(_amplitude(context)), "rad/s^2"),),
    )


def _assumed(context: Context, number: str, summary: str, *evidence: Evidence) -> Finding:
    display = context.paper[number]
    return Finding(number, display.title, Verdict.ASSUMPTION, summary, display.lines, evidence=evidence)


def _right_side(context: Context, number: str, line: int = 0) -> sp.Expr:
    """Last expression of a printed line of the physical part."""
    return value(chain(context.paper[number].lines[line])[0][-1], context.scope(JOINT))


def _forces(context: Context) -> Mapping[sp.Symbol, sp.Expr]:
    scope = context.scope(JOINT)
    sides = (chain(line)[0] for line in context.paper["(2)"].lines)
    return {value(left, scope): value(right, scope) for left, right in sides}


def _radii(context: Context) -> dict[sp.Symbol, sp.Expr]:
    scope = context.scope(JOINT)
    return {scope[name]: scope["r"] for name in ("b_1", "b_2")}


def _collected(motion: sp.Expr, scope: Mapping[str, sp.Expr]) -> sp.Expr:
    """The equation of motion, one term each for damping, stiffness, input and disturbance."""
    parts = (scope["dot(theta)"], scope["u"], scope["vartheta"])
    driven = sum((sp.factor(sp.diff(motion, part)) * part for part in parts), sp.Integer(0))
    return driven + sp.factor(motion.xreplace(dict.fromkeys(parts, sp.Integer(0))))


def _terms(context: Context, derived: sp.Expr) -> tuple[Evidence, ...]:
    """Printed over derived, term by term of the equation of motion."""
    scope = context.scope(JOINT)
    printed = sp.expand(_right_side(context, "(5)"))
    angle, u = scope["theta"], scope["u"]
    at_rest = {angle: sp.Integer(0)}
    pairs = {
        "damping": [sp.diff(side, scope["dot(theta)"]) for side in (printed, derived)],
        "stiffness": [side.coeff(u, 0).coeff(angle, 1) for side in (printed, derived)],
        "input gain at theta = 0": [sp.diff(side, u).xreplace(at_rest) for side in (printed, derived)],
        "disturbance": [sp.diff(side, scope["vartheta"]) for side in (printed, derived)],
    }
    ratios = [
        Evidence(f"{name}: printed over derived", str(sp.cancel(one / two)))
        for name, (one, two) in pairs.items()
    ]
    missing = sp.factor(sp.diff(derived - printed, u).coeff(angle, 2))
    return (*ratios, Evidence("coefficient of theta^2 u that the print lacks", str(missing)))


def _measured(context: Context, gain: sp.Expr, stiffness: sp.Expr) -> tuple[Evidence, ...]:
    """Numbers of a measured joint: both constants, the printed gain, and what the missing term is worth."""
    scope = context.scope(JOINT)
    numbers, angle = measured_joint(scope), scope["theta"]
    at_rest, turned = (float(gain.xreplace({**numbers, angle: sp.Integer(place)})) for place in (0, 1))
    printed = float(_right_side(context, "(8)", 0).xreplace(dict(numbers)))
    where = f"measured joint (model {MEASURED})"
    return (
        Evidence(f"{where}: d_1", float(stiffness.xreplace(dict(numbers))), "1/s^2"),
        Evidence(f"{where}: derived b_0", at_rest, "rad/(s^2 V)"),
        Evidence(f"{where}: b_0 as printed, in these units", printed),
        Evidence(f"{where}: input gain at 1 rad over that at 0", turned / at_rest),
    )


def _ideal_muscle(stiffness: sp.Expr, scope: Mapping[str, sp.Expr]) -> bool:
    """Whether d_1 < 0 for an ideal braid, ``F = P A (a (1 - eps)^2 - b)``, for all a, b, A > 0 and eps < 1.

    The law is Chou and Hannaford's (1996); the paper gives no muscle constants of its own.
    """
    a, area, remaining = sp.symbols("a A_m left", positive=True)  # left: 1 - eps_0
    constants = {scope["C_1"]: a * area, scope["C_2"]: -2 * a * area, scope["varepsilon_0"]: 1 - remaining}
    return bool(sp.factor(stiffness.subs(constants)).is_negative)


def _amplitude(context: Context) -> sp.Expr:
    """Largest value of the simulated disturbance: sines and cosines at one."""
    expression = context.derivation.equations[disturbance_symbol().name].expression
    return sp.Abs(expression.replace(lambda node: node.func in (sp.sin, sp.cos), lambda node: sp.Integer(1)))
