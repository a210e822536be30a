"""A second design is one class and one row: it derives, emits, compiles and simulates like the first."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmjoint_codegen import ClosedLoop, modelfile
from pmjoint_codegen.identity import Document
from pmjoint_derive import Derivation, Design, Equation, Model, Plant, Signals, derivation, derive
from pmjoint_derive.adaptation import Adaptation
from pmjoint_derive.compensator import compensator_equations
from pmjoint_derive.equation import Identity, real_symbol
from pmjoint_derive.filters import filter_equations
from pmjoint_derive.lyapunov import estimation_identities
from pmjoint_derive.progress import Stage
from pmjoint_derive.signals import named

C, K, LIMIT, D1, B0 = (15.0, 15.0), (6.0, 8.0), 10.0, 0.2, 2.0


@dataclass(frozen=True)
class PlainFeedback(Design):
    """``v = -c_1 z_1 - sum c_i (x_hat_i - y_r^(i-1))`` with the filters (14), and no claim about it."""

    @classmethod
    def signals_for(cls, plant: Plant, adaptation: Adaptation | None) -> Signals:
        """One error, and no virtual control."""
        return replace(Signals.of(plant), z=named("z", 1), alpha=())

    filters = filter_equations
    compensator = compensator_equations  # which the model switches off

    def law(self, stage: Stage) -> list[Equation]:
        """``z_1`` and v."""
        s = self.signals
        z = s.z[0]
        estimates = [real_symbol(f"x_hat{i}") for i in range(2, self.plant.rho + 1)]
        v = -s.c[0] * z - sum(
            c * (x - rate) for c, x, rate in zip(s.c[1:], estimates, s.y_r[1:-1], strict=True)
        )
        return [
            Equation(z, s.y - s.y_r[0], "Plain feedback", "", "error", self.units.of(z)),
            Equation(s.v, v, "Plain feedback", "", "control law", self.units.of(s.v)),
        ]

    def error_rates(self) -> list[Equation]:
        """None is claimed."""
        return []

    @staticmethod
    def prove(derivation: Derivation) -> tuple[Identity, ...]:
        """The filters' claim (17), which no law changes."""
        return tuple(estimation_identities(derivation))

    @staticmethod
    def certificate(derivation: Derivation) -> tuple[Equation, ...]:
        """None."""
        return ()


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the row, and choose it for every model."""
    monkeypatch.setattr(derivation, "DESIGNS", {**derivation.DESIGNS, "plain": PlainFeedback})
    read = modelfile.model_of

    def model_of(document: Document, where: str = "") -> Model:
        return replace(read(document, where), design="plain")

    monkeypatch.setattr(modelfile, "model_of", model_of)


@pytest.mark.usefixtures("plain")
def test_it_derives_and_what_it_claims_holds(document: dict[str, Any]) -> None:
    found = derive(modelfile.model_of(document, "paper.toml"))
    assert str(found.equations["v"].expression) == "-c1*z1 - c2*(-dy_r + x_hat2)"
    assert not any(name.startswith(("alpha", "dalpha")) for name in found.equations)
    identities = found.design.prove(found)
    assert len(identities) == 2 and all(item.holds for item in identities)


def rates(t: float, X: np.ndarray) -> np.ndarray:
    """Rates of x, xi, Xi and lambda of the paper's example under this law, typed in again."""
    x, xi, Xi, lambda_ = X.reshape(4, 2)
    A0, e2 = np.array([[-K[0], 1.0], [-K[1], 0.0]]), np.array([0.0, 1.0])
    x_hat2 = xi[1] + D1 * Xi[1] + B0 * lambda_[1]
    v = -C[0] * (x[0] - np.sin(t)) - C[1] * (x_hat2 - np.cos(t))
    u = np.clip(v, -LIMIT, LIMIT)
    x_dot = np.array([x[1], D1 * x[0] + B0 * u + 0.1 * np.sin(x[1]) * np.cos(t)])
    filters = (A0 @ xi + np.array(K) * x[0], A0 @ Xi + e2 * x[0], A0 @ lambda_ + e2 * u)
    return np.concatenate([x_dot, *filters])


@pytest.mark.usefixtures("plain")
def test_it_simulates_through_the_same_pipeline(root: Path, tmp_path: Path) -> None:
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8")
    file = tmp_path / "plain.toml"
    file.write_text(text.replace('"paper"', '"plain"', 1), encoding="utf-8")
    environment = {**os.environ, "PMJOINT_CACHE": str(tmp_path / "cache")}
    loop = ClosedLoop.load(file, environment=environment, notify=lambda line: None)
    run = loop.simulate(horizon=5.0, output_step=0.5, compensator=False, x0=[3.0, 0.0])
    assert [item.name for item in loop.manifest.signals][:5] == ["y", "y_r", "e", "z1", "v"]
    assert run.summary["saturation_switches"]  # the law asks for -30 V at first
    start = np.concatenate([[3.0, 0.0], np.zeros(6)])
    exact = solve_ivp(rates, (0.0, 5.0), start, method="LSODA", t_eval=run.t, rtol=1e-11, atol=1e-12)
    found = np.stack([run[item.name] for item in loop.manifest.states])
    np.testing.assert_allclose(found[:8], exact.y, atol=1e-7)  # the clip's kinks cost LSODA some digits
    np.testing.assert_array_equal(found[8:], 0.0)
    sampled = loop.simulate(
        horizon=5.0, output_step=0.5, compensator=False, x0=[3.0, 0.0], controller="sampled"
    )
    assert np.max(np.abs(sampled["x1"] - run["x1"])) < 0.02  # first order in T = 1 ms, times gains of 15
