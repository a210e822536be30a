"""Allowed names of parameters, and how a message writes the place of a value in a model file."""

from __future__ import annotations

import keyword
import re
from collections.abc import Sequence

from pmjoint_codegen.errors import quoted
from pmjoint_codegen.operations import functions

CONSTANTS = ("pi",)

MODEL_NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"  # it names a folder

_SHAPE = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")
# What an expression or a column would mean twice; the tracking error e has another name beside a parameter e.
_WORDS = frozenset(
    (
        *CONSTANTS,
        *("t", "y", "y_r", "u", "v", "du", "inf", "nan"),
        *("compensator", "saturation", "input_scale", "braking", "braking_range", "braking_rate"),
    )
)
_KINKED = frozenset(("abs", "sign", "min", "max"))  # functions of a disturbance, and of printed equations
_NUMBERED = re.compile(
    r"(x|x_hat|xi|Xi|lambda|r|z|alpha|epsilon|c|e|ck|k|D)[1-9]\d*"  # states, signals, gains
    r"|d\d*y_r|dalpha\d+_d\w+|[A-Za-z]+\d+_dot"  # derivatives
    r"|Omega|theta_\d+|b_\d+|v\d+_\d+"  # steps and coefficients that the derivation names
    r"|[A-Za-z]+\d+_next|([A-Za-z]+\d+|Omega)_start|[FG][0r]_\d+"  # of the sampled controller, of the start
    r"|d?braking_rate\w*|r1_slope\d|r2_middle"  # of a compensator that brakes
    r"|g_(offset|slope)\d+|side\d+"  # of kernels
    r"|ref_([ta]|[pq]\d+)|y_cmd"  # of a reference that is data
    r"|rate_of_\w+"  # of a system
    r"|\w+_plant|D[1-9]\d*_effective|known\d+|mismatch\d+"  # of the true plant
)


def why_not(name: str) -> str | None:
    """State why a parameter cannot have this name, or None if it can."""
    if not _SHAPE.fullmatch(name):
        return "is not a name: a letter, then letters, digits or _, 40 at most"
    if keyword.iskeyword(name):
        return "is a word of Python, in whose notation expressions are written"
    if name in _WORDS or name in _KINKED or name in functions() or _NUMBERED.fullmatch(name):
        return "already names a signal, gain, state, function or step of the derivation"
    return None


def key_path(path: Sequence[int | str]) -> str:
    """Write the place of a value as a reader counts: ``plant.phi, entry 2``."""
    keys = ".".join(part if _is_bare(part) else quoted(part) for part in path if isinstance(part, str))
    return keys + "".join(f", entry {part + 1}" for part in path if isinstance(part, int))


def _is_bare(key: str) -> bool:
    return re.fullmatch(r"[A-Za-z0-9_-]{1,60}", key) is not None
