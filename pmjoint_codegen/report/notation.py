r"""The paper's notation for the names of a derivation: ``dalpha1_dXi21``, ``lambda1_dot``, ``x_hat2``.

Names with a meaning of their own are known here; every other is a stem with an index: ``b0``, ``u_max``.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator, Sequence

import sympy as sp
from sympy.printing.latex import LatexPrinter, tex_greek_dictionary
from sympy.printing.str import StrPrinter

_STEMS = {"eps": r"\varepsilon", "eso": r"\hat{\eta}"}
_LOWER = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa "
    "lambda mu nu xi pi rho sigma tau upsilon phi chi psi omega"
)
_UPPER = "Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
_GREEK = frozenset(f"{_LOWER} {_UPPER}".split())
_WORDS = {
    "du": r"\Delta u",
    "y_r": "y_r",
    "dy_r": r"\dot{y}_r",
    "d2y_r": r"\ddot{y}_r",
    "compensator": "s_r",
    "input_scale": r"\kappa_u",
    "braking": r"\alpha_b",
    "braking_range": r"\ell",
    "braking_rate": "g(r_1)",
    "braking_rate_start": "g(r_1(0))",
    "dbraking_rate_dr1": "g'(r_1)",
    "alpha_bar": r"\bar{\alpha}",
    "leakage": r"\sigma_\Theta",
    "rho_hat": r"\hat{\varrho}",
    "rho_hat_dot": r"\dot{\hat{\varrho}}",
    "rho_hat_next": r"\hat{\varrho}_{\mathrm{next}}",
    "rho_guess": r"\varrho_{\mathrm{guess}}",
    "rho_prior": r"\varrho_{\mathrm{prior}}",
    "rho_leakage": r"\sigma_\varrho",
    "gamma_rho": r"\gamma_\varrho",
    "pull_rho": r"\mathrm{pull}_\varrho",
    "prediction_error": r"\epsilon_y",
    "prediction_norm": r"\nu_\omega",
    "observer": r"\omega_o",
    "ls_kappa": r"\kappa",
    "ls_forgetting": r"\beta",
    "ls_P0": "P_0",
    "ls_k_max": r"k_{\max}",
    "f_minus": "f_-",
    "f_plus": "f_+",
}
_PROSE = ("compensator", "leakage", "observer")  # words of a remark too
_SPECIAL = {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    **{character: "\\" + character for character in "&%$#_{}"},
}
_PARTIAL = re.compile(r"d\d*[A-Za-z]+\d*_d.+")
_UNIT = r"(?:kg|rad|deg|bar|Pa|kPa|MPa|Hz|mm|cm|ms|[NVAWJKms])(?:\^-?\d+)?"
_QUANTITY = re.compile(rf"(?<=\d)([ /]\(?{_UNIT}(?:(?: |/\(?){_UNIT}\)?)*)(?!\w)")  # as in 2 rad/(s^2 V)
_SCRIPT = r"(?:[_^](?:\w|\\[a-z]+|\{(?:[^{}]|\{[^{}]*\})*\}))"
_AFTER_WORD = re.compile(rf"(\\mathrm\{{\w{{2,}}\}}{_SCRIPT}*) (?=\w|\\(?!cdot|le|ge|right|\W))")
_BEFORE_WORD = re.compile(r"(?<=[\w})])(?<!\\cdot) (?=\\mathrm\{\w{2,}\})")
_LATIN = 0x180  # LaTeX knows the letters below this code without being told


def latex_name(name: str) -> str:
    r"""Give the LaTeX of a signal, parameter or equation, such as ``\Xi_{21}`` for ``Xi21``."""
    if name in _WORDS:
        return _WORDS[name]
    for pattern, write in _forms():
        match = re.fullmatch(pattern, name)
        if match:
            return write(*match.groups())
    return _indexed(name)


def _forms() -> tuple[tuple[str, Callable[..., str]], ...]:
    """Give the patterns of composite names, the most particular first, each with its LaTeX."""
    return (
        (r"rate_of_(.+)", lambda state: _accented("dot", state)),
        (r"(omega|omega1|Gamma|gamma|tau|pull)_(?!plant|max|min)(\w+?)", _of_entry),
        (r"(\w+?)_logit(?:_(dot|next))?", _logit),
        (r"(\w+?)_turn", lambda name: f"T_{{{latex_name(name)}}}"),
        (r"(.+)_start", lambda base: f"{latex_name(base)}(0)"),
        (r"d(Gamma_(\w+))_d(\2_hat)", lambda gain, _, by: _derivative("", gain, [by])),
        (
            r"d(\d*)([A-Za-z]+\d*)_d(.+)",
            lambda order, of, by: _derivative(order, of, by.split("_d")),
        ),
        (r"([A-Za-z]\w*?)_hat_(dot|next)", _changed_estimate),
        (r"([A-Za-z]\w*?)_(low|high)", _end_of_range),
        (r"(.+)_dot((?:_plant|_max)?)", lambda base, owner: _accented("dot", base + owner)),
        (r"(\w+?)_hat(\d*)", lambda stem, index: _accented("hat", stem + index)),
        (r"d(\d+)y_r", lambda order: f"y_r^{{({order})}}"),
        (r"ck(\d+)", lambda index: f"c_{{k{index}}}"),
    )


def _of_entry(stem: str, name: str) -> str:
    r"""Write what belongs to one unknown parameter, such as ``\omega_{b_0}``, with all of its name below."""
    if name.endswith("_start"):
        return f"{_of_entry(stem, name.removesuffix('_start'))}(0)"
    letter, subscript = _split(stem)
    below = f"{subscript},{latex_name(name)}" if subscript else latex_name(name)
    return f"{letter}_{{{below}}}"


def _logit(name: str, change: str | None) -> str:
    r"""Write the state of an estimate with a range, ``\ell_{b_0}``, its rate, or itself one sample later."""
    letter = r"\dot{\ell}" if change == "dot" else r"\ell"
    later = r",\mathrm{next}" if change == "next" else ""
    return f"{letter}_{{{latex_name(name)}{later}}}"


def _changed_estimate(name: str, change: str) -> str:
    r"""Write the rate of an estimate, ``\dot{\hat{b}}_0``, or what it is one sample later."""
    stem, subscript = _split(name)
    if change == "dot":
        return rf"\dot{{\hat{{{stem}}}}}{_subscript(subscript)}"
    return rf"\hat{{{stem}}}_{{{subscript}{',' * bool(subscript)}\mathrm{{next}}}}"


def _end_of_range(name: str, end: str) -> str:
    r"""Write an end of the range of an estimate, such as ``\underline{b}_0``."""
    stem, subscript = _split(name)
    return rf"\{'underline' if end == 'low' else 'overline'}{{{stem}}}{_subscript(subscript)}"


def _derivative(order: str, of: str, by: Sequence[str]) -> str:
    r"""Write a partial derivative, such as ``\frac{\partial^2 \alpha_1}{\partial y \partial \xi_2}``."""
    power = f"^{order}" if order else ""
    below = " ".join(rf"\partial {latex_name(signal)}" for signal in by)
    return rf"\frac{{\partial{power} {latex_name(of)}}}{{{below}}}"


def _accented(accent: str, name: str) -> str:
    r"""Put an accent over the stem alone, as in ``\dot{\lambda}_1``."""
    stem, subscript = _split(name)
    return rf"\{accent}{{{stem}}}{_subscript(subscript)}"


def _indexed(name: str) -> str:
    stem, subscript = _split(name)
    return stem + _subscript(subscript)


def _split(name: str) -> tuple[str, str]:
    """Split a name into the LaTeX of its stem and of its index."""
    match = re.fullmatch(r"([A-Za-z]+?)_?(\d*)((?:_\w+)?)", name)
    if not match:
        return rf"\mathrm{{{escape(name)}}}", ""
    stem, digits, tail = match.groups()
    return _stem(stem), ",".join(part for part in (digits, *map(_word, tail.split("_")[1:])) if part)


def _stem(stem: str) -> str:
    if stem in _GREEK:
        return "\\" + stem
    if stem in _STEMS:
        return _STEMS[stem]
    if stem in tex_greek_dictionary:
        return str(tex_greek_dictionary[stem])
    return stem if len(stem) == 1 else rf"\mathrm{{{stem}}}"


def _word(word: str) -> str:
    if word in ("max", "min"):
        return "\\" + word
    if word in _GREEK:
        return "\\" + word
    return word if len(word) == 1 or word.isdigit() else rf"\mathrm{{{escape(word)}}}"


def _subscript(text: str) -> str:
    if not text:
        return ""
    return f"_{text}" if len(text) == 1 else f"_{{{text}}}"


def ordered_terms(expression: sp.Expr) -> list[sp.Expr]:
    """Give the terms of a sum in a reader's order.

    Terms that hold partial derivatives come last, as in (29); else those with a minus sign do, as in (24).
    """
    terms: list[sp.Expr] = list(expression.as_ordered_terms())
    partial = [any(_PARTIAL.fullmatch(symbol.name) for symbol in term.free_symbols) for term in terms]
    last = partial if any(partial) else [term.could_extract_minus_sign() for term in terms]
    return [term for late in (False, True) for term, flag in zip(terms, last, strict=True) if flag is late]


def scaled_sum(expression: sp.Expr) -> tuple[sp.Expr, list[sp.Expr]]:
    """Split ``factor * (sum)`` into the factor and the terms, so that a long sum can be broken between them.

    Returns:
        the factor, which is 1 for a plain sum, and the terms in a reader's order.
    """
    sums = [factor for factor in sp.Mul.make_args(expression) if factor.is_Add]
    if len(sums) != 1:
        return sp.Integer(1), ordered_terms(expression)
    return expression / sums[0], ordered_terms(sums[0])


class PlainPrinter(StrPrinter):  # type: ignore[misc]  # SymPy carries no types
    """SymPy's text printer with its own names of functions and its own order of sums."""

    def _print_Exp1(self, expr: sp.Expr) -> str:  # noqa: N802 - SymPy's name
        return "exp(1)"  # SymPy writes E, which may be a parameter


