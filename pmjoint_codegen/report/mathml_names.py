"""Names of signals, parameters and equations as MathML."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from typing import Final

_LETTERS: Final = (
    "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi Xi pi rho sigma tau phi chi psi "
    "omega Omega Delta Phi Gamma Theta"
)
_GREEK: Final = dict(zip(_LETTERS.split(), "αβγδεζηθκλμνξΞπρστφχψωΩΔΦΓΘ", strict=True))
_WORDS: Final = {
    "du": '<mrow><mi mathvariant="normal">Δ</mi><mi>u</mi></mrow>',
    "input_scale": "<msub><mi>κ</mi><mi>u</mi></msub>",
    "compensator": "<msub><mi>s</mi><mi>r</mi></msub>",
    "braking": "<msub><mi>α</mi><mi>b</mi></msub>",
    "braking_range": "<mi>ℓ</mi>",
    "braking_rate": "<mrow><mi>g</mi><mo>(</mo><msub><mi>r</mi><mn>1</mn></msub><mo>)</mo></mrow>",
    "alpha_bar": '<mover accent="true"><mi>α</mi><mo>¯</mo></mover>',
    "leakage": "<msub><mi>σ</mi><mi>Θ</mi></msub>",
    "rho_hat": '<mover accent="true"><mi>ϱ</mi><mo>^</mo></mover>',
    "rho_guess": "<msub><mi>ϱ</mi><mi>guess</mi></msub>",
    "rho_prior": "<msub><mi>ϱ</mi><mi>prior</mi></msub>",
    "rho_leakage": "<msub><mi>σ</mi><mi>ϱ</mi></msub>",
    "pull_rho": "<msub><mi>pull</mi><mi>ϱ</mi></msub>",
    "prediction_error": "<msub><mi>ϵ</mi><mi>y</mi></msub>",
    "prediction_norm": "<msub><mi>ν</mi><mi>ω</mi></msub>",
    "observer": "<msub><mi>ω</mi><mi>o</mi></msub>",
    "gamma_rho": "<msub><mi>γ</mi><mi>ϱ</mi></msub>",
    "ls_kappa": "<mi>κ</mi>",
    "ls_forgetting": "<mi>β</mi>",
    "ls_P0": "<msub><mi>P</mi><mn>0</mn></msub>",
    "ls_k_max": "<msub><mi>k</mi><mi>max</mi></msub>",
    "f_minus": "<msub><mi>f</mi><mo>−</mo></msub>",
    "f_plus": "<msub><mi>f</mi><mo>+</mo></msub>",
}
_ACCENT: Final = re.compile(r"(?P<stem>[A-Za-z]+)(?P<number>\d*)_(?P<mark>dot|hat)(?P<rest>\d*(?:_\w+)?)")
_ENTRY: Final = re.compile(
    r"(?P<stem>omega|Gamma|gamma|tau|pull)(?P<number>1?)_(?!plant|max|min)(?P<name>\w+)"
)
_ESTIMATE: Final = re.compile(r"(?P<stem>[A-Za-z]+)(?P<number>\d*)_hat_(?P<change>dot|next)")
_LOGIT: Final = re.compile(r"(?P<name>\w+?)_logit(?:_(?P<change>dot|next))?")
_TURN: Final = "_turn"
_END: Final = re.compile(r"(?P<stem>[A-Za-z]+)(?P<number>\d*)_(?P<end>low|high)")
_DERIVED_RATE: Final = re.compile(r"(?P<stem>[A-Za-z]+)_hat(?P<number>\d*)_dot(?P<rest>(?:_\w+)?)")
_MARKS: Final = {"dot": "˙", "hat": "^"}
_GAIN_RATE: Final = re.compile(r"d(?P<gain>Gamma_(?P<name>\w+))_d(?P<by>(?P=name)_hat)")
_OBSERVER: Final = re.compile(r"eso(?P<rest>\d+(?:_\w+)?)")
PARTIAL: Final = re.compile(r"d(?P<order>\d*)(?P<of>[A-Za-z]\w*?\d*)_d(?P<by>\w+)")
_RATE: Final = re.compile(r"d(?P<order>\d*)(?P<of>y_r|y)")
_NAME: Final = re.compile(r"(?P<base>[A-Za-z]+?)(?P<number>\d*)(?P<rest>(?:_\w+)?)")
_GAIN: Final = re.compile(r"ck(?P<number>\d+)")
_PROJECTED: Final = re.compile(r"PD(?P<number>\d+)")


def symbol(name: str) -> str:
    """A name as a symbol: ``Xi21``, ``y_r``, ``dalpha1_dy``, ``r1_dot``, ``x_hat1``."""
    name = name.rstrip("_")
    if name in _WORDS:
        return _WORDS[name]
    if name in _GREEK:
        return identifier(_GREEK[name])
    if found := _RATE.fullmatch(name):
        dots = "¨" if found["order"] == "2" else "˙" if not found["order"] else f"({found['order']})"
        return _raised("y", dots, "r" if found["of"] == "y_r" else "")
    if found := _OBSERVER.fullmatch(name):
        return symbol(f"eta_hat{found['rest']}")
    if found := _GAIN_RATE.fullmatch(name):
        return _partial("", found["gain"], [found["by"]])
    if found := PARTIAL.fullmatch(name):
        return _partial(found["order"], found["of"], found["by"].split("_d"))
    if name.startswith("rate_of_"):
        return f'<mover accent="true">{symbol(name.removeprefix("rate_of_"))}<mo>˙</mo></mover>'
    if name.endswith("_start"):
        return f"<mrow>{symbol(name.removesuffix('_start'))}<mo>(</mo><mn>0</mn><mo>)</mo></mrow>"
    if found := _ENTRY.fullmatch(name):
        index = "<mn>1</mn><mo>,</mo>" if found["number"] else ""
        return f"<msub>{_letters(found['stem'])}<mrow>{index}{symbol(found['name'])}</mrow></msub>"
    if found := _ESTIMATE.fullmatch(name):
        return _changed_estimate("ϱ" if found["stem"] == "rho" else found["stem"], found)
    if found := _LOGIT.fullmatch(name):
        letter = (
            '<mover accent="true"><mi>ℓ</mi><mo>˙</mo></mover>' if found["change"] == "dot" else "<mi>ℓ</mi>"
        )
        later = "<mo>,</mo><mi>next</mi>" if found["change"] == "next" else ""
        return f"<msub>{letter}<mrow>{symbol(found['name'])}{later}</mrow></msub>"
    if name.endswith(_TURN):
        return f"<msub><mi>T</mi>{symbol(name.removesuffix(_TURN))}</msub>"
    if found := _END.fullmatch(name):
        over, line = ("munder", "_") if found["end"] == "low" else ("mover", "¯")
        return _below(f"<{over}>{_letters(found['stem'])}<mo>{line}</mo></{over}>", found["number"])
    if found := _DERIVED_RATE.fullmatch(name):
        hat = f'<mover accent="true">{_letters(found["stem"])}<mo>^</mo></mover>'
        return _below(f'<mover accent="true">{hat}<mo>˙</mo></mover>', found["number"] + found["rest"])
    if found := _ACCENT.fullmatch(name):
        stem = f'<mover accent="true">{_letters(found["stem"])}<mo>{_MARKS[found["mark"]]}</mo></mover>'
        return _below(stem, found["number"] + found["rest"])
    if found := _PROJECTED.fullmatch(name):
        return f"<msub><mrow><mo>(</mo><mi>P</mi><mi>D</mi><mo>)</mo></mrow><mn>{found['number']}</mn></msub>"
    if found := _GAIN.fullmatch(name):
        return f"<msub><mi>c</mi><mrow><mi>k</mi><mn>{found['number']}</mn></mrow></msub>"
    return _plain(name)


def _changed_estimate(stem: str, found: re.Match[str]) -> str:
    """The rate of an estimate, with a dot above its hat, or what it is one sample later."""
    hat = f'<mover accent="true">{_letters(stem)}<mo>^</mo></mover>'
    if found["change"] == "next":
        return _below(hat, f"{found['number']}_next")
    return _below(f'<mover accent="true">{hat}<mo>˙</mo></mover>', found["number"])


def _raised(letter: str, dots: str, index: str) -> str:
    """A letter with its derivative's dots or order, and its index below."""
    if len(dots) == 1:
        return _below(f'<mover accent="true"><mi>{letter}</mi><mo>{dots}</mo></mover>', index)
    order = f"<mrow><mo>{dots}</mo></mrow>"
    return (
        f"<msubsup><mi>{letter}</mi><mi>{index}</mi>{order}</msubsup>"
        if index
        else f"<msup><mi>{letter}</mi>{order}</msup>"
    )


