"""What the paper says in words: boundedness, compensation, unknown saturation, and its example."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp

from pmjoint_codegen.audit.context import Context
from pmjoint_codegen.audit.findings import Evidence, Finding, derived_text, yes
from pmjoint_codegen.audit.joint import MEASURED, equation_of_motion, measured_joint
from pmjoint_codegen.audit.judgement import Verdict, difference, vanishes
from pmjoint_codegen.audit.notation import Scope, chain, names, value
from pmjoint_codegen.audit.paper import DESIGN, JOINT
from pmjoint_codegen.audit.runs import Experiments, error_norm, late_peak, peak
from pmjoint_codegen.audit.stability import certificate
from pmjoint_codegen.values import GAINS

_LUMPED = "vartheta/J - b_v/J*dot(theta)"  # what is left of (1)-(4) at theta = 0 and u = 0


def bounded_disturbance(context: Context, made: Experiments) -> Finding:
    """The sentence above (6): d is bounded because the joint's speed is."""
    scope = context.scope(JOINT)
    lumped = value(chain(context.paper["d(t)"].lines[0])[0][1], scope)
    slope = sp.diff(lumped, scope["dot(theta)"])
    rest = dict.fromkeys((scope["theta"], scope["u"]), sp.Integer(0))
    exact = vanishes(lumped - equation_of_motion(context.paper, scope).xreplace(rest))
    mended = vanishes(value(_LUMPED, scope) - equation_of_motion(context.paper, scope).xreplace(rest))
    run = made.undisturbed.beyond
    poles = _damping(context, scope)
    decisive = _number(poles, "right-most") < 0 <= _number(poles, "without")
    return Finding(
        "d(t)",
        context.paper["d(t)"].title,
        Verdict.ASSUMPTION,
        "d holds the damping, so its bound presumes that the speed is bounded, which Theorem 1 is to prove"
        + ("; nor is b_v/J small: it is all the damping that a measured joint has" if decisive else "")
        if slope != 0
        else "d does not depend on the speed",
        context.paper["d(t)"].lines,
        (f"d = {_LUMPED}",) if mended and not exact else (),
        evidence=(
            Evidence("dd/d(speed)", str(slope)),
            *poles,
            Evidence(
                f"largest |x_2| from x_1(0) = {run.settings.x0[0]:.7g}, where the run was stopped",
                peak(run, "x2"),
                "rad/s",
            ),
        ),
    )


def error_boundedness(context: Context, made: Experiments) -> Finding:
    """The half of Theorem 1 that is true: z and epsilon."""
    s, numbers = context.signals, certificate(context)
    rates = {z: context.rate(context.derivation.equations[z.name].expression) for z in s.z}
    laws = {z: rate.xreplace({s.v: context.expand(s.v, law=True)}) for z, rate in rates.items()}
    free = all(vanishes(sp.diff(rate, s.u)) for rate in laws.values())
    names_ = [f"{z}_dot" for z in s.z]
    exact = all(
        vanishes(laws[z] - context.expand(context.derivation.equations[name].expression, law=True))
        for z, name in zip(s.z, names_, strict=True)
    )
    return Finding(
        "Theorem 1, z and epsilon",
        "the errors are bounded",
        Verdict.FOLLOWS if free and exact else Verdict.FAILS,
        "the errors are bounded whatever the saturation does, since u is not in their dynamics"
        if free
        else "the error dynamics contain u",
        derived=derived_text(context, *names_),
        evidence=(
            Evidence(
                "d(z_i')/du, i = 1, 2",
                ", ".join(str(sp.cancel(sp.diff(rate, s.u))) for rate in laws.values()),
            ),
            Evidence("ultimate bound on |z| that V gives (example)", numbers.bound),
            Evidence("largest |z| in the last half of the example's run", error_norm(made.with_compensator)),
            Evidence("largest |z_1| there", late_peak(made.with_compensator, "z1"), "rad"),
        ),
    )


