"""The gate of the exported C in closed loop, its driver and the bound that it judges by."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.check.gates import exported, exported_loop
from pmjoint_codegen.check.gates.exported_loop import STRIDE, Sensitivity, carried
from pmjoint_codegen.check.oracles.driven import drive
from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.emit.regenerate import regenerate
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.simulate import samples

SAMPLES = 1000
BRAKING = [
    ("[design]", '[design]\nsaturation = "braking"\nbraking = 0.5\nstart = "matched"'),
    ("compensator = true", ""),
]


def generated(text: str, name: str, folder: Path) -> Subject:
    """A model generated in a folder of its own."""
    (folder / "models").mkdir()
    file = folder / "models" / f"{name}.toml"
    file.write_text(text, encoding="utf-8")
    regenerate([str(file)])
    return load_subject(file, os.environ, lambda _line: None)


@pytest.mark.parametrize("name", ["bellows", "laas-axis"])
def test_real_systems_pass(name: str, root: Path, tmp_path: Path) -> None:
    text = (root / "models" / "gallery" / f"{name}.toml").read_text(encoding="utf-8")
    result = exported_loop.check(generated(text, name, tmp_path))
    assert result.verdict is Verdict.PASSED, result
    assert result.figure is not None and result.figure > 0.0


def test_a_braking_compensator_passes(root: Path, tmp_path: Path) -> None:
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8")
    for old, new in BRAKING:
        assert old in text
        text = text.replace(old, new)
    result = exported_loop.check(generated(text, "paper", tmp_path))
    assert result.verdict is Verdict.PASSED, result


@pytest.mark.parametrize("name", ["paper-adaptive", "lag-adaptive"])
def test_controllers_with_estimates_pass_from_either_start(name: str, root: Path, tmp_path: Path) -> None:
    text = (root / "models" / f"{name}.toml").read_text(encoding="utf-8")
    result = exported_loop.check(generated(text, name, tmp_path))
    assert result.verdict is Verdict.PASSED, result
    assert result.figure is not None and result.figure > 0.0


@pytest.mark.parametrize("old", ["params->b0_guess = 1.2", "params->gamma_d1 = 1.0", "params->d1_low = -3.0"])
def test_estimates_that_start_or_move_wrong_in_the_eleventh_digit_are_seen(
    old: str, root: Path, tmp_path: Path
) -> None:
    text = (root / "models" / "paper-adaptive.toml").read_text(encoding="utf-8")
    subject = generated(text, "paper-adaptive", tmp_path)
    if subject.compiler is None or subject.compiled is None:
        pytest.skip("no C compiler")
    export = exported.load(subject, subject.compiler).export
    prefix = export.identity.prefix
    assert export.source.count(f"{old};") == 1
    source = export.source.replace(f"{old};", f"{old} * (1.0 + 1e-10);")
    source = source.replace("first = (start * ROWS) + k + 1;", "first = 0;")
    (tmp_path / f"{prefix}.h").write_text(export.files[f"{prefix}.h"], encoding="utf-8")
    (tmp_path / f"{prefix}.c").write_text(source, encoding="utf-8")
    build = [*subject.compiler.command, "-std=c99", "-O1", "-ffp-contract=off", "-fPIC", "-shared"]
    subprocess.run([*build, f"{prefix}.c", "-o", "a.so", "-lm"], cwd=tmp_path, check=True)
    loaded = Exported.open(export, tmp_path / "a.so")
    result = exported_loop.judge(loaded, subject.compiled, subject.tapes, SAMPLES)
    assert result.verdict is Verdict.FAILED, result


def test_a_quantised_reading_has_no_bound(root: Path, tmp_path: Path) -> None:
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8") + "\n[sensor]\nresolution = 0.001\n"
    result = exported_loop.check(generated(text, "paper", tmp_path))
    assert result.verdict is Verdict.NOT_RUN
    assert "sensor" in result.detail


@pytest.mark.parametrize("old", ["params->b0 = 2.0", "params->c2 = 15.0", "params->k1 = 6.0"])
def test_a_default_that_is_wrong_in_the_eleventh_digit_is_seen(
    old: str, paper: Subject, tmp_path: Path
) -> None:
    if paper.compiler is None or paper.compiled is None:
        pytest.skip("no C compiler")
    loaded = exported.load(paper, paper.compiler)
    export = loaded.export
    prefix = export.identity.prefix
    name, _, value = old.partition(" = ")
    assert export.source.count(f"{old};") == 1
    source = export.source.replace(f"{old};", f"{name} = {float(value) * (1.0 + 1e-10)!r};")
    (tmp_path / f"{prefix}.h").write_text(export.files[f"{prefix}.h"], encoding="utf-8")
    (tmp_path / f"{prefix}.c").write_text(source, encoding="utf-8")
    build = [*paper.compiler.command, "-std=c99", "-O1", "-ffp-contract=off", "-fPIC", "-shared"]
    subprocess.run([*build, f"{prefix}.c", "-o", "a.so", "-lm"], cwd=tmp_path, check=True)
    wrong = Exported.open(export, tmp_path / "a.so")
    right = exported_loop.judge(loaded, paper.compiled, paper.tapes, SAMPLES)
    assert right.verdict is Verdict.PASSED, right
    found = exported_loop.judge(wrong, paper.compiled, paper.tapes, SAMPLES)
    assert found.verdict is Verdict.FAILED
    assert found.difference is not None


class _Kernels:
    """The kernels' own law in the place of an exported controller."""

    def __init__(self, call: Callable[..., tuple[Array, ...]], settings: Any, hold: Array, n: int) -> None:
        self.call, self.p, self.hold = call, settings.p, hold
        self.states, self.y, self.output = np.zeros(n), 0.0, SimpleNamespace(v=0.0, u=0.0)
        self.y_r, self.ready = np.zeros(0), False

    def step(self, y: float, y_r: Array) -> int:
        if self.ready:
            held = ([self.y], self.states, self.y_r, [self.output.u], [self.output.v])
            (self.states,) = self.call("sampled_update", *held, self.hold, self.p)
        v = float(self.call("law", [y], self.states, y_r, self.p)[2][0])
        lower, upper = self.call("actuation", self.p)[0].reshape(-1, 4)[0, 2:]
        self.output.v, self.output.u = v, min(max(v, lower), upper)
        self.y, self.y_r, self.ready = y, y_r, True
        return 0


