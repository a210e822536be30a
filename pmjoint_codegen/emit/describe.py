"""``model.json``, which describes a derivation and its kernels; ``equations.json``, the derivation only."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import accumulate

import casadi as ca
import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from pmjoint_codegen import __version__
from pmjoint_codegen.chain import LOWER, chain_rules
from pmjoint_codegen.emit.learning_rules import learning_rules
from pmjoint_codegen.emit.loop_table import loop_rows
from pmjoint_codegen.emit.table import Kernel, Made, kernel_table
from pmjoint_codegen.emit.vocabulary import Vocabulary, vocabulary
from pmjoint_codegen.identity import Document, model_hash
from pmjoint_codegen.initial import Start, Variable
from pmjoint_codegen.manifest import (
    ADAPTATION,
    SEGMENT,
    Function,
    GuardRule,
    Manifest,
    Parameter,
    Simulation,
)
from pmjoint_codegen.reference.command import DATA
from pmjoint_codegen.report.notation import plain_text
from pmjoint_codegen.values import ADRC, COMPENSATOR, GAINS, INPUT_SCALE, SI, GainKind, Rule
from pmjoint_derive import Derivation, Model, real_symbol
from pmjoint_derive.adaptation import RHO_HAT, settings_of
from pmjoint_derive.closed_loop import column_name
from pmjoint_derive.signals import Signals
from pmjoint_derive.start import estimate_starts
from pmjoint_derive.units import parse_unit


def tool_versions() -> dict[str, str]:
    """Versions of everything that shapes generated text."""
    return {
        "pmjoint_codegen": __version__,
        "sympy": sp.__version__,
        "casadi": ca.CasadiMeta.version(),
    }


def describe_functions(derivation: Derivation, functions: Mapping[str, ca.Function]) -> tuple[Function, ...]:
    """The kernels as records, with their sizes and operation counts."""
    rows = (*kernel_table(derivation), *loop_rows(functions))
    return tuple(_function(row, functions[row.name]) for row in rows)


def _function(row: Kernel | Made, function: ca.Function) -> Function:
    inputs = tuple((label, int(function.nnz_in(i))) for i, label in enumerate(function.name_in()))
    outputs = tuple((label, int(function.nnz_out(i))) for i, label in enumerate(function.name_out()))
    moves = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
    operations = sum(function.instruction_id(i) not in moves for i in range(function.n_instructions()))
    return Function(row.name, inputs, outputs, row.equation, row.about, operations)


def equations_text(derivation: Derivation) -> str:
    """``equations.json``: every named equation, right-hand sides in Python's notation; no run reads it."""
    rows = [
        {
            "name": item.name,
            "text": plain_text(item.expression),
            "section": item.section,
            "number": item.number,
            "meaning": item.meaning,
            "unit": str(item.unit or ""),
        }
        for item in derivation.equations.values()
    ]
    return json.dumps({"equations": rows}, indent=1, ensure_ascii=False) + "\n"


