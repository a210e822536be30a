r"""Printed mathematics as text: one source for its meaning (SymPy) and its looks (LaTeX, in printed order).

A line is a chain ``dot(V_1) = z_1*dot(z_1) + ... <= ...`` in Python's syntax with the paper's symbols:
``C_k1`` is printed :math:`C_{k1}`, ``v_0_2`` is :math:`v_{0,2}`, ``lamda`` is :math:`\lambda` (the right
spelling is a word of Python's). Accents and derivatives are calls: ``dot(x_1)``, ``hat(x)``,
``partial(alpha_1, y)``. They, and calls such as ``V_2(0)``, are names of their own; only the operations
below compute.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

import sympy as sp

Scope = Mapping[str, Any]
Operation = Callable[..., Any]

_RELATION = re.compile(r"\s(<=|=)\s")
_GREEK = frozenset(
    [
        "alpha",
        "epsilon",
        "varepsilon",
        "lambda",
        "theta",
        "vartheta",
        "xi",
        "omega",
        "Delta",
        "Theta",
        "Phi",
        "Xi",
    ]
)
_GLYPHS = MappingProxyType(
    {
        "Delta_P": r"\Delta P",
        "Delta_u": r"\Delta u",
        "f_minus": "f_{-}",
        "f_plus": "f_{+}",
        "Xi_A2": r"\Xi_{A_2}",
        "sat": r"\mathrm{sat}",
    }
)
_PRECEDENCE = MappingProxyType({ast.Add: 1, ast.Sub: 1, ast.Mult: 2, ast.Div: 2, ast.Pow: 4})


def chain(line: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split a printed line at its relations.

    Returns:
        the expressions, and the relations (``=`` or ``<=``) between them; one expression more than relations.
    """
    expressions, relations, start = [], [], 0
    for match in _RELATION.finditer(line):
        before = line[: match.start()]
        if before.count("(") == before.count(")"):  # a relation inside brackets is a condition of `cases`
            expressions.append(line[start : match.start()])
            relations.append(match.group(1))
            start = match.end()
    return (*expressions, line[start:]), tuple(relations)


def value(text: str, scope: Scope) -> Any:
    """Evaluate one printed expression.

    Args:
        text: the expression, without a relation.
        scope: what every printed name stands for: SymPy expressions and matrices.

    Raises:
        KeyError: a name that the scope does not hold.
        TypeError: sizes that do not fit, such as a number plus a vector.
        SyntaxError: text that is no expression.
    """
    return _evaluate(ast.parse(text, mode="eval").body, scope)


def names(text: str) -> tuple[str, ...]:
    """The printed names in a line, in order, each once."""
    found: dict[str, None] = {}
    for expression in chain(text)[0]:
        found |= dict.fromkeys(_names(ast.parse(expression, mode="eval").body))
    return tuple(found)


def latex(line: str) -> tuple[str, ...]:
    """A printed line as LaTeX in printed order: the left side, then each relation with its right side."""
    expressions, relations = chain(line)
    signs = ("", *(r"\le " if relation == "<=" else "= " for relation in relations))
    return tuple(
        sign + _typeset(ast.parse(text, mode="eval").body, 0)
        for sign, text in zip(signs, expressions, strict=True)
    )


def _operations() -> dict[str, Operation]:
    return {
        "T": lambda matrix: matrix.T if isinstance(matrix, sp.MatrixBase) else matrix,
        "norm": _norm,
        "abs": sp.Abs,
        "min": sp.Min,
        "max": sp.Max,
        "sin": sp.sin,
        "cos": sp.cos,
        "cases": lambda *parts: sp.Piecewise(*zip(parts[::2], parts[1::2], strict=True)),
    }


def _norm(matrix: Any) -> Any:
    """Euclidean norm of a column; a square matrix has a spectral norm, which only its scope can know."""
    if matrix.shape[1] != 1:
        raise TypeError("norm of a matrix that is no column")
    return sp.sqrt(sum(entry**2 for entry in matrix))


def _is_name(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) or (
        isinstance(node, ast.Call) and ast.unparse(node.func) not in _operations()
    )


def _names(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.expr) and _is_name(node):
        yield ast.unparse(node)
        return
    inner = node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node)
    for child in inner:
        yield from _names(child)


def _evaluate(node: ast.expr, scope: Scope) -> Any:
    if isinstance(node, ast.Constant):
        return sp.Rational(str(node.value))
    if _is_name(node) or ast.unparse(node) in scope:
        return scope[ast.unparse(node)]
    if isinstance(node, ast.Call):
        return _operations()[ast.unparse(node.func)](*(_evaluate(argument, scope) for argument in node.args))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_evaluate(node.operand, scope)
    if isinstance(node, ast.List):
        return sp.Matrix(
            [
                [_evaluate(entry, scope) for entry in row.elts]
                for row in node.elts
                if isinstance(row, ast.List)
            ]
        )
    if isinstance(node, ast.BinOp):
        return _combine(node.op, _evaluate(node.left, scope), _evaluate(node.right, scope))
    if isinstance(node, ast.Compare):
        return _condition(node, scope)
    raise SyntaxError(f"not an expression of the paper: {ast.unparse(node)}")


def _combine(operator: ast.operator, left: Any, right: Any) -> Any:
    """One arithmetic operation; a matrix of one entry is that entry, as the paper takes it."""
    if isinstance(operator, ast.Add | ast.Sub):
        if _shape(left) != _shape(right):
            raise TypeError(f"{_shape(left)} and {_shape(right)} do not add up")
        return left + right if isinstance(operator, ast.Add) else left - right
    if isinstance(operator, ast.Mult):
        product = left * right
        return product[0, 0] if _shape(product) == "a 1 x 1 matrix" else product
    return left / right if isinstance(operator, ast.Div) else left**right