def test_the_driver_with_the_kernels_own_law_is_simulate_bit_for_bit(paper: Subject) -> None:
    if paper.compiled is None:
        pytest.skip("no C compiler")
    recorded = samples.record(paper.compiled, "zero", SAMPLES)
    assert not isinstance(recorded, str)
    settings = samples.run_settings(paper.manifest, "zero", SAMPLES)
    kernels: Any = _Kernels(paper.compiled.call, settings, recorded.hold, recorded.s.shape[1])
    driven = drive(kernels, paper.compiled, settings)
    assert not isinstance(driven, str)
    assert np.array_equal(driven.x, recorded.x)
    assert np.array_equal(driven.s, recorded.s)
    assert np.array_equal(driven.v, recorded.v)
    assert driven.steps == recorded.steps


def test_the_map_that_is_differentiated_has_the_slopes_of_the_run(paper: Subject) -> None:
    """Against differences of the compiled sample: for the plant, and for every state of the controller."""
    if paper.compiled is None:
        pytest.skip("no C compiler")
    recorded = samples.record(paper.compiled, "zero", 60)
    assert not isinstance(recorded, str)
    manifest, T = paper.manifest, paper.manifest.simulation.sample_time
    found = exported_loop.sensitivity(paper.tapes, recorded, T, manifest, 1)
    assert isinstance(found, Sensitivity)
    k, n, nx = 40, manifest.nX, manifest.nx
    X = np.concatenate([recorded.x[k], recorded.s[k]])

    def following(X: Array) -> tuple[Array, float]:
        assert paper.compiled is not None
        v, _, c, s = paper.compiled.call("sample", [recorded.t[k]], X, recorded.hold, recorded.p[k])
        powers = T ** np.arange(manifest.hold_order + 1)
        return np.concatenate([powers @ c.reshape(len(powers), -1)[:, :nx], s]), float(v[0])

    for i in range(n):
        step = 1e-4 * np.eye(n)[i]
        (above, v_above), (below, v_below) = following(X + step), following(X - step)
        assert np.allclose((above - below) / 2e-4, found.dX[k, :, i], rtol=1e-6, atol=1e-7)
        assert np.isclose((v_above - v_below) / 2e-4, found.v_X[k, i], rtol=1e-6, atol=1e-5)


def test_errors_are_carried_to_every_compared_sample() -> None:
    rng = np.random.default_rng(7)
    rows, n = 3 * STRIDE + 5, 3
    dX = np.eye(n) + 0.1 * rng.standard_normal((rows - 1, n, n))
    v_X = rng.standard_normal((rows, n))
    found = Sensitivity(dX, np.zeros((rows - 1, n)), np.zeros((rows - 1, n, 1)), v_X)
    local, first = rng.random((rows - 1, n)), rng.random(n)
    X, v = carried(found, local, first)
    for place, k in enumerate(range(0, rows, STRIDE)):
        expected, of_v = np.zeros(n), 0.0
        for j in range(k + 1):  # the error that enters into X[j]
            onward = np.linalg.multi_dot([np.eye(n), np.eye(n), *dX[j:k][::-1]])
            error = first if j == 0 else local[j - 1]
            expected += np.abs(onward) @ error
            of_v += float(np.abs(v_X[k] @ onward) @ error)
        assert np.allclose(X[place], expected)
        assert np.isclose(v[place], of_v)
