"""The physics of the joint: what the paper's own (1)-(4) imply, by substitution and nothing else.

The joint that this project derives and simulates (`pmjoint_derive.balance`) is written independently; the
audit says whether the two agree, and takes a measured joint from the model file ``joint``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import sympy as sp

from pmjoint_codegen.audit.notation import Scope, chain, value
from pmjoint_codegen.audit.paper import Printed
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.workspace import find_model
from pmjoint_derive import real_symbol
from pmjoint_derive.balance import Balance, base_pressure

MEASURED = "joint"  # model file
_POSITIVE = "J b_v r l_0 k_0 k_u u_0 D_max u_M"
_SIGNED = (
    "T P_0 P_1 P_2 F_1 F_2 Delta_P b_1 b_2 C_1 C_2 C_3 C_4 "
    "varepsilon_0 varepsilon_1 varepsilon_2 theta vartheta"
)
_OURS = MappingProxyType(
    {"l0": "l_0", "eps0": "varepsilon_0", "k0": "k_0", "u0": "u_0", "theta_dot": "dot(theta)"}
    | {f"C{i}": f"C_{i}" for i in range(1, 5)}
    | {name: name for name in ("J", "b_v", "r", "k_u", "theta", "u", "vartheta")}
)
_DERIVED = MappingProxyType({"dot(theta)": "dtheta", "ddot(theta)": "ddtheta"})


def joint_symbols() -> Scope:
    """What the symbols of Section II up to (8) stand for: themselves; sizes and factors are positive."""
    symbols = {name: sp.Symbol(name, positive=True) for name in _POSITIVE.split()}
    symbols |= {name: sp.Symbol(name, real=True) for name in _SIGNED.split()}
    return MappingProxyType(symbols | {key: sp.Symbol(name, real=True) for key, name in _DERIVED.items()})


def equation_of_motion(paper: Mapping[str, Printed], scope: Scope) -> sp.Expr:
    """Angular acceleration as (1)-(4) give it.

    Args:
        paper: the printed equations; (1)-(4) and the display of the radii are used.
        scope: symbols of the joint, with u.
    """
    definitions = dict(
        _definitions([line for key in ("(2)", "(3)", "(4)", "radii") for line in paper[key].lines], scope)
    )
    _, inertial, applied = (value(text, scope) for text in chain(paper["(1)"].lines[0])[0])
    balance = inertial - applied
    while balance.free_symbols & definitions.keys():
        balance = balance.xreplace(definitions)
    return sp.expand(sp.solve(balance, scope["ddot(theta)"])[0])


def modelled_acceleration(scope: Scope) -> sp.Expr:
    """The same of the joint that this project derives and simulates, in the printed symbols."""
    P_0, change = base_pressure(), real_symbol("k_u") * real_symbol("u")
    balance = Balance(disturbance=real_symbol("vartheta"))
    acceleration = balance.acceleration(P_0 + change, P_0 - change)
    return sp.expand(acceleration.xreplace({real_symbol(ours): scope[name] for ours, name in _OURS.items()}))


def measured_joint(scope: Scope) -> Mapping[sp.Symbol, sp.Expr]:
    """Printed symbol -> value of the measured joint in the model file ``joint`` (its source stands there).

    Raises:
        ModelError: the file is missing or cannot be read.
    """
    table = read_document(find_model(MEASURED))["joint"]
    return {
        scope[name]: sp.Rational(repr(table[ours]["value"]))
        for ours, name in _OURS.items()
        if isinstance(table.get(ours), dict)
    }


def _definitions(lines: list[str], scope: Scope) -> Iterator[tuple[sp.Symbol, sp.Expr]]:
    """What each line defines: every single name before the last expression, by that expression."""
    for line in lines:
        *defined, meaning = (value(text, scope) for text in chain(line)[0])
        yield from ((symbol, meaning) for symbol in defined if symbol.is_Symbol and symbol != meaning)