def all_signals_bounded(context: Context, made: Experiments) -> Finding:
    """The other half: x_1 and r_1 run away together while z goes to zero."""
    s = context.signals
    run, clipped = made.undisturbed.beyond, made.clipped
    parameters = run.settings.parameters
    escapes = made.undisturbed.diverging < made.strip and run["x1"][-1] > made.strip
    return Finding(
        "Theorem 1, all signals",
        "all signals are bounded",
        Verdict.FAILS if escapes else Verdict.FOLLOWS,
        f"from x_1(0) = {made.undisturbed.diverging:.2f} rad x_1 and r_1 run away together while z goes to 0,"
        " which V does not see"
        if escapes
        else "no run escapes",
        evidence=(
            Evidence(
                f"largest |x_1| of the example's own run, from x_1(0) = {made.with_compensator['x1'][0]:g}",
                peak(made.with_compensator, "x1"),
                "rad",
            ),
            Evidence("w' - sqrt(d_1) w, for w = x_1 + x_2/sqrt(d_1)", _escape(context)),
            Evidence("so no input holds the joint beyond b_0 u_M/d_1", made.strip, "rad"),
            Evidence("and, with the disturbance against it, (b_0 u_M - D_max)/d_1", made.sure_strip, "rad"),
            Evidence("paper's law, no disturbance: bounded from", made.undisturbed.bounded, "rad"),
            Evidence("paper's law, no disturbance: diverging from", made.undisturbed.diverging, "rad"),
            Evidence("paper's law with (37): bounded from", made.disturbed.bounded, "rad"),
            Evidence("paper's law with (37): diverging from", made.disturbed.diverging, "rad"),
            Evidence("same law, r = 0 (plain clipping): bounded from", clipped.bounded, "rad"),
            Evidence("same law, r = 0 (plain clipping): diverging from", clipped.diverging, "rad"),
            Evidence("all this needs d_1 > 0, as in the example", parameters["d1"], "1/s^2"),
            Evidence("the diverging run was stopped at", float(run.t[-1]), "s"),
            Evidence("x_1 there", float(run["x1"][-1]), "rad"),
            Evidence("r_1 there", float(run["r1"][-1]), "rad"),
            Evidence("z_1 = x_1 - y_r - r_1 there is below 1e-6", yes(abs(run["z1"][-1]) < 1e-6)),
            Evidence(
                "z and epsilon, which V_2 bounds, are independent combinations of the states in number",
                _seen(context),
            ),
            Evidence("of so many states", float(len((*s.x, *s.controller_state)))),
        ),
    )


def compensation(context: Context, made: Experiments) -> Finding:
    """Section VI: what compensation is, and what it costs in the example."""
    with_, without = made.with_compensator.summary, made.without.summary
    identity = vanishes(context.value("y - y_r - (z_1 + r_1)"))
    dearer = with_["ise"] > without["ise"]
    verdict = Verdict.CORRECTED if identity and dearer else Verdict.FOLLOWS
    return Finding(
        "compensation",
        "saturation is compensated successfully",
        verdict,
        "compensated in z_1, not in the tracking error z_1 + r_1: in the example r makes tracking slower"
        if dearer
        else "compensated",
        corrected=("y - y_r = z_1 + r_1",) if dearer else (),
        reading=f"the example's {_assumed(made)} are assumed; the paper states neither",
        evidence=tuple(
            Evidence(f"{label}, {name}", float(summary[key]), unit)
            for key, label, unit in (
                ("ise", "integral of e^2", "rad^2 s"),
                ("max_abs_e", "largest |e|", "rad"),
                ("settling_s", "last |e| above 2 % of the first", "s"),
            )
            for name, summary in (("with r", with_), ("r = 0", without))
        ),
    )


def unknown_saturation(context: Context, made: Experiments) -> Finding:
    """(10) calls u_M unknown; the controller needs the applied u."""
    s, equations = context.signals, context.derivation.equations
    reading = [
        state.name
        for state in s.controller_state
        if s.u in context.expand(equations[f"{state}_dot"].expression).free_symbols
    ]
    assumed = sp.Symbol("u_assumed", real=True)
    rate = {state: equations[f"{state}_dot"].expression for state in s.lambda_}
    wrong = {state: context.expand(entry).xreplace({s.u: assumed}) for state, entry in rate.items()}
    right = {state: context.expand(entry) for state, entry in rate.items()}
    shifts = [_shift(context, estimate, right, wrong) for estimate in ("x_hat1", "x_hat2")]
    needed = bool(reading)
    return Finding(
        "u_M unknown",
        "the saturation is unknown",
        Verdict.CORRECTED if needed else Verdict.FOLLOWS,
        "u_M may be unknown only where the applied u is measured: the filters and Delta u need it"
        if needed
        else "no controller state needs u",
        evidence=(
            Evidence("controller states whose rates hold u", ", ".join(reading)),
            Evidence(
                "epsilon' - (A_0 epsilon + D) when they are fed with u_assumed", ", ".join(map(str, shifts))
            ),
        ),
    )


def adaptive_title(context: Context, made: Experiments) -> Finding:
    """The title of Section III: an update law is a controller state that a tracking error drives."""
    s, equations = context.signals, context.derivation.equations
    driven = [
        state.name
        for state in s.controller_state
        if set(s.y_r) & context.expand(equations[f"{state}_dot"].expression).free_symbols
    ]
    law = context.expand(s.v, law=True).free_symbols
    needed = [item.name for item in context.derivation.model.parameters if item.symbol in law]
    return Finding(
        "Section III",
        "design of adaptive controllers",
        Verdict.FOLLOWS if driven else Verdict.CORRECTED,
        "some controller state adapts"
        if driven
        else "nothing adapts: every parameter of the law is known, and no controller state estimates one",
        evidence=(
            Evidence("parameters that the law needs", ", ".join(needed)),
            Evidence("controller states that the tracking error drives", ", ".join(driven) or "none"),
        ),
    )


