"""Equations as MathML, which browsers draw without help, from their text in Python's notation.

A parameter carries its name as ``data-p``, so that a page can put its number there.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection
from html import escape
from typing import Final

_GREEK: Final = dict(
    zip(
        [
            "alpha",
            "beta",
            "gamma",
            "delta",
            "epsilon",
            "eta",
            "theta",
            "kappa",
            "lambda",
            "mu",
            "nu",
            "xi",
            "Xi",
            "pi",
            "rho",
            "sigma",
            "tau",
            "phi",
            "psi",
            "omega",
            "Omega",
            "Delta",
            "Phi",
            "input_scale",
        ],
        "αβγδεηθκλμνξΞπρστφψωΩΔΦκ",
        strict=True,
    )
)
_ACCENTS: Final = {"dot": "˙", "hat": "^"}
_PARTIAL: Final = re.compile(r"d(?P<of>\w+?)_d(?P<by>\w+)")
_RATE: Final = re.compile(r"d(?P<order>\d*)(?P<of>y_r|y)")
_NAME: Final = re.compile(r"(?P<base>[A-Za-z]+?)(?P<number>\d*)(?P<rest>(?:_\w+)?)")
_KEYWORD: Final = "lambda"  # a name of the models, and a word of Python

_SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(5)  # precedence


def equation(name: str, text: str, parameters: Collection[str]) -> str:
    """``name = text`` as a ``<math>`` element.

    Args:
        name: what is defined, such as ``z1`` or ``r1_dot``.
        text: an expression in Python's notation.
        parameters: names to mark.
    """
    tree = ast.parse(re.sub(rf"\b{_KEYWORD}\b", f"{_KEYWORD}_", text), mode="eval").body
    body, _ = _Printer(parameters).node(tree)
    return f'<math display="inline">{symbol(name)}<mo>=</mo>{body}</math>'


def symbol(name: str) -> str:
    """A name as a symbol: ``Xi21``, ``y_r``, ``dalpha1_dy``, ``r1_dot``, ``x_hat1``."""
    name = name.rstrip("_")
    if name in _GREEK:
        return _identifier(_GREEK[name])
    if name == "du":
        return "<mrow><mi>Δ</mi><mi>u</mi></mrow>"
    if found := _RATE.fullmatch(name):
        dots = "¨" if found["order"] == "2" else "˙" if not found["order"] else f"({found['order']})"
        inner = symbol(found["of"])
        return (
            f'<mover accent="true">{inner}<mo>{dots}</mo></mover>' if len(dots) == 1 else _over(inner, dots)
        )
    if found := _PARTIAL.fullmatch(name):
        above, below = symbol(found["of"]), symbol(found["by"])
        return f"<mfrac><mrow><mo>∂</mo>{above}</mrow><mrow><mo>∂</mo>{below}</mrow></mfrac>"
    for word, mark in _ACCENTS.items():
        base, found_word, rest = name.partition(f"_{word}")
        if found_word:
            return f'<mover accent="true">{symbol(base + rest)}<mo>{mark}</mo></mover>'
    return _plain(name)


def _over(inner: str, order: str) -> str:
    return f"<msup>{inner}<mrow><mo>{order}</mo></mrow></msup>"


def _plain(name: str) -> str:
    """Letters with everything else below them."""
    found = _NAME.fullmatch(name)
    if found is None:
        return _identifier(name)
    base = _GREEK.get(found["base"], found["base"])
    below = ",".join(part for part in (found["number"], found["rest"].lstrip("_")) if part)
    return f"<msub>{_identifier(base)}<mn>{escape(below)}</mn></msub>" if below else _identifier(base)


def _identifier(text: str) -> str:
    return f"<mi>{escape(text)}</mi>"


class _Printer:
    """Prints syntax; each method gives the text and its precedence."""

    def __init__(self, parameters: Collection[str]) -> None:
        self.parameters = parameters

    def node(self, tree: ast.expr) -> tuple[str, int]:
        match tree:
            case ast.Constant(value=int() | float() as value):
                return f"<mn>{value:g}</mn>", _ATOM
            case ast.Name(id=name):
                known = name.rstrip("_")
                if known in self.parameters:
                    return f'<mrow data-p="{escape(known)}">{symbol(known)}</mrow>', _ATOM
                return symbol(known), _ATOM
            case ast.UnaryOp(operand=operand):
                return f"<mo>−</mo>{self.inside(operand, _PRODUCT)}", _SIGN
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                above, below = self.inside(left, _SUM), self.inside(right, _SUM)
                return f"<mfrac><mrow>{above}</mrow><mrow>{below}</mrow></mfrac>", _ATOM
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                base, power = self.inside(left, _ATOM), self.inside(right, _SUM)
                return f"<msup><mrow>{base}</mrow><mrow>{power}</mrow></msup>", _POWER
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                first, second = self.inside(left, _PRODUCT), self.inside(right, _PRODUCT)
                return f'{first}<mo class="times">·</mo>{second}', _PRODUCT
            case ast.BinOp(left=left, op=op, right=right):
                sign = "+" if isinstance(op, ast.Add) else "−"
                second = self.inside(right, _PRODUCT)
                return f"{self.inside(left, _SUM)}<mo>{sign}</mo>{second}", _SUM
            case ast.Call(func=ast.Name(id=name), args=arguments):
                inside = "<mo>,</mo>".join(self.inside(item, _SUM) for item in arguments)
                return f"<mi>{escape(name)}</mi><mo>(</mo>{inside}<mo>)</mo>", _ATOM
        return f"<mtext>{escape(ast.unparse(tree))}</mtext>", _ATOM

    def inside(self, tree: ast.expr, least: int) -> str:
        """With brackets if it binds less than its surroundings."""
        text, precedence = self.node(tree)
        loose = precedence < least or (precedence == _SIGN and least > _SUM)
        return f"<mrow><mo>(</mo>{text}<mo>)</mo></mrow>" if loose else text
