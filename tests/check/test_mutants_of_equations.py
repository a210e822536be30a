"""Mutants of the derivation: every term of every derived equation, one change at a time, against the proof.

The proof differentiates the errors along the true dynamics; it does not know how the law was found. So a
wrong sign, a lost term or a wrong coefficient anywhere between the filters and v leaves something that does
not expand to zero.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import pytest
import sympy as sp

from pmjoint_codegen.check.gates import proof
from pmjoint_codegen.check.result import GateResult
from pmjoint_codegen.check.subject import Subject
from pmjoint_derive import Derivation, Equations, real_symbol

S = real_symbol
Tally = Callable[[str, str, GateResult], None]
TWINS = {"k1": "k2", "c1": "c2", "e1": "e2", "ck1": "ck2", "xi1": "xi2", "lambda1": "lambda2", "r1": "r2"}


def changes(expression: sp.Expr) -> Iterator[tuple[str, sp.Expr]]:
    """Every change of one term: sign, coefficient, loss; and each symbol taken for its twin."""
    terms = sp.Add.make_args(expression)
    for term in terms:
        rest = expression - term
        yield f"-({term})", rest - term
        yield f"2*({term})", rest + 2 * term
        yield f"without {term}", rest
        yield f"(1 + 1e-12)*({term})", rest + term * (1 + sp.Rational(1, 10**12))
    for one, other in TWINS.items():
        for a, b in ((S(one), S(other)), (S(other), S(one))):
            if a in expression.free_symbols:
                yield f"{b} for {a}", expression.xreplace({a: b})


def deepest(expression: sp.Expr) -> sp.Expr:
    """The sum inside a product or quotient, or the expression itself if there is none."""
    sums = [factor for factor in sp.Mul.make_args(expression) if factor.is_Add]
    return sums[0] if len(sums) == 1 else expression


def with_equation(derivation: Derivation, name: str, expression: sp.Expr) -> Derivation:
    """Return the same derivation with one other right-hand side."""
    items = [
        dataclasses.replace(item, expression=expression) if item.name == name else item
        for item in derivation.equations.values()
    ]
    return dataclasses.replace(derivation, equations=Equations(items))


def mutants(derivation: Derivation, name: str) -> Iterator[tuple[str, Derivation]]:
    """Every mutant of one equation that says something else."""
    expression = derivation.equations[name].expression
    inner = deepest(expression)
    seen = {expression}
    for what, changed in changes(inner):
        mutated = changed if inner is expression else expression.xreplace({inner: changed})
        if sp.expand(mutated - expression) != 0 and mutated not in seen:
            seen.add(mutated)
            yield f"{name}: {what}", with_equation(derivation, name, mutated)


LAW = ("v", "alpha1", "z1", "z2", "Omega", "dalpha1_dy", "dalpha1_dr1", "dalpha1_dxi2", "dalpha1_dXi21")
LOOP = (
    "xi1_dot",
    "xi2_dot",
    "Xi21_dot",
    "lambda1_dot",
    "lambda2_dot",
    "r1_dot",
    "r2_dot",
    "x_hat1",
    "x_hat2",
)
REST = ("y_r", "dy_r", "d2y_r", "D2", "xi1_next", "Xi21_next", "lambda2_next", "r2_next")


@pytest.mark.parametrize("names", [LAW[:1], LAW[1:], LOOP, REST], ids=["v", "design", "loop", "rest"])
def test_every_change_of_an_equation_breaks_the_proof(
    paper: Subject, tally: Tally, names: tuple[str, ...]
) -> None:
    derivation = paper.derivation
    values = proof.design_values(derivation)
    for name in names:
        for what, mutated in mutants(derivation, name):
            tally("proof", what, proof.prove_for(mutated, values))


def test_gains_outside_the_certificate_break_the_proof(paper: Subject, tally: Tally) -> None:
    values = proof.design_values(paper.derivation)
    for name, value in {"c1": 0.0, "e2": -0.1, "ck1": -1.0, "k2": -8.0, "k1": 0.0}.items():
        result = proof.prove_for(paper.derivation, {**values, name: value})
        tally("proof", f"{name} = {value}", result)
