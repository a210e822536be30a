"""What the page knows of one set of kernels, as data for JavaScript."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from pmjoint_codegen.chain import clocked
from pmjoint_codegen.loops.chain import is_looped
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.reference.segments import make_segments
from pmjoint_codegen.report.mathml import equation
from pmjoint_codegen.simulate.blocks import compensator_states
from pmjoint_codegen.simulate.estimates import estimate_columns
from pmjoint_codegen.simulate.pace import leading_terms
from pmjoint_codegen.simulate.settings import default_controller
from pmjoint_codegen.values import filter_gains, from_si, positive_gains

_OPERATORS: Final = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_LAW: Final = re.compile(r"z\d+|alpha\d+|alpha_bar|v|u|du|(r|chi)\d+_dot|Omega|tau_\w+|\w+_(hat|logit)_dot")
_SHOWN: Final = ("Filters", "Estimate", "Adaptation", "Backstepping", "Compensator", "Closed loop")
_HIDDEN: Final = re.compile(r"epsilon\d+|e")

Tree = list[Any] | float | str


def facts_of(manifest: Manifest, folder: Path) -> dict[str, Any]:
    """Names, units, numbers, rules and equations of a model.

    Args:
        manifest: of the kernels.
        folder: holds their ``equations.json``.
    """
    equations = json.loads((folder / "equations.json").read_text(encoding="utf-8"))["equations"]
    derived = _derived(manifest, equations)
    return {
        **{key: getattr(manifest, key) for key in ("n", "m", "rho", "nx", "nw", "title", "source", "limit")},
        "hash": manifest.model_hash,
        "order": {"looped": is_looped(manifest), "clocked": bool(clocked(manifest.chain))},
        "states": [vars(item) for item in manifest.states],
        "signals": [vars(item) for item in manifest.signals],
        "parameters": [
            {
                "name": item.name,
                "value": from_si(item.value, item.scale),
                "unit": item.unit,
                "about": item.about,
                "kind": item.kind,
                "scale": item.scale,
            }
            for item in manifest.settable
        ],
        "own": dict(manifest.own),
        "positive": [*positive_gains(manifest.rho)],
        "filters": [*filter_gains(manifest.n)],
        "rules": [
            {
                "name": rule.name,
                "kind": rule.kind,
                "terms": [tree(item) for item in rule.trees],
                "what": rule.what,
                "allowed": rule.allowed,
            }
            for rule in manifest.rules
        ],
        "leading": tree(leading_terms(manifest)),
        "chain": dict(manifest.chain),
        "limits": list(manifest.limit_parameters),
        "start": {
            "names": list(manifest.start.names),
            "variables": [vars(item) for item in manifest.start.variables],
            "terms": [tree(ast.parse(term, mode="eval").body) for term in manifest.start.terms],
            "guesses": list(manifest.start.guesses),
        },
        "compensator": list(compensator_states(manifest)),
        "estimates": [
            {"name": item.name, "truth": tree(ast.parse(item.truth, mode="eval").body)}
            for item in estimate_columns(manifest)
        ],
        "simulation": _simulation(manifest),
        "reference": _reference(manifest),
        "derived": derived,
        "law": _law(manifest, equations, derived),
    }


def tree(node: ast.expr) -> Tree:
    """Syntax of an expression of parameters as nested lists: ``["+", a, b]``, a number or a name.

    Raises:
        ValueError: for syntax that `pmjoint_codegen.values.evaluate` does not know.
    """
    match node:
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name(id=name):
            return name
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return ["-", 0.0, tree(operand)]
        case ast.BinOp(left=left, op=op, right=right):
            return [_OPERATORS[type(op)], tree(left), tree(right)]
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return [name, tree(argument)]
    raise ValueError(f"not an expression of parameters: {ast.unparse(node)}")


def _simulation(manifest: Manifest) -> dict[str, Any]:
    simulation = manifest.simulation
    return {
        "reference": simulation.reference_text,
        "disturbance": list(simulation.disturbance),
        "x0": list(simulation.x0),
        "horizon": simulation.horizon,
        "output_step": simulation.output_step,
        "sample_time": simulation.sample_time,
        "start": simulation.start,
        "controller": default_controller(manifest),
    }


def _reference(manifest: Manifest) -> dict[str, Any] | None:
    """Break points and segments of a reference that is data."""
    command = manifest.simulation.command
    if command is None:
        return None
    segments = make_segments(command, manifest.rho)
    return {"breaks": segments.breaks.tolist(), "rows": segments.rows.tolist()}


def _derived(manifest: Manifest, equations: Iterable[Mapping[str, str]]) -> list[dict[str, Any]]:
    """Coefficients of the plant that are expressions of parameters alone, in order, with their syntax."""
    known = {item.name for item in manifest.settable}
    found = []
    for item in equations:
        if item["section"] != "Plant" or item["name"] in known:
            continue
        try:
            parsed = ast.parse(item["text"], mode="eval").body
            names = {node.id for node in ast.walk(parsed) if isinstance(node, ast.Name)}
            if not names or not names <= known or item["name"].startswith("D"):
                continue
            found.append({"name": item["name"], "unit": item["unit"], "tree": tree(parsed)})
        except (SyntaxError, ValueError):  # a function of several arguments, or a name that Python keeps
            continue
        known.add(item["name"])
    return found


def _law(
    manifest: Manifest, equations: Iterable[Mapping[str, str]], derived: Iterable[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """The controller's equations as MathML; `main` marks those that make up the law."""
    marked = {item.name for item in manifest.settable} | {item["name"] for item in derived}
    return [
        {
            "name": item["name"],
            "number": item["number"],
            "meaning": item["meaning"],
            "section": item["section"],
            "main": bool(_LAW.fullmatch(item["name"])) and item["section"] != "Filters",
            "math": equation(item["name"], item["text"], marked),
        }
        for item in equations
        if item["section"] in _SHOWN and not _HIDDEN.fullmatch(item["name"])
    ]