def _partial(order: str, of: str, by: Sequence[str]) -> str:
    sign = f"<msup><mo>∂</mo><mn>{order}</mn></msup>" if order else "<mo>∂</mo>"
    below = "".join(f"<mo>∂</mo>{symbol(item)}" for item in by)
    return f"<mfrac><mrow>{sign}{symbol(of)}</mrow><mrow>{below}</mrow></mfrac>"


def _plain(name: str) -> str:
    """Letters with everything else below them."""
    found = _NAME.fullmatch(name)
    if found is None:
        return identifier(name)
    return _below(_letters(found["base"]), found["number"] + found["rest"])


def _below(stem: str, index: str) -> str:
    """A stem with what follows it as its index: figures, then words."""
    parts = [part for part in re.split(r"(\d+)|_", index) if part]
    if not parts:
        return stem
    words = "<mo>,</mo>".join(f"<mn>{part}</mn>" if part.isdigit() else _letters(part) for part in parts)
    return f"<msub>{stem}{words}</msub>" if len(parts) == 1 else f"<msub>{stem}<mrow>{words}</mrow></msub>"


def _letters(word: str) -> str:
    return identifier("ε" if word == "eps" else _GREEK.get(word, word))


def identifier(text: str) -> str:
    """A text that is one symbol."""
    return f"<mi>{escape(text)}</mi>"


def wide_name(name: str) -> int:
    """About how many glyphs a name is wide."""
    if found := PARTIAL.fullmatch(name):
        by = found["by"].split("_d")
        return 1 + max(1 + wide_name(found["of"]), sum(1 + wide_name(item) for item in by))
    base = re.sub(r"_(dot|hat)", "", name)
    letters = re.match(r"[A-Za-z]*", base)
    stem = letters[0] if letters else ""
    return (1 if stem in _GREEK else max(1, len(stem))) + (len(base) - len(stem) + 1) // 2
