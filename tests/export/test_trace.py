"""The trace names each term's line, and its check reads the C: it sees a wrong line and a wrong term."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from pmjoint_codegen.export.package import TRACE, Export
from pmjoint_codegen.export.trace import trace_faults

SHIPPED = ("paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order")
LEARNERS = ("paper-adaptive", "inverse", "squares", "lag-adaptive")
MODELS = (*SHIPPED, "braking", "chain", "pi", "third-nonlinear", *LEARNERS)


@pytest.mark.parametrize("name", MODELS)
def test_every_term_is_in_one_line_of_one_equation(name: str, exports: Callable[..., Export]) -> None:
    export = exports(name)
    entries = json.loads(export.files[TRACE])
    assert trace_faults(export.program, export.source, entries) == []
    numbers = {entry["number"] for entry in entries}
    assert {"(14)", "(23)", "(24)"} <= numbers
    assert name in LEARNERS or {"(25)", "(29)"} <= numbers  # the law with estimates is not the paper's
    assert all(entry["term"] for entry in entries)


def test_a_term_that_no_line_has_is_missed(exports: Callable[..., Export]) -> None:
    export = exports("paper")
    entries = json.loads(export.files[TRACE])
    for place, entry in enumerate(entries):
        if entry["equation"] in ("v", "z2", "alpha1", "xi1_dot", "r2_dot", "dalpha1_dy"):
            rest = entries[:place] + entries[place + 1 :]
            assert trace_faults(export.program, export.source, rest) != [], entry


def test_a_term_in_two_lines_is_seen(exports: Callable[..., Export]) -> None:
    export = exports("paper")
    entries = json.loads(export.files[TRACE])
    twice = {**entries[-1], "line": entries[-1]["line"] - 1}
    assert any(
        "is in lines" in fault for fault in trace_faults(export.program, export.source, [*entries, twice])
    )


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("- (p->c2 * z2)", "+ (p->c2 * z2)", "v"),
        ("s->y - s->r1 - s->y_r", "s->y - s->r2 - s->y_r", "z1"),
        ("A0[1][0] = -p->k2", "A0[1][0] = -p->k1", "xi2_dot"),
        ("xi2_drive = p->k2 * s->y", "xi2_drive = p->k1 * s->y", "xi2_dot"),
        ("(c->G0[0][1] * xi2_drive)", "(c->G0[1][1] * xi2_drive)", "xi1_next"),
        ("c->v_z1 = p->b0 / (", "c->v_z1 = p->d1 / (", "v"),
        ("c->dalpha1_dXi21 = -p->d1", "c->dalpha1_dXi21 = p->d1", "dalpha1_dXi21"),
    ],
)
def test_c_that_is_not_the_equation_is_seen(
    old: str, new: str, name: str, exports: Callable[..., Export]
) -> None:
    export = exports("paper")
    assert export.source.count(old) == 1
    faults = trace_faults(export.program, export.source.replace(old, new), json.loads(export.files[TRACE]))
    assert any(fault.startswith(f"{name}:") for fault in faults), faults


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        (
            "c->b0_logit_next_pull_b0 * s->pull_b0",
            "c->b0_logit_next_pull_b0 * s->pull_d1",
            "b0_logit_next",
        ),
        ("b0_turn = tanh(s->b0_logit", "b0_turn = tanh(s->d1_logit", "b0_turn"),
        ("+ (s->b0_hat * ((c->Fr[1][2]", "+ (s->d1_hat * ((c->Fr[1][2]", "chi1_next"),
        ("inverse_b0_hat = 1.0 / b0_hat", "inverse_b0_hat = 1.0 / d1_hat", "alpha1"),
        ("tau_b0 = omega_b0 * zeta2", "tau_b0 = omega_d1 * zeta2", "tau_b0"),
    ],
)
def test_an_update_of_estimates_that_is_not_the_equation_is_seen(
    old: str, new: str, name: str, exports: Callable[..., Export]
) -> None:
    export = exports("paper-adaptive")
    assert export.source.count(old) == 1
    faults = trace_faults(export.program, export.source.replace(old, new), json.loads(export.files[TRACE]))
    assert any(fault.startswith(f"{name}:") for fault in faults), faults


@pytest.mark.parametrize("equation", ["b0_logit_next", "b0_hat", "chi1_next", "v", "pull_d1", "alpha_bar"])
def test_a_missing_term_of_the_update_is_seen(equation: str, exports: Callable[..., Export]) -> None:
    export = exports("paper-adaptive")
    entries = json.loads(export.files[TRACE])
    rest = [entry for entry in entries if entry["equation"] != equation]
    assert len(rest) < len(entries)
    faults = trace_faults(export.program, export.source, rest)
    assert any(fault.startswith(f"{equation}: no line has") for fault in faults), faults
