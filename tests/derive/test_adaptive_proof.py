"""The adaptive design is proved in every order and variant, and no mutant of it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import Derivation, Model, derive, real_symbol
from pmjoint_derive.adaptive import Adaptive
from pmjoint_derive.adaptive_proof import prove
from pmjoint_derive.consistency import consistency_identities
from pmjoint_derive.equation import Equations
from pmjoint_derive.estimation import inverse_pull, sensitivity
from pmjoint_derive.sparse import remainder
from pmjoint_derive.tuning import Tuning
from tests.derive.adaptive_models import adaptive, undisturbed_output

S = real_symbol
ROOT = Path(__file__).resolve().parent.parent.parent
MODELS = sorted([*(ROOT / "models").glob("*.toml"), *(ROOT / "models" / "gallery").glob("*.toml")])
ORDERS = ((1, 1), (2, 1), (2, 2), (3, 2), (3, 3))
Change = Callable[[sp.Expr], sp.Expr]


def broken(derivation: Derivation) -> list[str]:
    """Return the names of identities that do not hold."""
    return [item.name for item in prove(derivation) if not item.holds]


@pytest.mark.parametrize("order", ORDERS, ids=lambda order: f"n{order[0]}rho{order[1]}")
@pytest.mark.parametrize(
    "variant",
    [
        {},
        {"ranged": False},
        {"inverse": True},
        {"inverse": True, "ranged": False, "sign": -1},
        {"unknown": (0,)},
        {"unknown": (-1,), "guessed": (0,)},
        {"squares": True},
        {"squares": True, "ranged": False, "sign": -1},
    ],
    ids=lambda variant: "-".join(map(str, variant)) or "all",
)
def test_every_identity_holds(
    builder: Callable[..., Model], order: tuple[int, int], variant: dict[str, Any]
) -> None:
    if variant.get("squares") and order[1] > 2:
        pytest.skip("least squares has no law beyond relative degree 2")
    model = builder(*order)
    last = len(model.plant.b) + model.plant.p - 1
    variant = variant | ({"unknown": (last,)} if variant.get("unknown") == (-1,) else {})
    derivation = derive(adaptive(model, **variant))
    identities = (*prove(derivation), *consistency_identities(derivation))
    assert [item.name for item in identities if not item.holds] == []
    assert len({item.name for item in identities}) == len(identities)


@pytest.mark.parametrize("order", [(1, 1), (2, 2)])
def test_every_identity_holds_where_nothing_disturbs_the_output(
    builder: Callable[..., Model], order: tuple[int, int]
) -> None:
    assert broken(derive(adaptive(undisturbed_output(builder(*order))))) == []


def test_order_four_is_proved(builder: Callable[..., Model]) -> None:
    assert broken(derive(adaptive(builder(4, 4, nonlinear=False)))) == []


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_shipped_model_is_proved_with_everything_unknown(path: Path) -> None:
    model = model_of(read_document(path), str(path))
    if any(item.name == "V" for item in model.parameters):
        pytest.skip("a parameter has the name of the Lyapunov function, which is refused")
    assert broken(derive(adaptive(model))) == []