def smooth_reference(context: Context, made: Experiments) -> Finding:
    """Assumption 1: the law's need of the reference's derivatives."""
    law = context.expand(context.signals.v, law=True)
    orders = [order for order, symbol in enumerate(context.signals.y_r) if symbol in law.free_symbols]
    return Finding(
        "Assumption 1",
        "the reference and its first two derivatives are bounded",
        Verdict.ASSUMPTION,
        "exactly what the law asks for" if max(orders) == 2 else "not what the law asks for",
        evidence=(Evidence("orders of the derivatives of y_r in the law", ", ".join(map(str, orders))),),
    )


def example_numbers(context: Context, made: Experiments) -> Finding:
    """Section V's numbers against the model file and the run, and what it does not say."""
    display = context.paper["Section V"]
    known = _example_scope(context, made)
    wrong = [line for line in display.lines if not _agrees(line, known)]
    said = {
        name
        for number in ("(36)", "(37)", "Section V")
        for line in context.paper[number].lines
        for name in names(line)
    }
    return Finding(
        "Section V",
        display.title,
        Verdict.FAILS if wrong else Verdict.ASSUMPTION,
        f"the example can be run as stated but for y_r and the horizon; {_assumed(made)} are assumed"
        if not wrong
        else "the model file has other numbers",
        display.lines,
        reading="doubtful: the figures, which the copy read lacks, may show what the text leaves out",
        evidence=(
            Evidence("lines that the model file and the run do not agree with", ", ".join(wrong) or "none"),
            Evidence("y_r is among the symbols of Section V", yes("y_r" in said)),
            Evidence("largest |x_1| of the example's run", peak(made.with_compensator, "x1"), "rad"),
            Evidence("largest |v|", float(made.with_compensator.summary["max_abs_v"]), "V"),
            Evidence("time at a limit", float(made.with_compensator.summary["saturated_s"]), "s"),
        ),
    )


def one_name_two_meanings(context: Context, made: Experiments) -> Finding:
    """Clashes in the symbol table of the printed equations."""
    meanings, spellings = _symbol_table(context)
    clashes = {name: found for name, found in meanings.items() if len(found) > 1}
    doubles = {meaning: found for meaning, found in spellings.items() if len(found) > 1}
    facts = [
        Evidence(
            f"{name} is", "; ".join(f"{meaning} in {', '.join(where)}" for meaning, where in found.items())
        )
        for name, found in clashes.items()
    ]
    facts += [Evidence(f"{' and '.join(found)} are one thing", meaning) for meaning, found in doubles.items()]
    return Finding(
        "notation",
        "one name, one meaning",
        Verdict.CORRECTED if clashes or doubles else Verdict.FOLLOWS,
        f"{', '.join(clashes)} mean two things each, and gains are written with two letters;"
        " here C_i are muscle constants, c_i gains, d_1 the plant's"
        if clashes
        else "every name has one meaning",
        evidence=tuple(facts),
    )


def _damping(context: Context, scope: Scope) -> tuple[Evidence, ...]:
    """``b_v/J`` of the measured joint beside the rates that it would have to be small against."""
    numbers = measured_joint(scope)
    rate = (scope["b_v"] / scope["J"]).xreplace(dict(numbers))
    rest = equation_of_motion(context.paper, scope).coeff(scope["u"], 0).coeff(scope["theta"], 1)
    stiffness = rest.xreplace(dict(numbers))
    example = value("d_1", context.scope(DESIGN)).xreplace(dict(context.numbers()))
    where = f"measured joint (model {MEASURED})"
    return tuple(
        Evidence(label, float(sp.N(figure)), "1/s")
        for label, figure in (
            (f"{where}: b_v/J", rate),
            (f"{where}: sqrt(|d_1|)", sp.sqrt(sp.Abs(stiffness))),
            (f"{where}: right-most open-loop pole", _rightmost(rate, stiffness)),
            (f"{where}: the same without the damping", _rightmost(sp.Integer(0), stiffness)),
            ("sqrt(d_1) of the example", sp.sqrt(example)),
        )
    )


def _number(facts: tuple[Evidence, ...], label: str) -> float:
    return next(float(item.value) for item in facts if label in item.label)


def _rightmost(damping: sp.Expr, stiffness: sp.Expr) -> sp.Expr:
    """Largest real part of the roots of ``s^2 + damping s - stiffness``."""
    root = sp.sqrt(damping**2 + 4 * stiffness)
    return sp.Max(*(sp.re((sign * root - damping) / 2) for sign in (1, -1)))


