"""What a run accepts: each refusal is one clear line that names the setting and what is allowed."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.errors import ModelError, UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.simulate.settings import RunOptions, make_settings
from pmjoint_codegen.values import of_plant


@pytest.fixture(scope="module")
def manifest(root: Path) -> Manifest:
    return Manifest.read(root / "generated" / "paper")


def test_defaults_are_the_models(manifest: Manifest) -> None:
    settings = make_settings(manifest)
    assert settings.p.tolist() == [item.value for item in manifest.parameters]
    assert settings.x0.tolist() == [1.5, 0.0]
    assert (settings.horizon, settings.output_step, settings.sample_time) == (20.0, 0.01, 0.001)
    assert (settings.controller, settings.tolerance) == ("continuous", 1e-10)


def test_overrides_take_their_place(manifest: Manifest) -> None:
    settings = make_settings(manifest, parameters={"c1": 20, "u_max": 5.5}, compensator=False, x0=(1, 2))
    changed = dict(zip(manifest.parameter_names, settings.p.tolist(), strict=True))
    assert changed == {
        **{p.name: p.value for p in manifest.parameters},
        "c1": 20.0,
        "u_max": 5.5,
        "compensator": 0.0,
    }
    assert changed == settings.parameters
    assert settings.x0.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("asked", "believed", "true"),
    [
        ({}, 2.0, 2.0),
        ({"b0": 3}, 3.0, 3.0),
        ({"b0_plant": 3}, 2.0, 3.0),
        ({"b0": 3, "b0_plant": 2}, 3.0, 2.0),
    ],
)
def test_the_plant_is_as_believed_unless_it_is_set(
    manifest: Manifest, asked: dict[str, float], believed: float, true: float
) -> None:
    values = make_settings(manifest, parameters=asked).parameters
    assert (values["b0"], values["b0_plant"]) == (believed, true)
    assert ("b0_plant" in manifest.stated(values)) == (believed != true)
    assert of_plant(values, "b0") == true
    assert of_plant(values, "u_max") == 10.0


@pytest.mark.parametrize(
    ("asked", "parts"),
    [
        (
            {"parameters": {"u_max_plant": 1.0}},
            ("u_max is not used by plant and controller both", "b0_plant"),
        ),
        ({"parameters": {"b0_plant": float("nan")}}, ("b0_plant", "finite")),
        ({"parameters": {"u_mx": 1.0}}, ("'u_mx'", "did you mean u_max?", "d1, b0")),
        ({"parameters": {"zzzz": 1.0}}, ("'zzzz'", "names: d1")),
        ({"parameters": {"c1": float("nan")}}, ("c1", "nan", "finite")),
        ({"parameters": {"c1": float("inf")}}, ("c1", "inf", "finite")),
        ({"parameters": {"c1": "fast"}}, ("c1", "fast", "finite")),
        ({"parameters": {"c1": 0.0}}, ("c1", "greater than 0")),
        ({"parameters": {"ck2": -1.0}}, ("ck2", "greater than 0")),
        ({"parameters": {"u_max": 0.0}}, ("u_max", "greater than 0")),
        ({"parameters": {"b0": 0.0}}, ("b0", "b_m = 0")),
        ({"parameters": {"k1": -6.0}}, ("k", "unstable")),
        ({"parameters": {"compensator": 0.5}}, ("compensator", "1 (on) or 0 (off)")),
        ({"parameters": [1.0]}, ("parameters: is [1.0]", "numbers by name")),
        ({"x0": [1.0]}, ("x0: has 1 entry; paper has 2 states: x1, x2",)),
        ({"x0": [1.0, 2.0, 3.0]}, ("x0", "3 entries")),
        ({"x0": [1.0, float("nan")]}, ("x0, entry 2", "finite")),
        ({"x0": 1.0}, ("x0: has 1 entry;",)),
        ({"horizon": 0.0}, ("horizon", "greater than 0")),
        ({"horizon": -1.0}, ("horizon", "greater than 0")),
        ({"horizon": float("inf")}, ("horizon", "finite")),
        ({"output_step": 0.0}, ("output step", "greater than 0")),
        ({"output_step": 21.0}, ("output step", "at most 20 s")),
        ({"output_step": 1e-6}, ("output step", "20000001 rows", "10000000")),
        ({"horizon": 1e308, "output_step": 1e-10}, ("output step", "inf rows", "10000000")),
        ({"sample_time": 0.0}, ("sample time", "greater than 0")),
        (
            {"controller": "sampled", "sample_time": 30.0},
            ("sample time: is 30 s, longer than the horizon, 20 s; allowed: at most 20 s",),
        ),
        ({"controller": "sampled", "horizon": 0.0005}, ("sample time: is 0.001 s", "at most 0.0005 s")),
        ({"controller": "analog"}, ("controller", "continuous, sampled")),
        ({"tolerance": 1e-15}, ("tolerance", "1e-14", "0.001")),
        ({"tolerance": 0.1}, ("tolerance", "1e-14", "0.001")),
        ({"tolerance": float("nan")}, ("tolerance", "finite")),
    ],
)
def test_what_cannot_be_is_refused(manifest: Manifest, asked: dict[str, Any], parts: tuple[str, ...]) -> None:
    with pytest.raises(UsageError) as caught:
        make_settings(manifest, **asked)
    line = str(caught.value)
    assert "\n" not in line
    for part in parts:
        assert part in line


def test_a_keyword_that_no_run_has_is_an_error(manifest: Manifest) -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'horizn'"):
        make_settings(manifest, horizn=1.0)  # type: ignore[call-arg]


def test_the_front_door_explains_every_keyword_of_a_run() -> None:
    text = inspect.getdoc(ClosedLoop.simulate) or ""
    explained = re.findall(r"^    (\w+): ", text, re.MULTILINE)
    assert {*explained} >= {*RunOptions.__optional_keys__, "progress"}
    assert len({*explained}) == len(explained)


@pytest.mark.parametrize(
    ("horizon", "step", "expected"),
    [
        (20.0, 0.01, 2001),
        (1.0, 0.1, 11),
        (0.3, 0.1, 4),
        (0.07, 0.01, 8),  # a quotient that rounds to more than 7
        (1.0, 0.3, 5),
        (1.0, 1.0, 2),
        (1e-9, 1e-9, 2),
        (1000.0, 0.001, 1_000_001),
    ],
)
def test_output_instants_end_at_the_horizon_once(
    manifest: Manifest, horizon: float, step: float, expected: int
) -> None:
    times = make_settings(manifest, horizon=horizon, output_step=step).times()
    assert len(times) == expected
    assert times[0] == 0.0
    assert times[-1] == horizon
    assert np.all(np.diff(times) > 1e-9 * step)


def test_a_short_horizon_shortens_the_default_step_only(manifest: Manifest) -> None:
    assert make_settings(manifest, horizon=0.005).output_step == 0.005
    with pytest.raises(UsageError):
        make_settings(manifest, horizon=0.005, output_step=0.01)


@pytest.mark.parametrize(
    ("model", "asked", "said"),
    [
        ("joint", {"J": -0.05}, "J: is -0.05; allowed: a number greater than 0"),
        ("joint", {"k_u": 0.0}, "k_u: is 0; allowed: a number greater than 0"),
        ("joint", {"r": 0.0}, "r: is 0; allowed: a number greater than 0"),
        ("joint", {"J_plant": 0.0}, "J_plant: is 0; allowed: a number greater than 0"),
        ("joint", {"J": -0.05, "J_plant": 0.05}, "J: is -0.05; allowed: a number greater than 0"),
        ("joint-lag", {"tau": -0.1}, "tau: is -0.1; allowed: a number greater than 0"),
        (
            "joint",
            {"P_max": 1e5},
            "u0: the base pressure k0*u0 is not below P_max: P_max - k0*u0 = -150000; allowed: P_max - k0*u0",
        ),
        (
            "joint",
            {"u0_plant": 20.0},
            "u0_plant: the base pressure k0*u0 is not below P_max: P_max - k0_",
        ),
        (
            "joint",
            {"C1": 0.0, "C2": 0.0, "C3": 0.0},
            "b_m: no input acts: 2*k_u*r*(C1*eps0**2 + C2",
        ),
        (
            "third-order",
            {"T_z": -0.05},
            "zero dynamics are unstable: b_m s^m + ... + b_0 has the roots 20;",
        ),
        ("third-order", {"tau": 0.0}, "b_m ... b_0: has no finite value at these parameters; allowed: roots"),
    ],
)
def test_values_set_for_a_run_obey_the_rules_of_the_file(
    root: Path, model: str, asked: dict[str, float], said: str
) -> None:
    with pytest.raises(UsageError) as caught:
        make_settings(Manifest.read(root / "generated" / model), parameters=asked)
    assert said in str(caught.value)


@pytest.mark.parametrize("factor", [-1.0, 0.0, 0.5, 3.0])
@pytest.mark.parametrize("model", ["joint", "joint-lag"])
def test_a_run_refuses_what_the_file_refuses_and_nothing_else(root: Path, model: str, factor: float) -> None:
    manifest = Manifest.read(root / "generated" / model)
    document = read_document(root / "models" / f"{model}.toml")
    for name, line in document["joint"].items():
        if isinstance(line, dict):
            changed = {**line, "value": factor * line["value"]}
            file = {**document, "joint": {**document["joint"], name: changed}}
            try:
                model_of(file, "file")
            except ModelError:
                with pytest.raises(UsageError):
                    make_settings(manifest, parameters={name: changed["value"]})
            else:
                make_settings(manifest, parameters={name: changed["value"]})


def test_the_plant_may_be_what_no_design_presumes(root: Path) -> None:
    manifest = Manifest.read(root / "generated" / "third-order")
    assert make_settings(manifest, parameters={"T_z_plant": -0.05}).parameters["T_z_plant"] == -0.05


def test_states_beyond_the_design_s_may_be_left_out_as_in_the_file(root: Path) -> None:
    manifest = Manifest.read(root / "generated" / "joint-lag")
    assert make_settings(manifest, x0=[0.1, 0.2]).x0.tolist() == [0.1, 0.2, 0.0, 0.0]
    assert make_settings(manifest, x0=[0.1, 0.2, 3e4, 4e4]).x0.tolist() == [0.1, 0.2, 3e4, 4e4]
    states = "theta, theta_dot, q1, q2"
    line = f"x0: has 3 entries; joint-lag has 4 states: {states}; give 4, or 2 for q1, q2 = 0, 0"
    with pytest.raises(UsageError, match=f"^{line}$"):
        make_settings(manifest, x0=[0.1, 0.2, 0.3])


def test_one_sample_may_last_the_whole_run_and_an_idle_sample_time_does_not_matter(
    manifest: Manifest,
) -> None:
    asked: dict[str, Any] = {"horizon": 0.5, "sample_time": 0.5}
    assert make_settings(manifest, controller="sampled", **asked).sample_time == 0.5
    assert make_settings(manifest, controller="continuous", horizon=0.0005).sample_time == 0.001
