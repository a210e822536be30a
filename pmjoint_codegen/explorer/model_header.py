"""``explorer_model.h``: what `explorer.c` must know of a model, as C."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from pmjoint_codegen.loops.chain import is_looped
from pmjoint_codegen.loops.logits import logit_states
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.fixed import fixed_constants
from pmjoint_codegen.simulate.settings import DEFAULT_TOLERANCE

MAX_STEPS: Final = 10_000_000
_OPTIONAL: Final = ("y_m", "y_f", "u_command", "u_valve")  # signals of some models only
_NEEDED: Final = ("y", "y_r", "e", "v", "u", "D1")


def model_header(manifest: Manifest) -> str:
    """The text of ``explorer_model.h``."""
    template = Path(__file__).parent / "c" / "explorer_model.h.in"
    text = template.read_text(encoding="utf-8")
    return text.replace("@constants@", "\n".join(_lines(manifest)))


def _lines(manifest: Manifest) -> Iterator[str]:
    problems = {
        name: fixed_constants(manifest, sampled=name == "SAMPLED", tolerance=DEFAULT_TOLERANCE)
        for name in ("CONTINUOUS", "SAMPLED")
    }
    sizes = {
        "N_ORDER": manifest.n,
        "N_RHO": manifest.rho,
        "N_COMPENSATOR": math.isqrt(manifest.function("compensator_matrix").outputs[0][1]),
        "N_SIGNALS": len(manifest.signals),
        "N_SEGMENT": manifest.segment,
        "CAN_HOLD": int(manifest.can_hold),
        "LOOPED": int(is_looped(manifest)),
        "MOST_ORDER": max(problem["order"] for problem in problems.values()),
        "MOST_CHANNELS": max(problem["n_channels"] for problem in problems.values()),
    }
    places = {item.name: i for i, item in enumerate(manifest.signals)}
    sizes |= {f"SIGNAL_{name.upper()}": places[name] for name in _NEEDED}
    sizes |= {f"SIGNAL_{name.upper()}": places.get(name, -1) for name in _OPTIONAL}
    yield from (f"#define {name} ({value})" for name, value in sizes.items())
    free = logit_states(manifest)
    marks = ", ".join(str(int(place in free)) for place in range(manifest.nX))
    yield f"static const int boundless[] = {{{marks}}}; /* logits, which may go anywhere */"
    for name in ("signals", "disturbance"):  # results side by side, as in a run's table
        yield f"#define {name.upper()}_RESULTS(out) {_side_by_side(manifest, name)}"
    for name, problem in problems.items():
        yield ""
        yield from _problem(name, problem)


def _side_by_side(manifest: Manifest, kernel: str) -> str:
    """Where each result of a kernel begins, in one row."""
    sizes = [size for _, size in manifest.function(kernel).outputs]
    return ", ".join(f"(out) + {sum(sizes[:i])}" for i in range(len(sizes)))


def _problem(name: str, constants: dict[str, Any]) -> Iterator[str]:
    """The fixed fields of a ``pmj_problem`` as a macro, and its arrays."""
    fields = [".max_step = HUGE_VAL", f".max_steps = {MAX_STEPS}"]
    for field, value in constants.items():
        if isinstance(value, np.ndarray):
            array = f"{name.lower()}_{field}"
            numbers = ", ".join(map(literal, value.tolist())) or "0.0"
            yield f"static const double {array}[] = {{{numbers}}};"
            fields.append(f".{field} = {array}")
        else:
            fields.append(f".{field} = {value if isinstance(value, int) else literal(value)}")
    yield f"#define {name}_PROBLEM {', '.join(fields)}"


def literal(value: float) -> str:
    """A number as C reads it back, to the bit."""
    return value.hex() if math.isfinite(value) else "HUGE_VAL"