def _assumed(made: Experiments) -> str:
    """What the example's run was made with and the paper does not state."""
    run = made.with_compensator
    return f"y_r = {run.manifest.simulation.reference} and {run.settings.horizon:g} s"


def _seen(context: Context) -> float:
    """Rank of (z, epsilon) as a function of the closed loop's state: how many directions V_2 sees."""
    s = context.signals
    seen = sp.Matrix([context.expand(symbol) for symbol in (*s.z, *s.epsilon)])
    return float(seen.jacobian(sp.Matrix([*s.x, *s.controller_state])).rank())


def _escape(context: Context) -> str:
    """``w' - sqrt(d_1) w`` for ``w = x_1 + x_2/sqrt(d_1)``, d_1 > 0."""
    positive = sp.Symbol("d_1", positive=True)
    x_1, x_2 = context.signals.x
    w = x_1 + x_2 / sp.sqrt(positive)
    rates = [
        context.rate(state).xreplace({value("d_1", context.scope(DESIGN)): positive}) for state in (x_1, x_2)
    ]
    rate = sum(
        (sp.diff(w, state) * rate for state, rate in zip((x_1, x_2), rates, strict=True)), sp.Integer(0)
    )
    return str(sp.factor(sp.expand(rate - sp.sqrt(positive) * w))).replace("D2", "d")


def _shift(
    context: Context, estimate: str, right: Mapping[sp.Symbol, sp.Expr], wrong: Mapping[sp.Symbol, sp.Expr]
) -> sp.Expr:
    """How a wrong u in the filters enters the rate of one estimation error."""
    expression = context.expand(sp.Symbol(estimate, real=True))
    return sp.factor(
        sum((sp.diff(expression, state) * (right[state] - wrong[state]) for state in right), sp.Integer(0))
    )


def _example_scope(context: Context, made: Experiments) -> dict[str, Any]:
    """Printed names of Section V -> the numbers of the model file and of the run's first instant."""
    scope, numbers = context.scope(DESIGN), dict(context.numbers())
    known: dict[str, Any] = {}
    for name in (
        name for line in context.paper["Section V"].lines for name in names(line) if "(" not in name
    ):
        known[name] = scope[name].xreplace(numbers)
    run = made.with_compensator
    for name in ("x_1", "x_2", "r_1", "r_2"):
        known[f"{name}(0)"] = sp.nsimplify(float(run[name.replace("_", "")][0]))
    for name, stem in (("xi", "xi"), ("Xi", "Xi"), ("lamda", "lambda")):
        columns = [column for column in run.columns if column.rstrip("0123456789") == stem]
        known[f"{name}(0)"] = sp.nsimplify(max(abs(float(run[column][0])) for column in columns))
    return known


def _agrees(line: str, known: Mapping[str, Any]) -> bool:
    *said, number = (value(text, known) for text in chain(line)[0])
    return all(vanishes(difference(number, item)) for item in said)


def _symbol_table(context: Context) -> tuple[dict[str, dict[str, list[str]]], dict[str, list[str]]]:
    """Printed name -> meaning -> displays, and meaning -> printed names, for names of one symbol."""
    meanings: dict[str, dict[str, list[str]]] = {}
    spellings: dict[str, list[str]] = {}
    defined = {line for display in context.paper.values() for line in display.lines}
    for number, display in context.paper.items():
        scope = context.scope(display.scope)
        for name in (name for line in display.lines for name in names(line) if name.isidentifier()):
            symbol = scope.get(name)
            if not isinstance(symbol, sp.Symbol):
                continue
            meaning = _meaning(symbol, display.scope)
            places = meanings.setdefault(name, {}).setdefault(meaning, [])
            if number not in places:
                places.append(number)
            spelled = spellings.setdefault(meaning, [])
            equated = any(f"{name} = {other}" in defined for other in spelled)
            if name not in spelled and not equated:
                spelled.append(name)
    return meanings, spellings


def _meaning(symbol: sp.Symbol, scope: str) -> str:
    """What a symbol is, in words that tell clashing ones apart."""
    name = symbol.name
    if name.endswith("_Young"):
        return f"the free letter {name.removesuffix('_Young')} of Young's inequality"
    if scope == JOINT and name.startswith("C_"):
        return f"the muscle constant {name}"
    stem, index = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
    kind = next((kind for kind in GAINS if kind.name == stem), None)
    if kind and index:
        return f"the filter gain {kind.latex}_{index}" if kind.of_filters else f"the gain {kind.latex}{index}"
    return {"d1": "the plant's d_1 (8)", "b0": "the plant's b_0 (8)"}.get(name, f"the signal {name}")
