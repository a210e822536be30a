"""A derivation as one document of plain values, for other programs."""

from __future__ import annotations

from collections.abc import Iterable

from pmjoint_codegen.report.notation import latex_expression, latex_name, text_expression
from pmjoint_codegen.report.sections import own_parameters
from pmjoint_codegen.values import from_si
from pmjoint_derive.equation import Equation
from pmjoint_derive.model import Model


def derivation_record(model: Model, equations: Iterable[Equation]) -> dict[str, object]:
    """Give a derivation as mappings, lists, strings and numbers.

    Args:
        model: what was derived from.
        equations: the derivation, in its order.
    """
    plant, gains, known = model.plant, model.gains, tuple(equations)
    return {
        "model": model.name,
        "title": model.title,
        "source": model.source,
        "order": plant.order,
        "zeros": plant.m,
        "relative_degree": plant.rho,
        "parameters": [
            {
                "name": item.name,
                "latex": latex_name(item.name),
                "value": from_si(item.value, item.scale),
                "unit": item.unit,
                "about": item.about,
            }
            for item in model.parameters
        ],
        "gains": {kind: list(values) for kind, values in gains.by_kind.items()},
        "compensator": gains.compensator,
        "input_scale": from_si(gains.input_scale, model.measures.input_scale),
        "braking": gains.braking,
        **({} if gains.observer is None else {"observer": gains.observer}),
        "start": "matched" if gains.matched else "zero",
        "true_plant": own_parameters(model, known),
        "equations": [equation_record(equation) for equation in known],
    }


def equation_record(equation: Equation) -> dict[str, str | None]:
    """Give one equation with its expression as text and as LaTeX; the unit is null where there is none."""
    return {
        "name": equation.name,
        "section": equation.section,
        "number": equation.number,
        "meaning": equation.meaning,
        "unit": None if equation.unit is None else str(equation.unit),
        "symbol": latex_name(equation.name),
        "expression": text_expression(equation.expression),
        "latex": latex_expression(equation.expression),
    }
