"""Every key of the design, of references and of friction, and a whole bench, through every command."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler

MODEL = """
schema = 1
name = "keys"
parameters = {{ d1 = {{ value = -4.0 }}, b0 = {{ value = 20.0 }}, u_max = {{ value = 3.0 }} }}
[plant]
order = 2
phi = ["-2*y", "0"]
Phi = [["0"], ["y"]]
theta = ["d1"]
b = ["b0"]
disturbance = ["0", "{disturbance}"]
[actuator]
{actuator}
[design]
{design}
[simulation]
reference = {reference}
x0 = [0.3, 0.6]
horizon = 1.5
sample_time = 0.005
{rest}
"""
USUAL = {
    "disturbance": "0.1*sin(x2)",
    "actuator": 'limit = "u_max"',
    "design": "c = [5, 5]\ne = [0.1, 1e-3]\nck = [4, 4]\nk = [20, 100]",
    "reference": '"0.4*(1 - cos(2*t))"',
    "rest": "",
}
BENCH = {
    "disturbance": "-0.5*sign(x2 - 2*x1)",
    "actuator": "lower = -2\nupper = 3\nrate = 60\ndead_zone = 0.1\ndelay = 0.002\nlag = 0.004",
    "design": 'bandwidth = 6\ninput_scale = "auto"\nsaturation = "braking"\nstart = "matched"',
    "reference": "{ steps = [[0, 0.3], [0.2031, 0.5], [0.9, 0.1]], filter = 9 }",
    "rest": "delay_samples = 1\njitter = 0.0004\n[sensor]\nresolution = 0.0005\nnoise = 0.0003\nseed = 3",
}
VARIANTS: dict[str, dict[str, str]] = {
    "input_scale": {"design": USUAL["design"] + '\ninput_scale = "auto"'},
    "poles": {"design": USUAL["design"].replace("k = [20, 100]", "poles = [[-8, 3], [-8, -3]]")},
    "bandwidth": {"design": "bandwidth = 6"},
    "matched": {"design": USUAL["design"] + '\nstart = "matched"'},
    "clip": {"design": USUAL["design"] + '\nsaturation = "clip"'},
    "braking": {"design": USUAL["design"] + '\nsaturation = "braking"\nbraking = 0.6'},
    "steps": {"reference": "{ steps = [[0, 0.3], [0.2031, 0.5], [0.9, 0.1]] }"},
    "filter": {"reference": "{ ramps = [[0, 0.3], [0.5, 0.5], [1.0, 0.1]], filter = 9 }"},
    "friction": {"disturbance": "-3*sign(x2 - 2*x1)", "reference": "{ steps = [[0, 0.3], [0.7, 0.5]] }"},
    "limits": {"actuator": "lower = -0.5\nupper = 2.5\ndead_zone = 0.1\nlag = 0.004"},
    "bench": BENCH,
}
GATES = ("proof", "interpreter", "lanes", "symbolic", "guards", "derivatives", "trajectory.invariants")


def write(folder: Path, name: str) -> str:
    text = MODEL.format(**{**USUAL, **VARIANTS[name]})
    (folder / "models").mkdir()
    file = folder / "models" / "keys.toml"
    file.write_text(
        text.replace("[-8, 3], [-8, -3]", "[8, 3]") if name == "poles" else text, encoding="utf-8"
    )
    return str(file)


@pytest.mark.skipif(find_compiler(os.environ) is None, reason="sweeps and tuning need a compiler")
@pytest.mark.parametrize("name", VARIANTS)
def test_a_key_passes_through_every_command(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    xarray = pytest.importorskip("xarray")
    model = write(tmp_path, name)
    assert run(["regenerate", model]) == 0
    for controller in ("sampled",) if name == "bench" else ("continuous", "sampled"):
        loops = [ClosedLoop.load(model, evaluator=kind) for kind in ("compiled", "interpreted")]
        fast, slow = (loop.simulate(horizon=0.4, controller=controller) for loop in loops)
        np.testing.assert_array_equal(fast.states, slow.states)
        np.testing.assert_array_equal(fast.signals, slow.signals)
        capsys.readouterr()
        options = ["--controller", controller, "--no-figures"]
        single = [
            "simulate",
            model,
            *options,
            "--tolerance",
            "1e-9",
            "--json",
            "--out",
            str(tmp_path / "run"),
        ]
        assert run(single) == 0
        told = json.loads(capsys.readouterr().out)
        out = tmp_path / f"sweep-{controller}"
        grid = ["--grid", "d1=-4,-2", "--tolerance", "1e-9", "--out", str(out)]
        assert run(["sweep", model, *options, *grid]) == 0
        data = xarray.open_zarr(out / "sweep.zarr", consolidated=False)
        found = data["ise"].values
        assert found[0] == pytest.approx(told["ise"], rel=1e-6)
        assert found[1] != found[0]
        for key in {"stuck_s", "sticks"} & told.keys():
            one = told[key] if key == "stuck_s" else len(told[key])
            assert data[key].values[0] == pytest.approx(one, abs=1e-7)
        assert ("stuck_s" in told) is ("stuck_s" in data) is (name in ("friction", "bench"))
    capsys.readouterr()
    gates = [option for gate in GATES for option in ("--gate", gate)]
    assert run(["check", model, *gates, "--json"]) == 0, capsys.readouterr().out[:3000]
    capsys.readouterr()
    for form in ("text", "latex", "json", "markdown"):
        assert run(["derive", model, "--format", form]) == 0
    tuned = tmp_path / "models" / "tuned.toml"
    short = ["--generations", "1", "--population", "3", "--no-figure", "--json", "--out", str(tuned)]
    capsys.readouterr()
    assert run(["tune", model, *short]) == 0, capsys.readouterr().err
    assert (
        run(["simulate", str(tuned), "--no-figures", "--horizon", "0.2", "--out", str(tmp_path / "again")])
        == 0
    )