class TextPrinter(PlainPrinter):
    """The same with sums in a reader's order, and with Python's own functions."""

    def _as_ordered_terms(self, expr: sp.Expr, order: str | None = None) -> list[sp.Expr]:
        return ordered_terms(expr)

    def _print_Abs(self, expr: sp.Expr) -> str:  # noqa: N802 - SymPy's name
        return f"abs({self.stringify(expr.args, ', ')})"

    def _print_Max(self, expr: sp.Expr) -> str:  # noqa: N802 - SymPy's name
        return f"max({self.stringify(expr.args, ', ')})"

    def _print_Min(self, expr: sp.Expr) -> str:  # noqa: N802 - SymPy's name
        return f"min({self.stringify(expr.args, ', ')})"


class PaperPrinter(LatexPrinter):  # type: ignore[misc]  # SymPy carries no types
    """SymPy's LaTeX printer with sums in a reader's order, and with the paper's names."""

    def _as_ordered_terms(self, expr: sp.Expr, order: str | None = None) -> list[sp.Expr]:
        return ordered_terms(expr)

    def _print_Symbol(self, expr: sp.Symbol, style: str = "plain") -> str:  # noqa: N802 - SymPy's name
        return latex_name(expr.name)

    def _print(self, expr: sp.Basic, **kwargs: object) -> str:
        """Print Euler's number upright, as e may be a parameter; SymPy would ask the number itself."""
        return r"\mathrm{e}" if expr is sp.E else str(super()._print(expr, **kwargs))

    def _print_ExpBase(self, expr: sp.Expr, exp: str | None = None) -> str:  # noqa: N802 - SymPy's name
        power = rf"\mathrm{{e}}^{{{self._print(expr.args[0])}}}"
        return str(self._do_exponent(power, exp))

    def parenthesize_super(self, s: str) -> str:
        """Bracket a base that an exponent must not stick to, such as a partial derivative."""
        return rf"\left({s}\right)" if "^" in s or s.startswith(r"\frac") else s