def _shape(item: Any) -> str:
    return f"a {item.shape[0]} x {item.shape[1]} matrix" if isinstance(item, sp.MatrixBase) else "a number"


def _condition(node: ast.Compare, scope: Scope) -> Any:
    relations = {ast.Gt: sp.Gt, ast.Lt: sp.Lt, ast.LtE: sp.Le, ast.GtE: sp.Ge}
    sides = [_evaluate(side, scope) for side in (node.left, *node.comparators)]
    pairs = zip(node.ops, sides, sides[1:], strict=False)
    return sp.And(*(relations[type(operator)](left, right) for operator, left, right in pairs))


def _typeset(node: ast.expr, binding: int) -> str:
    """LaTeX of a node, in brackets where its surroundings bind more strongly than it does."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.List):
        rows = (
            " & ".join(_typeset(entry, 0) for entry in row.elts)
            for row in node.elts
            if isinstance(row, ast.List)
        )
        return r"\begin{bmatrix} " + r" \\ ".join(rows) + r" \end{bmatrix}"
    if isinstance(node, ast.Call | ast.Name):
        return _typeset_name(node)
    if isinstance(node, ast.Compare):
        signs = {ast.Gt: ">", ast.Lt: "<", ast.LtE: r"\le", ast.GtE: r"\ge"}
        tail = (
            f" {signs[type(op)]} {_typeset(side, 0)}"
            for op, side in zip(node.ops, node.comparators, strict=True)
        )
        return _typeset(node.left, 0) + "".join(tail)
    if isinstance(node, ast.UnaryOp):
        return _bracketed("-" + _typeset(node.operand, 2), 2, binding)
    if isinstance(node, ast.BinOp):
        return _typeset_operation(node, binding)
    raise SyntaxError(f"not an expression of the paper: {ast.unparse(node)}")


def _typeset_operation(node: ast.BinOp, binding: int) -> str:
    precedence = _PRECEDENCE[type(node.op)]
    if isinstance(node.op, ast.Div):
        negative = isinstance(node.left, ast.UnaryOp)
        above = node.left.operand if isinstance(node.left, ast.UnaryOp) else node.left
        return rf"{'-' * negative}\frac{{{_typeset(above, 0)}}}{{{_typeset(node.right, 0)}}}"
    if isinstance(node.op, ast.Pow):
        base = _typeset(node.left, 5)
        base = rf"\left({base}\right)" if base.startswith(r"\frac") else base
        return f"{base}^{{{_typeset(node.right, 0)}}}"
    sign = {ast.Add: " + ", ast.Sub: " - ", ast.Mult: " "}[type(node.op)]
    text = (
        _typeset(node.left, precedence)
        + sign
        + _typeset(node.right, precedence + (not isinstance(node.op, ast.Add)))
    )
    return _bracketed(text, precedence, binding)


def _bracketed(text: str, precedence: int, binding: int) -> str:
    return rf"\left({text}\right)" if precedence < binding else text


def _typeset_name(node: ast.Name | ast.Call) -> str:
    if isinstance(node, ast.Name):
        stem, subscript = _glyph(node.id)
        return stem + subscript
    function = ast.unparse(node.func)
    arguments = [_typeset(argument, 0) for argument in node.args]
    if function in ("dot", "ddot", "hat", "bar"):
        return "".join(_accented(node))
    if function == "partial":
        return rf"\frac{{\partial {arguments[0]}}}{{\partial {arguments[1]}}}"
    if function == "T":
        return f"{_typeset(node.args[0], 4)}^T"
    if function in ("norm", "abs"):
        bar = r"\|" if function == "norm" else "|"
        return f"{bar} {arguments[0]} {bar}"
    if function == "cases":
        rows = (
            f"{expression} & {condition}"
            for expression, condition in zip(arguments[::2], arguments[1::2], strict=True)
        )
        return r"\begin{cases} " + r" \\ ".join(rows) + r" \end{cases}"
    if function in ("min", "max"):
        return rf"\{function}\left\{{{', '.join(arguments)}\right\}}"
    name = rf"\{function}" if function in ("sin", "cos") else "".join(_glyph(function))
    return f"{name}({', '.join(arguments)})"


def _accented(node: ast.expr) -> tuple[str, str]:
    r"""Accented stem and what follows it: ``dot(hat(x_1))`` is :math:`\dot{\hat{x}}_1`."""
    if isinstance(node, ast.Name):
        return _glyph(node.id)
    if isinstance(node, ast.Call) and ast.unparse(node.func) == "T":
        stem, subscript = _accented(node.args[0])
        return stem, subscript + "^T"
    if isinstance(node, ast.Call):
        stem, subscript = _accented(node.args[0])
        return rf"\{ast.unparse(node.func)}{{{stem}}}", subscript
    raise SyntaxError(f"no accent goes on {ast.unparse(node)}")


def _glyph(name: str) -> tuple[str, str]:
    if name in _GLYPHS:
        return _GLYPHS[name], ""
    stem, *indices = name.split("_")
    stem = "lambda" if stem == "lamda" else stem
    marks = [
        rf"\{index}" if index in _GREEK else rf"\{index}" if index in ("max", "min") else index
        for index in indices
    ]
    return rf"\{stem}" if stem in _GREEK else stem, f"_{{{','.join(marks)}}}" if marks else ""
