"""Models whose controller does not know some entries of Theta, made from any other model."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import sympy as sp

from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import parse_document
from pmjoint_derive import Model
from pmjoint_derive.adaptation import Adaptation, Entry, Inverse, LeastSquares

MODELS = Path(__file__).resolve().parent.parent.parent / "models"
LEAST_SQUARES = LeastSquares(kappa=1.0, forgetting=0.5, P0=5.0, k_max=100.0)
RANGE = (0.3, 6.0)  # of b_m, with its sign


def adaptive(
    model: Model,
    *,
    unknown: Collection[int] | None = None,
    guessed: Collection[int] = (),
    ranged: bool = True,
    inverse: bool = False,
    squares: bool = False,
    sign: int = 1,
    gain: float = 1.0,
) -> Model:
    """Return the model with estimates.

    Args:
        model: any.
        unknown: places in Theta of what is estimated; None: all.
        guessed: places of what is only guessed.
        ranged: whether every estimate has a range.
        inverse: whether 1/b_m is estimated too.
        squares: least squares in place of tuning functions.
        sign: of b_m.
        gain: of every estimate.
    """
    Theta = (*model.plant.b, *model.plant.theta)
    unknown = range(len(Theta)) if unknown is None else unknown
    entries = []
    for place, value in enumerate(Theta):
        if place not in unknown and place not in guessed:
            continue
        first, (low, high) = place == 0, RANGE
        ends = (-high, -low) if first and sign < 0 else RANGE if first else (-9.0, 9.0)
        entries.append(
            Entry(
                name_of(value, place),
                place,
                guess=1.2 * sign if first else 0.5,
                unknown=place in unknown,
                range=ends if ranged else None,
                gain=gain,
                prior=1.1 * sign if first else 0.4,
            )
        )
    found = Adaptation(
        tuple(entries),
        leakage=0.01,
        inverse=Inverse(0.8 * sign, gain, 0.1, 0.8 * sign) if inverse else None,
        least_squares=LEAST_SQUARES if squares else None,
    )
    return replace(model, design="adaptive", adaptation=found)


def name_of(value: sp.Expr, place: int) -> str:
    """Return the name of an entry of Theta: its own, or one by its place where it has none."""
    return str(value.name) if value.is_Symbol else f"Theta{place}"


def undisturbed_output(model: Model) -> Model:
    """Return the model with ``D_1 = 0``."""
    plant = model.plant
    return replace(model, plant=replace(plant, disturbance=(sp.Integer(0), *plant.disturbance[1:])))


def shipped_files() -> list[Path]:
    """Return every model file of the project."""
    return sorted([*MODELS.glob("*.toml"), *(MODELS / "gallery").glob("*.toml")])


def shipped(path: Path) -> Model:
    """Read a model file; a parameter V gets another name, since an adaptive design reports V."""
    text = re.sub(r"\bV(?= +=)|(?<=B/)V\b", "V_oil", path.read_text(encoding="utf-8"))
    return model_of(parse_document(text, str(path)), str(path))
