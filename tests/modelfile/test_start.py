"""``x0`` as a table: the list that it stands for, and what it refuses."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from tests.modelfile.edits import with_changes
from tests.modelfile.test_system import AXIS, TRANSFER, changed


def shipped(root: Path, name: str, x0: object) -> dict[str, Any]:
    document = tomllib.loads((root / "models" / f"{name}.toml").read_text(encoding="utf-8"))
    return with_changes(document, {"simulation.x0": x0})


def start_of(document: dict[str, Any]) -> tuple[float, ...]:
    return model_of(document, "m.toml").simulation.x0


@pytest.mark.parametrize(
    ("x0", "expected"),
    [
        ({"theta": 0.1, "P1": 2.6e5}, (0.1, 0.0, 1e4, 0.0)),  # P_0 is 2.5 bar
        ({"P2": 2.3e5, "theta_dot": 1}, (0.0, 1.0, 0.0, 2e4)),
        ({"q1": 5.0, "P2": 2.5e5}, (0.0, 0.0, 5.0, 0.0)),
        ({}, (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_a_joint_with_a_lag_starts_at_pressures(
    root: Path, x0: dict[str, float], expected: tuple[float, ...]
) -> None:
    assert start_of(shipped(root, "joint-lag", x0)) == expected


def test_the_base_pressure_is_that_of_the_file(root: Path) -> None:
    document = shipped(root, "joint-lag", {"P1": 2.5e5})
    bars = with_changes(document, {"joint.k0": {"value": 0.4, "unit": "bar/V"}})
    assert start_of(bars) == pytest.approx((0.0, 0.0, 5e4, 0.0))


def test_other_plants_have_their_own_names(root: Path) -> None:
    assert start_of(shipped(root, "joint", {"theta_dot": 0.5})) == (0.0, 0.5)
    assert start_of(shipped(root, "paper", {"x2": -1.0})) == (0.0, -1.0)
    assert start_of(with_changes(AXIS, {"simulation.x0": {"p": 2e4, "theta": 0.2}})) == (0.2, 0.0, 2e4)
    assert start_of(changed({**TRANSFER, "simulation.x0": {"x1": 0.3}})) == (0.3, 0.0)


def test_a_run_begins_at_the_named_pressures(root: Path, tmp_path: Path) -> None:
    text = (root / "models" / "joint-lag.toml").read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if line.startswith("x0 "))
    path = tmp_path / "named.toml"
    path.write_text(text.replace(line, "x0 = { theta = 0.05, P1 = 2.6e5, P2 = 2.3e5 }"), encoding="utf-8")
    run = ClosedLoop.load(str(path), notify=lambda line: None).simulate(horizon=0.01)
    first = [float(run[name][0]) for name in ("theta", "theta_dot", "P1", "P2")]
    assert first == pytest.approx([0.05, 0.0, 2.6e5, 2.3e5], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "x0", "line"),
    [
        (
            "joint-lag",
            {"thet": 1.0},
            "simulation.x0.thet: is no state; did you mean 'theta'? allowed: theta,",
        ),
        ("joint-lag", {"P1": 1.0, "q1": 1.0}, "simulation.x0: P1 and q1 are both given; give one of them"),
        ("joint", {"P1": 1.0}, "simulation.x0.P1: is no state; allowed: theta, theta_dot"),
        ("paper", {"x1": float("nan")}, "simulation.x0.x1: is no finite number; allowed: a finite number"),
        ("paper", {"x1": True}, "simulation.x0.x1: is no finite number"),
        ("paper", {"x1": "0"}, "simulation.x0.x1: is no finite number"),
        ("paper", {"x3": 0.0}, "simulation.x0.x3: is no state;"),
    ],
)
def test_a_mistake_is_one_line_with_its_key(root: Path, name: str, x0: dict[str, Any], line: str) -> None:
    with pytest.raises(ModelError) as caught:
        model_of(shipped(root, name, x0), "m.toml")
    assert str(caught.value).startswith(f"m.toml: {line}")