def describe(
    document: Document,
    derivation: Derivation,
    functions: tuple[Function, ...],
    order: int,
    guards: Mapping[str, GuardRule],
    windows: bool,
    files: Mapping[str, str],
) -> Manifest:
    """The whole manifest.

    Args:
        document: the parsed model file.
        derivation: the derivation from it.
        functions: the emitted kernels.
        order: highest Taylor coefficient.
        guards: the rule of each kind of steps.
        windows: whether one evaluation of the plant's guard serves many holds.
        files: SHA-256 of the other generated files.
    """
    model, plant, words = derivation.model, derivation.plant, vocabulary(derivation)
    simulation = model.simulation
    return Manifest(
        name=model.name,
        title=model.title,
        source=model.source,
        model_hash=model_hash(document),
        versions=tool_versions(),
        n=plant.order,
        m=plant.m,
        rho=plant.rho,
        p=plant.p,
        nx=len(words.x),
        nw=len(words.w),
        order=order,
        limit=str(model.limit),
        chain={key: symbol.name for key, symbol in model.chain.items()},
        leading=plain_text(model.plant.b[0]),
        disturbance_bound=model.disturbance_bound,
        linear=linear_of(model, words),
        kinks=tuple(plain_text(argument) for argument in words.kinks),
        windows=windows,
        guards=guards,
        states=_states(derivation, words),
        start=start_of(derivation, words),
        blocks=_blocks(words),
        parameters=_parameters(derivation),
        chosen=model.chosen,
        rules=rules_of(derivation),
        signals=tuple(_signal(derivation, symbol) for symbol in words.signals),
        partials=tuple(symbol.name for symbol in words.partials),
        functions=functions,
        simulation=Simulation(
            reference=DATA if model.segment else _as_written(document["simulation"]["reference"]),
            disturbance=tuple(plain_text(entry) for entry in model.plant.disturbance),
            x0=(*simulation.x0, *(0.0 for _ in range(len(words.x) - len(simulation.x0)))),
            horizon=simulation.horizon,
            output_step=simulation.output_step,
            sample_time=simulation.sample_time,
            compensator=model.gains.compensator,
            start="matched" if model.gains.matched else "zero",
        ),
        files=dict(files),
    )


def _as_written(expression: str) -> str:
    """The user's own text in one line: SymPy would write ``0.3*(1 - cos(t))`` as ``3/10 - 3*cos(t)/10``."""
    return " ".join(expression.split())


def linear_of(model: Model, words: Vocabulary) -> tuple[str, ...]:
    """The coefficients of a linear plant of two states with one input and a bounded d, `Manifest.linear`."""
    plant, y = model.plant, real_symbol("y")
    if model.adaptation is not None:
        return ()
    if (plant.order, plant.rho, len(words.x), len(words.w)) != (2, 2, 2, 1) or model.start is not None:
        return ()
    unbounded = plant.disturbance[1] != 0 and model.disturbance_bound is None
    if plant.disturbance[0] != 0 or unbounded:
        return ()
    constants = {item.symbol: item.expression for item in model.constants}
    slopes = [sp.diff(entry, y) for entry in plant.drift]
    rest = [sp.expand(entry - slope * y) for entry, slope in zip(plant.drift, slopes, strict=True)]
    found = [*slopes, plant.b[0] * plant.sigma]
    if any(rest) or any(entry.has(y) for entry in found):
        return ()
    return tuple(_python(entry.xreplace(constants)) for entry in found)


def _states(derivation: Derivation, words: Vocabulary) -> tuple[Variable, ...]:
    others = {
        "x": "plant state",
        "r": "compensator state" if derivation.signals.estimates else "compensator state (23)",
        "Theta": "estimate, or its logit",
        "rho": "estimate of 1/b_m",
        "Gamma": "gain of least squares",
    }
    of_filters = "observer state" if derivation.signals.observer else "filter state (14)"
    truths = _truths(derivation)
    return tuple(
        Variable(
            symbol.name,
            str(derivation.units.of(symbol)),
            others.get(block, of_filters),
            truth=truths.get(symbol, ""),
        )
        for block, symbols in words.blocks.items()
        for symbol in symbols
    )


def _truths(derivation: Derivation) -> dict[sp.Symbol, str]:
    """Each estimate and what it estimates, as an expression of the plant's own parameters."""
    model = derivation.model
    if model.adaptation is None:
        return {}
    constants = {item.symbol: item.expression for item in model.constants}
    Theta = [
        entry.xreplace(constants).xreplace(dict(derivation.own_parameters))
        for entry in (*model.plant.b, *model.plant.theta)
    ]
    found = {entry.estimate: Theta[entry.place] for entry in model.adaptation.unknown}
    return {symbol: _python(value) for symbol, value in {**found, RHO_HAT: 1 / Theta[0]}.items()}


