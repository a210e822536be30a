"""A model with every key of actuator, sensor and clock, through every command."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler

MODEL = """
schema = 1
name = "bench"
parameters = { d1 = { value = 0.2 }, b0 = { value = 2.0 }, bit = { value = 0.0015, unit = "rad" } }
[plant]
order = 2
Phi = [["0"], ["y"]]
theta = ["d1"]
b = ["b0"]
[actuator]
lower = -6
upper = 10
rate = 200
dead_zone = 0.5
lag = 0.01
delay = 0.003
[sensor]
resolution = "bit"
noise = 0.001
seed = 7
filter = 400
[design]
c = [5, 5]
e = [0.1, 0.1]
ck = [1, 1]
k = [6, 8]
[simulation]
reference = "sin(t)"
x0 = [0.5, 0.0]
horizon = 1.0
sample_time = 0.005
delay_samples = 1
jitter = 0.0004
"""
OWN = ("upper", "rate", "dead_zone", "dead_zone_plant", "lag", "delay", "bit", "noise", "seed", "filter")
KEYS = (*OWN, "delay_samples", "jitter")

compiler = pytest.mark.skipif(find_compiler(os.environ) is None, reason="sweeps and tuning need a compiler")


@pytest.fixture
def model(tmp_path: Path) -> str:
    (tmp_path / "models").mkdir()
    path = tmp_path / "models" / "bench.toml"
    path.write_text(MODEL, encoding="utf-8")
    return str(path)


def ise(model: str, folder: Path, capsys: pytest.CaptureFixture[str], *options: str) -> float:
    assert run(["simulate", model, "--no-figures", "--json", "--out", str(folder), *options]) == 0
    return float(json.loads(capsys.readouterr().out)["ise"])


def test_every_key_is_a_parameter_that_changes_a_run(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    usual = ise(model, tmp_path, capsys)
    other = {"upper": "0.7", "rate": "20", "seed": "8", "delay_samples": "0"}
    for name in KEYS:
        value = other.get(name, "0.0002" if name == "jitter" else "0.06" if name == "lag" else "0.02")
        options = ["--set", f"{name}={value}"]
        if name == "upper":  # reached from below the reference
            options += ["--x0=-0.5,0"]
            assert ise(model, tmp_path, capsys, *options) != ise(model, tmp_path, capsys, "--x0=-0.5,0")
        else:
            assert ise(model, tmp_path, capsys, *options) != usual, name


def test_the_continuous_controller_says_what_it_leaves_out(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["simulate", model, "--no-figures", "--json", "--out", str(tmp_path)]
    assert run([*command, "--controller", "continuous"]) == 0
    told = capsys.readouterr()
    keys = "rate, delay, resolution, noise, seed, filter, delay_samples, jitter"
    assert f"pmjoint: the continuous controller has no clock and leaves out: {keys}\n" in told.err
    assert json.loads(told.out)["left_out"] == keys.split(", ")
    assert run(command) == 0
    told = capsys.readouterr()
    assert "leaves out" not in told.err and json.loads(told.out)["controller"] == "sampled"


@compiler
def test_every_key_is_an_axis_and_so_is_the_sample_time(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    xarray = pytest.importorskip("xarray")
    axes = {**dict.fromkeys(OWN[2:5], "0.011,0.3"), "rate": "20,60", "sample_time": "0.004,0.01,3"}
    for name, values in axes.items():
        out = tmp_path / name
        given = ["--grid", f"{name}={values}", "--grid", "seed=1,2", "--no-figures", "--out", str(out)]
        assert run(["sweep", model, *given]) == 0
        capsys.readouterr()
        data = xarray.open_zarr(out / "sweep.zarr", consolidated=False)
        found = data["ise"].values[:2]
        assert len({*found.ravel().tolist()}) == 4, (name, found)
        if name == "sample_time":
            assert data["sample_time"].attrs["units"] == "s"
            assert not data["ise"].values[2:].size or (data["status"].values[2:] == 8).all()  # 3 s > horizon


@compiler
def test_a_tuner_draws_seeds_and_valves(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plants = ["--perturb", "seed~integers(1,99)", "--perturb", "dead_zone~uniform(0.3,0.7)", "--plants", "3"]
    short = ["--generations", "2", "--population", "3", "--no-figure", "--json"]
    file = tmp_path / "models" / "tuned.toml"
    assert run(["tune", model, *plants, *short, "--out", str(file)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["worst"]["objective"]["after"] < told["worst"]["objective"]["before"]
    assert 'resolution = "bit"' in file.read_text(encoding="utf-8")


@compiler
def test_regenerate_check_and_derive(model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["regenerate", model]) == 0
    assert run(["regenerate", model, "--check"]) == 0
    capsys.readouterr()
    gates = ["proof", "interpreter", "lanes", "symbolic", "guards", "derivatives", "trajectory.invariants"]
    wanted = [option for gate in gates for option in ("--gate", gate)]
    assert run(["check", model, *wanted, "--json"]) == 0
    capsys.readouterr()
    for form in ("text", "latex", "json", "markdown"):
        assert run(["derive", model, "--format", form]) == 0
        assert "valve" in capsys.readouterr().out.replace("\\", "")


def test_a_seed_is_drawn_as_a_whole_number_between_its_ends() -> None:
    import numpy as np

    from pmjoint_codegen.sweep.plan import make_plan

    drawn = make_plan((), ("seed~integers(3,6)",), 400, 1, "latin-hypercube").drawn["seed"]
    assert np.unique(drawn).tolist() == [3.0, 4.0, 5.0, 6.0]
    assert np.unique(drawn, return_counts=True)[1].tolist() == [100, 100, 100, 100]
