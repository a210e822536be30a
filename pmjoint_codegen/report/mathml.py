"""Equations as MathML, which browsers draw without help, from their text in Python's notation.

A parameter carries its name as ``data-p``, so that a page can put its number there. Nothing here needs SymPy.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterator, Sequence
from html import escape
from typing import Final

from pmjoint_codegen.report.mathml_names import PARTIAL, symbol, wide_name

_KEYWORD: Final = "lambda"  # a name of the models, and a word of Python
_TEN: Final = re.compile(r"(-?)([\d.]+)e([-+]?\d+)")

_SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(5)  # precedence
_WIDTH: Final = 66  # glyphs of a row of mathematics, about what a printed page holds


def equation(name: str, text: str, parameters: Collection[str]) -> str:
    """``name = text`` as a ``<math>`` element.

    Args:
        name: what is defined, such as ``z1`` or ``r1_dot``.
        text: an expression in Python's notation.
        parameters: names to mark.
    """
    body, _ = _Printer(parameters).node(_parsed(text))
    return f'<math display="inline">{symbol(name)}<mo>=</mo>{body}</math>'


def displayed(name: str, text: str, width: int = _WIDTH) -> str:
    """``name = text`` as a ``<math>`` element of its own line, a long sum broken between its terms.

    Args:
        name: what is defined.
        text: an expression in Python's notation.
        width: glyphs that a line may have.
    """
    tree, printer = _parsed(text), _Printer((), product=_TIMES)
    left = symbol(name)
    if _wide(tree) <= width:
        return f'<math display="block">{left}<mo>=</mo>{printer.node(tree)[0]}</math>'
    rows = list(_rows(printer, tree, width))
    if len(rows) == 1:  # nothing to break: a page makes it smaller where it would not fit
        return f'<math display="block" class="wide">{left}<mo>=</mo>{rows[0]}</math>'
    cells = [f"<mtd>{left}<mo>=</mo></mtd><mtd>{rows[0]}</mtd>"]
    cells += [f"<mtd></mtd><mtd>{row}</mtd>" for row in rows[1:]]
    lines = "".join(f"<mtr>{cell}</mtr>" for cell in cells)
    return f'<math display="block"><mtable displaystyle="true">{lines}</mtable></math>'


def formula(text: str, *, large: bool = False) -> str:
    """An expression as a ``<math>`` element within a line, ``large`` as on a line of its own."""
    style = ' displaystyle="true"' if large else ""
    return f'<math display="inline"{style}>{_Printer((), product=_TIMES).node(_parsed(text))[0]}</math>'


def inline_symbol(name: str, power: str = "") -> str:
    """A name as a ``<math>`` element within a line, raised to a power if there is one."""
    body = symbol(name)
    raised = f"<msup>{body}<mn>{escape(power)}</mn></msup>" if power else body
    return f'<math display="inline">{raised}</math>'


def _number(value: float) -> str:
    """A number with all the digits that it has."""
    short = f"{value:g}"
    digits = short if float(short) == value else repr(value)
    if found := _TEN.fullmatch(digits):
        sign = "<mo>−</mo>" if found[1] else ""
        lead = "" if found[2] == "1" else f'<mn>{found[2]}</mn><mo class="times">·</mo>'
        exponent = int(found[3])
        power = f"<mrow><mo>−</mo><mn>{-exponent}</mn></mrow>" if exponent < 0 else f"<mn>{exponent}</mn>"
        return f"<mrow>{sign}{lead}<msup><mn>10</mn>{power}</msup></mrow>"
    return f"<mn>{digits}</mn>"


def _parsed(text: str) -> ast.expr:
    """The syntax of a text, with the sign of a product before the whole product."""
    return _outward(ast.parse(re.sub(rf"\b{_KEYWORD}\b", f"{_KEYWORD}_", text), mode="eval").body)


def _outward(tree: ast.expr) -> ast.expr:
    """``(-a)*b`` as ``-(a*b)``, everywhere: Python reads ``-a*b`` as the former."""
    match tree:
        case ast.BinOp(left=left, op=op, right=right):
            left, right = _outward(left), _outward(right)
            if isinstance(op, ast.Mult | ast.Div) and isinstance(left, ast.UnaryOp):
                return ast.UnaryOp(left.op, ast.BinOp(left.operand, op, right))
            return ast.BinOp(left, op, right)
        case ast.UnaryOp(op=op, operand=operand):
            return ast.UnaryOp(op, _outward(operand))
        case ast.Call(func=func, args=args):
            return ast.Call(func, [_outward(item) for item in args], [])
    return tree


def _terms(tree: ast.expr, negative: bool = False) -> list[tuple[bool, ast.expr]]:
    """The terms of a sum, each with whether it is subtracted."""
    match tree:
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
            return [*_terms(left, negative), *_terms(right, negative ^ isinstance(op, ast.Sub))]
        case ast.UnaryOp(operand=operand):
            return [(not negative, operand)]
    return [(negative, tree)]


def _is_sum(tree: ast.expr) -> bool:
    return isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Add | ast.Sub)


def _factored(tree: ast.expr) -> tuple[ast.expr, ast.expr] | None:
    """``factor * (sum)`` as both, so that the sum can be broken; None for anything else."""
    match tree:
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div() as op, right=right):
            if _is_sum(left):
                one = ast.Constant(1)
                return (ast.BinOp(one, op, right) if isinstance(op, ast.Div) else right), left
            if _is_sum(right) and isinstance(op, ast.Mult):
                return left, right
            if inner := _factored(left):
                return ast.BinOp(inner[0], op, right), inner[1]
    return None


def _rows(printer: _Printer, tree: ast.expr, width: int) -> Iterator[str]:
    """A wide expression as rows, each with as many terms as it holds."""
    row, filled = "", 0
    for k, (negative, text, wide) in enumerate(_pieces(printer, _terms(tree), width)):
        sign = "<mo>−</mo>" if negative else "" if negative is None or k == 0 else "<mo>+</mo>"
        if row and filled + wide > width:
            yield f"<mrow>{row}</mrow>"
            row, filled = "", 4
        row, filled = row + sign + text, filled + wide + 3
    yield f"<mrow>{row}</mrow>"


def _pieces(
    printer: _Printer, terms: Sequence[tuple[bool, ast.expr]], width: int
) -> Iterator[tuple[bool | None, str, int]]:
    """Sign, MathML and width of each term; one that no row holds comes as a factor and the terms of its sum.

    The sign is None where what stands before it is a bracket.
    """
    for negative, term in terms:
        wide, split = _wide(term), _factored(term)
        if wide <= width or split is None:
            yield negative, printer.inside(term, _PRODUCT), wide
            continue
        factor, inner = split
        yield negative, f"{printer.inside(factor, _PRODUCT)}{_TIMES}{_BRACKET[0]}", _wide(factor) + 1
        parts = list(_pieces(printer, _terms(inner), width))
        for k, (sign, text, size) in enumerate(parts):
            last = _BRACKET[1] if k == len(parts) - 1 else ""
            yield (None if k == 0 and not sign else sign), text + last, size


_BRACKET: Final = ('<mo stretchy="false">[</mo>', '<mo stretchy="false">]</mo>')
_TIMES: Final = "<mo>&#x2062;</mo>"  # the invisible product
_DOT: Final = '<mo class="times">·</mo>'


def _wide(tree: ast.expr) -> int:
    """About how many glyphs an expression is wide; indices and powers count half."""
    match tree:
        case ast.Constant(value=value):
            return len(f"{value:g}") if isinstance(value, int | float) else 1
        case ast.Name(id=name):
            return wide_name(name)
        case ast.UnaryOp(operand=operand):
            return 1 + _wide(operand)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return 1 + max(_wide(left), _wide(right))
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return _wide(left) + (_wide(right) + 1) // 2 + 2 * isinstance(left, ast.BinOp)
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _wide(left) + _wide(right) + 2 * (_is_sum(left) + _is_sum(right))
        case ast.BinOp(left=left, right=right):
            return _wide(left) + _wide(right) + 3
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return len(name) + 2 + sum(_wide(item) + 1 for item in arguments)
    return len(ast.unparse(tree))


class _Printer:
    """Prints syntax; each method gives the text and its precedence."""

    def __init__(self, parameters: Collection[str], product: str = _DOT) -> None:
        self.parameters = parameters
        self.product = product

    def node(self, tree: ast.expr) -> tuple[str, int]:
        match tree:
            case ast.Constant(value=int() | float() as value):
                return _number(value), _ATOM
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
                if isinstance(left, ast.Name) and base.startswith("<msub>"):
                    both = base.removeprefix("<msub>").removesuffix("</msub>")
                    return f"<msubsup>{both}<mrow>{power}</mrow></msubsup>", _POWER
                if _is_fraction(left):
                    base = f"<mrow><mo>(</mo>{base}<mo>)</mo></mrow>"
                return f"<msup><mrow>{base}</mrow><mrow>{power}</mrow></msup>", _POWER
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                first, second = self.inside(left, _PRODUCT), self.inside(right, _PRODUCT)
                sign = _DOT if isinstance(right, ast.Constant) else self.product
                return f"{first}{sign}{second}", _PRODUCT
            case ast.BinOp(left=left, op=op, right=right):
                sign = "+" if isinstance(op, ast.Add) else "−"
                least = _PRODUCT if isinstance(op, ast.Sub) else _SUM
                second = self.inside(right, least)
                return f"{self.inside(left, _SUM)}<mo>{sign}</mo>{second}", _SUM
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self.call(name, arguments)
        return f"<mtext>{escape(ast.unparse(tree))}</mtext>", _ATOM

    def call(self, name: str, arguments: Sequence[ast.expr]) -> tuple[str, int]:
        """A function: roots, magnitudes and powers of e as such, any other by its name."""
        inside = "<mo>,</mo>".join(self.inside(item, _SUM) for item in arguments)
        if name == "sqrt":
            return f"<msqrt>{inside}</msqrt>", _ATOM
        if name == "abs":
            return f'<mrow><mo stretchy="true">|</mo>{inside}<mo stretchy="true">|</mo></mrow>', _ATOM
        if name == "exp":
            return f'<msup><mi mathvariant="normal">e</mi><mrow>{inside}</mrow></msup>', _POWER
        return f"<mrow><mi>{escape(name)}</mi><mo>&#x2061;</mo><mo>(</mo>{inside}<mo>)</mo></mrow>", _ATOM

    def inside(self, tree: ast.expr, least: int) -> str:
        """With brackets if it binds less than its surroundings."""
        text, precedence = self.node(tree)
        loose = precedence < least or (precedence == _SIGN and least > _SUM)
        return f"<mrow><mo>(</mo>{text}<mo>)</mo></mrow>" if loose else text


def _is_fraction(tree: ast.expr) -> bool:
    """Whether it is drawn as a fraction, to which a power would not visibly apply."""
    if isinstance(tree, ast.Name):
        return PARTIAL.fullmatch(tree.id) is not None
    return isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Div)