def latex_expression(expression: sp.Expr) -> str:
    r"""Give the LaTeX of an expression in the paper's notation.

    Names of functions that LaTeX does not know are set with ``\mathrm``: GitHub refuses ``\operatorname``.
    """
    text = str(PaperPrinter({"fold_short_frac": False}).doprint(expression))
    return _spaced(text.replace(r"\operatorname", r"\mathrm"))


def _spaced(product: str) -> str:
    """Set a word apart from the factors beside it, which would look like more of its letters."""
    after = _AFTER_WORD.sub(r"\1\, ", product)
    return _BEFORE_WORD.sub(r"\, ", after)


def latex_number(value: float) -> str:
    r"""Give a number with all the digits that it has, such as ``0.1`` or ``1.5 \cdot 10^{-6}``."""
    short = f"{value:g}"
    digits, _, power = (short if float(short) == value else repr(value)).partition("e")
    if not power:
        return digits
    return ("" if digits == "1" else rf"{digits} \cdot ") + f"10^{{{int(power)}}}"


def plain_text(expression: sp.Expr) -> str:
    """Give an expression as a generated file states it, in SymPy's own order."""
    return str(PlainPrinter().doprint(expression))


def text_expression(expression: sp.Expr) -> str:
    """Give an expression as plain text in Python's syntax, such as ``-(c1 + e1)/b0``."""
    return str(TextPrinter().doprint(expression))


