"""Every key of the design, of references and friction, of joints and systems, a whole bench: every command.

A joint and a system reach the commands by the record that all models are reduced to. These runs show that
nothing beside it depends on how a model was written.
"""

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
MUSCLES = """C1 = { value = 80.32, unit = "cm^2" }
C2 = { value = -128.5, unit = "cm^2" }
C3 = { value = 32, unit = "cm^2" }
C4 = { value = 0, unit = "N" }"""
PHYSICAL = """
schema = 1
name = "keys"
[parameters]
m = {{ value = 0.8, unit = "kg" }}
d = {{ value = 120, unit = "mm" }}
g = {{ value = 9.81, unit = "m/s^2" }}
M_c = {{ value = 0.25, unit = "N m" }}
u_max = {{ value = 5, unit = "V" }}
{parameters}
{physics}
[actuator]
{actuator}
[design]
bandwidth = 25
input_scale = "auto"
start = "matched"
[simulation]
reference = "{reference}"
x0 = {x0}
horizon = 1.2
sample_time = 0.005
"""
JOINT = """[joint]
keep = [{keep}]
J = {{ value = 500, unit = "kg cm^2" }}
b_v = {{ value = 0.109, unit = "N m s/rad" }}
{radius}
l0 = {{ value = 185, unit = "mm" }}
eps0 = {{ value = 0.15 }}
{muscles}
k0 = {{ value = 0.5, unit = "bar/V" }}
u0 = {{ value = 5, unit = "V" }}
k_u = {{ value = 0.5, unit = "bar/V" }}
P_max = {{ value = 5, unit = "bar" }}
{rest}
"""
RADIUS = 'r = { value = 15, unit = "mm" }'
GRAVITY = 'torque = "-m*g*d*sin(theta)"'
UNEQUAL = """muscle1 = { l0 = { value = 190, unit = "mm" } }
muscle2 = { C1 = { value = 78, unit = "cm^2" } }
r1 = { value = 14, unit = "mm" }
r2 = { value = 16, unit = "mm" }"""
JOINTS: dict[str, dict[str, str]] = {
    "torque": {
        "keep": '"damping", "torque", "gain"',
        "rest": f'{GRAVITY}\ndisturbance = "0.1*theta*theta_dot + 0.05*sin(3*t)"',
    },
    "dry": {
        "keep": '"damping"',
        "rest": f'{GRAVITY}\nfriction = "-M_c*sign(theta_dot) - 0.02*theta_dot"',
        "x0": "[0.0, 0.0]",
    },
    "torque-lag": {
        "keep": '"damping", "torque", "pressure_lag"',
        "rest": f'tau = {{ value = 60, unit = "ms" }}\n{GRAVITY}',
    },
    "unequal": {"keep": '"damping", "gain"', "rest": UNEQUAL, "radius": ""},
    "force": {
        "keep": '"damping", "torque"',
        "muscles": 'force = "P*(a3 - a1*eps)/(1 + eps) - F0*eps"',
        "parameters": 'a1 = { value = 120, unit = "cm^2" }\na3 = { value = 30, unit = "cm^2" }\n'
        'F0 = { value = 40, unit = "N" }',
        "rest": GRAVITY,
    },
    "preset": {
        "keep": '"damping", "torque", "gain"',
        "radius": 'r1 = { value = 14, unit = "mm" }\nr2 = "R0*(1 + theta/4)"',
        "muscles": 'force = "hunt-20"',
        "parameters": 'eps_max = { value = 0.25 }\nR0 = { value = 15, unit = "mm" }',
        "rest": f"{GRAVITY}\nrange = [-1, 1]",
    },
}
SYSTEMS = {
    "system": """[system]
states = ["q", "w"]
rates = ["w", "-m*g*d*sin(q)/0.05 - 2*w + 40*u/(1 + q**2)"]
output = "q"
disturbance = ["0", "0.2*sin(w)"]""",
    "magnet": """[system]
states = ["gap", "speed"]
rates = ["speed", "g - u/(m*gap**2)"]
output = "gap"
range = [0.2, 2]""",
    "transfer": """[system]
transfer_function = { num = ["40*m"], den = ["1", "2", "g"] }""",
}


PULLING = {"actuator": "lower = 0\nupper = 20", "reference": "1 - 0.1*cos(2*t)", "x0": "[0.95, 0.0]"}


def physical(name: str) -> str:
    """The text of a model with [joint] or [system]; a magnet only pulls, and its sigma has a pole."""
    usual = {"muscles": MUSCLES, "parameters": "", "radius": RADIUS, "x0": "[0.05, 0.0]"}
    usual |= {"actuator": 'limit = "u_max"', "reference": "0.3*(1 - cos(2*t))"}
    if name in SYSTEMS:
        return PHYSICAL.format(**{**usual, "physics": SYSTEMS[name], **(PULLING if name == "magnet" else {})})
    given = {**usual, **JOINTS[name]}
    return PHYSICAL.format(**{**given, "physics": JOINT.format(**given)})


GATES = ("proof", "interpreter", "lanes", "symbolic", "guards", "derivatives", "trajectory.invariants")


def write(folder: Path, name: str) -> str:
    text = MODEL.format(**{**USUAL, **VARIANTS[name]}) if name in VARIANTS else physical(name)
    (folder / "models").mkdir()
    file = folder / "models" / "keys.toml"
    file.write_text(
        text.replace("[-8, 3], [-8, -3]", "[8, 3]") if name == "poles" else text, encoding="utf-8"
    )
    return str(file)


@pytest.mark.skipif(find_compiler(os.environ) is None, reason="sweeps and tuning need a compiler")
@pytest.mark.parametrize("name", [*VARIANTS, *JOINTS, *SYSTEMS])
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
        axis = "d1=-4,-2" if name in VARIANTS else "m=0.8,0.6"  # of gravity, or of the gain
        axis = "b_v=0.109,0.2" if name == "unequal" else axis
        grid = ["--grid", axis, "--tolerance", "1e-9", "--out", str(out)]
        assert run(["sweep", model, *options, *grid]) == 0
        data = xarray.open_zarr(out / "sweep.zarr", consolidated=False)
        found = data["ise"].values
        assert found[0] == pytest.approx(told["ise"], rel=1e-6)
        assert found[1] != found[0]
        for key in {"stuck_s", "sticks"} & told.keys():
            one = told[key] if key == "stuck_s" else len(told[key])
            assert data[key].values[0] == pytest.approx(one, abs=1e-7)
        assert ("stuck_s" in told) is ("stuck_s" in data) is (name in ("friction", "bench", "dry"))
    capsys.readouterr()
    further = ("trajectory.independent",) if name == "magnet" else ()
    gates = [option for gate in (*GATES, *further) for option in ("--gate", gate)]
    assert run(["check", model, *gates, "--json"]) == 0, capsys.readouterr().out[:3000]
    capsys.readouterr()
    for form in ("text", "latex", "json", "markdown") if name in ("bench", "dry") else ("markdown",):
        assert run(["derive", model, "--format", form]) == 0
    tuned = tmp_path / "models" / "tuned.toml"
    interpreted = ["--no-figures", "--evaluator", "interpreted"]  # another compilation would show nothing
    short = ["--generations", "1", "--population", "3", "--no-figure", "--json", "--out", str(tuned)]
    capsys.readouterr()
    assert run(["tune", model, *short]) == 0, capsys.readouterr().err
    assert (
        run(["simulate", str(tuned), *interpreted, "--horizon", "0.2", "--out", str(tmp_path / "again")]) == 0
    )