def start_of(derivation: Derivation, words: Vocabulary) -> Start:
    """The states in x0, and the plant's states as functions of them and of the plant's own parameters."""
    model = derivation.model
    known = estimate_starts(derivation.design)
    guesses = tuple(known[state].name if known.get(state) else "" for state in words.s)
    if model.start is None:
        own = _states(derivation, words)[: len(words.x)]
        return Start(own, model.plant.order, tuple(state.name for state in own), guesses)
    constants = {item.symbol: item.expression for item in model.constants}
    forms = (model.start.states[state].xreplace(constants) for state in words.x)
    return Start(
        tuple(Variable(item.name, str(item.unit), item.meaning) for item in model.start.variables),
        model.start.required,
        tuple(_python(form.xreplace(dict(derivation.own_parameters))) for form in forms),
        guesses,
    )


def _blocks(words: Vocabulary) -> dict[str, tuple[int, int]]:
    sizes = {block: len(symbols) for block, symbols in words.blocks.items()}
    ends = accumulate(sizes.values())
    return {block: (end - size, end) for (block, size), end in zip(sizes.items(), ends, strict=True)}


def _parameters(derivation: Derivation) -> tuple[Parameter, ...]:
    model, s, units = derivation.model, derivation.signals, derivation.units
    values = derivation.gain_values
    plant = [
        Parameter(item.name, item.value, item.unit, item.about, "plant", item.scale)
        for item in model.parameters
    ]
    design = [
        Parameter(gain.name, float(values[gain]), str(units.of(gain)), f"{_about(kind, s)} {i}", "gain")
        for kind in GAINS
        for i, gain in enumerate(s.gains_by_kind[kind.name], start=1)
    ]
    about = "1: (23) is driven by u - v; 0: r = 0, plain clipping"
    about = "no effect: this law is clipped plainly" if s.observer else about
    switch = Parameter(s.compensator.name, float(model.gains.compensator), "1", about, "switch")
    about = "weight of z_2.. in V: the law is that of the input times this; 1: the paper's"
    about = "no effect on this law" if s.observer else about
    kappa = float(model.gains.input_scale)
    scale = Parameter(s.input_scale.name, kappa, "1", about, "gain", model.measures.input_scale)
    about = "share of the limit of u that the compensator brakes with"
    braking = [
        Parameter(symbol.name, float(model.gains.braking or 0.0), "1", about, "gain") for symbol in s.braking
    ]
    observer = [
        Parameter(symbol.name, float(values[symbol]), "1/s", "all poles of the observer are at -this", "gain")
        for symbol in s.observer
    ]
    own = [
        Parameter(
            derivation.own_parameters[item.symbol].name,
            item.value,
            item.unit,
            f"{item.about}, of the plant",
            "own",
            item.scale,
        )
        for item in model.parameters
        if item.symbol in derivation.own_parameters
    ]
    reference = [
        Parameter(symbol.name, value, "", "of the reference's present segment", SEGMENT)
        for symbol, value in zip(model.segment, segment_defaults(len(model.segment)), strict=True)
    ]
    return (*plant, *design, switch, scale, *braking, *observer, *_adaptation(derivation), *own, *reference)


def _about(kind: GainKind, s: Signals) -> str:
    """What a gain is; its number follows."""
    return "controller pole, its sign changed," if s.observer else kind.about


def _adaptation(derivation: Derivation) -> Iterator[Parameter]:
    """Guesses, and what estimates depend on."""
    for item in settings_of(derivation.model.adaptation, parse_unit(derivation.model.y_unit)):
        unit = "" if item.unit is None else str(item.unit)
        yield Parameter(item.symbol.name, item.value, unit, item.about, ADAPTATION)


def segment_defaults(count: int) -> tuple[float, ...]:
    """Values of a segment's parameters for points of checks: a rate, and coefficients of order one.

    A run replaces them with those of its reference.
    """
    return (0.25, 1.5, *(0.4 / (1 + i) for i in range(count - 2)))[:count]