def latex_prose(text: str) -> str:
    """Write a remark as LaTeX, with its symbols set as mathematics and its units upright."""
    write = {"text": escape, "unit": latex_unit, "symbol": "${}$".format}
    return "".join(write[kind](piece) for kind, piece in prose_pieces(text))


def prose_pieces(text: str) -> Iterator[tuple[str, str]]:
    """Split a remark into pieces: plain ``text``, a ``unit`` as written, or a ``symbol`` in LaTeX."""
    for kind, piece in prose_words(text):
        if kind == "symbol":
            name, _, power = piece.partition("^")
            yield kind, latex_name(name) + (f"^{{{power}}}" if power else "")
        else:
            yield kind, piece


def prose_words(text: str) -> Iterator[tuple[str, str]]:
    """Split a remark into pieces, all as written: plain ``text``, a ``unit``, or a ``symbol``.

    A symbol is a word with an index (``alpha1``, ``y_r``), a Greek letter, or a letter that is no word and
    no unit: units follow a number, as in ``52 N``. It may have a power: ``y^2``.
    """
    for place, piece in enumerate(_QUANTITY.split(text)):  # every second piece is a unit
        if place % 2:
            yield "unit", piece
            continue
        for word in re.split(r"((?<!\w')[A-Za-z]\w*(?:\^\d+)?)", piece):  # not the s of "the reference's"
            yield ("symbol" if _is_symbol(word) else "text"), word


def latex_unit(unit: str) -> str:
    r"""Set a unit such as ``rad/(s^2 V)`` upright, with its powers raised."""
    pieces = re.split(r"(\^-?\d+)", unit)
    return "".join(f"$^{{{piece[1:]}}}$" if piece.startswith("^") else escape(piece) for piece in pieces)


def _is_symbol(word: str) -> bool:
    """Whether a word, with its power, is a symbol."""
    symbol = word.partition("^")[0]
    letter = len(symbol) == 1 and symbol not in "aAI"
    named = letter or symbol in _GREEK or symbol in _WORDS or re.search(r"\w[\d_]", symbol)
    return bool(re.fullmatch(r"[A-Za-z]\w*", symbol) and named and symbol not in _PROSE)


def escape(text: str) -> str:
    """Write any text so that LaTeX prints it; a character that no font here has becomes ``?``."""
    return "".join(_escaped(character) for character in text)


def _escaped(character: str) -> str:
    if character in _SPECIAL:
        return _SPECIAL[character]
    if ord(character) < _LATIN:
        return character
    plain = {
        "−": "$-$",
        "–": "--",
        "—": "---",
        "’": "'",
        "‘": "`",
        "“": "``",
        "”": "''",
        "≤": r"$\le$",
        "≥": r"$\ge$",
    }
    if character in plain:
        return plain[character]
    name = unicodedata.name(character, "").split()
    if name[:1] == ["GREEK"] and len(name) == 4:  # GREEK SMALL LETTER THETA
        letter = name[3].lower() if name[1] == "SMALL" else name[3].capitalize()
        return rf"$\{letter}$" if letter in _GREEK else "?"
    folded = unicodedata.normalize("NFKD", character)
    return "".join(part for part in folded if part.isascii()) or "?"