def rules_of(derivation: Derivation) -> tuple[Rule, ...]:
    """The rules of the physics, also for the plant's own values; then those of the design.

    The design's rules do not apply to the plant's own values: the controller does not know them.
    """
    model, own = derivation.model, dict(derivation.own_parameters)
    found = [
        _positive(item.parameter, item.expression, item.what, twins)
        for twins in ({}, own)
        for item in model.demands
        if not twins or item.expression.free_symbols & own.keys()
    ]
    braking = (symbol.name for symbol in derivation.signals.braking)
    found += [Rule(name, "positive", (name,), "", "a number greater than 0") for name in braking]
    if derivation.signals.braking and LOWER in model.chain:
        lower, upper = (item.name for item in model.limits)
        what, allowed = "braking needs room to both sides of 0", f"{lower} below 0, {upper} above 0"
        found += [Rule(lower, "positive", (f"-{lower}",), what, allowed)]
        found += [Rule(upper, "positive", (upper,), what, allowed)]
    chain = {key: symbol.name for key, symbol in model.chain.items()}
    found += chain_rules(chain, {symbol.name: twin.name for symbol, twin in own.items()})
    found += _reference_rule(model, derivation.plant.rho)
    found += learning_rules(model.adaptation)
    found += [] if model.gains.observer is None else _observer_rules()
    constants = {item.symbol: item.expression for item in model.constants}
    b = tuple(_python(entry.xreplace(constants)) for entry in model.plant.b)
    if len(b) == 1:
        return (*found, Rule("b_m", "nonzero", b, "no input acts", "parameters for which it is not 0"))
    what = "the zero dynamics are unstable: b_m s^m + ... + b_0"
    return (*found, Rule("b_m ... b_0", "hurwitz", b, what, "roots with negative real parts only"))


def _observer_rules() -> list[Rule]:
    """An observer's law has no compensator and no errors to weigh: what belongs to them stays as it is."""
    law = f'law = "{ADRC}"'
    return [
        Rule(COMPENSATOR, "zero", (COMPENSATOR,), f"{law} is clipped plainly", "0 (off)"),
        Rule(INPUT_SCALE, "zero", (f"{INPUT_SCALE} - 1",), f"means nothing to {law}", "the model's own"),
    ]


def _reference_rule(model: Model, rho: int) -> list[Rule]:
    """Assumption 1 where a run starts, as far as parameters decide it; their polynomials are finite."""
    t = real_symbol("t")
    if model.segment:  # data have been checked
        return []
    at_start = (sp.diff(model.reference, t, order).subs(t, 0) for order in range(rho + 1))
    terms = tuple(_python(value) for value in at_start if not value.is_polynomial(*value.free_symbols))
    allowed = f"parameters for which it and its derivatives up to {rho} are finite at t = 0"
    return [Rule("reference", "finite", terms, "", allowed)] if terms else []


def _positive(
    parameter: sp.Symbol, expression: sp.Expr, what: str, twins: Mapping[sp.Symbol, sp.Symbol]
) -> Rule:
    name = twins.get(parameter, parameter).name
    allowed = f"{_python(expression.xreplace(twins))} greater than 0" if what else "a number greater than 0"
    return Rule(name, "positive", (_python(expression.xreplace(twins)),), what, allowed)


def _python(expression: sp.Expr) -> str:
    """An expression of parameters in Python's notation, whole numbers exact."""
    return str(_PythonPrinter({"fully_qualified_modules": False}).doprint(expression))


class _PythonPrinter(PythonCodePrinter):  # type: ignore[misc]  # SymPy carries no types
    def _print_Exp1(self, expr: sp.Expr) -> str:  # noqa: N802 - SymPy's name
        return "exp(1)"  # SymPy writes e, which may be a parameter


def _signal(derivation: Derivation, symbol: sp.Symbol) -> Variable:
    item = derivation.equations[symbol.name]
    name = column_name(derivation.model, symbol)
    truth = _truths(derivation).get(symbol, "")
    measures, s = derivation.model.measures, derivation.signals
    scale = {s.y: measures.y, s.u: measures.u}.get(symbol, SI)
    return Variable(name, str(item.unit) if item.unit else "", item.meaning, scale, truth)
