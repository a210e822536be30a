"""One plant in SI units and in deg, bar and mV: columns and metrics differ by the factor alone."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.cli.main import run as command
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.export.fields import parameter_fields
from pmjoint_codegen.export.package import export_c
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.statements import program_of
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.report.text import text_report
from pmjoint_codegen.simulate.run import Run
from pmjoint_derive import derive

DEG, BAR = math.pi / 180, 1e5
FILE = """
schema = 1
name = "axis"
[parameters]
J = {{ value = 500, unit = "kg cm^2" }}
B = {{ value = 0.109, unit = "N m s/rad" }}
G = {{ value = 4.7, unit = "N m" }}
K = {{ value = 4.358, unit = "N m/bar" }}
tau = {{ value = 200, unit = "ms" }}
amplitude = {{ value = 0.3, unit = "rad" }}
w = {{ value = 120, unit = "deg/s" }}
noise = {{ value = 0.02, unit = "deg" }}
u_max = {{ value = 0.3, unit = "bar" }}
[system]
states = ["theta", "omega", "p"]
rates = ["omega", "(K*p - B*omega - G*sin(theta))/J", "(u - p)/tau"]
output = "theta"
units = {units}
disturbance = ["0", "2*sin(3*t) - 0.1*omega**3 - 0.2*abs(omega + 30)", "100*theta*omega"]
range = {range}
[actuator]
limit = "u_max"
dead_zone = {dead_zone}
rate = {rate}
lag = 0.004
[sensor]
resolution = {resolution}
noise = "noise"
seed = 3
filter = 200
[units]
y = "{y}"
u = "{u}"
[design]
bandwidth = 20
input_scale = {scale}
start = "matched"
[simulation]
reference = "amplitude*(1 - cos(w*t)) + {offset}"
x0 = {x0}
horizon = 0.5
sample_time = 0.005
output_step = 0.005
"""


@dataclass(frozen=True)
class Twin:
    """One way to write the file.

    Attributes:
        y: unit of y.
        u: unit of u and p.
        of_y: SI units in one of y's.
        of_u: SI units in one of u's.
    """

    y: str
    u: str
    of_y: float
    of_u: float

    def write(self, folder: Path, scale: object = '"auto"') -> Path:
        """Write the file with its numbers in these units."""
        y, u = self.of_y, self.of_u
        text = FILE.format(
            y=self.y,
            u=self.u,
            units=json.dumps([self.y, f"{self.y}/s", self.u]),
            range=[-1.5 / y, 1.5 / y],
            dead_zone=repr(2e3 / u),
            rate=repr(5e6 / u),
            resolution=repr(2e-4 / y),
            offset=repr(0.05 / y),
            x0=[0.1 / y, -0.2 / y, 3e4 / u],
            scale=scale,
        )
        path = folder / f"axis-{self.y}-{len(str(scale))}.toml"
        path.write_text(text, encoding="utf-8")
        return path

    def factor(self, column: str) -> float:
        """SI units in one of a column's."""
        if column in ("p", "v", "u", "u_command", "u_valve", "x4") or column.startswith(("lambda", "alpha")):
            return self.of_u
        return self.of_u if column.startswith("z") and column != "z1" else self.of_y


SI, OTHER = Twin("rad", "Pa", 1.0, 1.0), Twin("deg", "bar", DEG, BAR)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("units")
    return SI.write(folder), OTHER.write(folder)


def loaded(path: Path, evaluator: str = "compiled") -> ClosedLoop:
    return ClosedLoop.load(str(path), evaluator, notify=lambda line: None)


@pytest.fixture(scope="module")
def loops(files: tuple[Path, Path]) -> tuple[ClosedLoop, ClosedLoop]:
    return loaded(files[0]), loaded(files[1])


def assert_twins(one: Run, other: Run, twin: Twin = OTHER) -> None:
    """Compare all columns: local errors of all steps, relative to a column's size, may add up."""
    within = 1e-10 * max(one.steps, other.steps)
    names = [item.name for item in (*one.manifest.states, *one.manifest.signals)]
    assert names == [item.name for item in (*other.manifest.states, *other.manifest.signals)]
    for name in names:
        size = np.abs(one[name]).max()
        difference = np.abs(one[name] - twin.factor(name) * other[name]).max()
        assert difference <= within * size, (name, difference, size)


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_a_run_in_other_units_is_the_same_run(controller: str, loops: tuple[ClosedLoop, ClosedLoop]) -> None:
    one, other = (loop.simulate(controller=controller) for loop in loops)
    assert_twins(one, other)
    assert np.abs(other["u"]).max() == pytest.approx(0.28, abs=1e-9)  # of the 0.3 bar, 0.02 are dead
    assert np.abs(other["y"]).max() > 9.0
    units = other.summary["units"]
    expected = {"y": "deg", "theta": "deg", "omega": "deg/s", "p": "bar", "v": "bar", "amplitude": "rad"}
    assert {name: units[name] for name in expected} == expected
    assert other.summary["ise"] * DEG**2 == pytest.approx(one.summary["ise"], rel=1e-6)
    assert other.summary["parameters"]["input_scale"] == pytest.approx(
        one.summary["parameters"]["input_scale"], rel=1e-14
    )


def test_the_interpreter_has_the_same_bits(
    files: tuple[Path, Path], loops: tuple[ClosedLoop, ClosedLoop]
) -> None:
    pytest.importorskip("casadi")
    asked: dict[str, Any] = {"controller": "sampled", "horizon": 0.1}
    one, two = loops[1].simulate(**asked), loaded(files[1], "interpreted").simulate(**asked)
    for item in one.manifest.signals:
        np.testing.assert_array_equal(one[item.name], two[item.name])


def test_values_for_one_run_are_in_the_units_of_the_file(loops: tuple[ClosedLoop, ClosedLoop]) -> None:
    """The start in deg, deg/s and bar; a parameter in its own unit, and gains as they are in SI units."""
    gains = {"input_scale": 0.01, "e2": 1e-3, "c1": 15.0, "u_max": 0.25, "noise": 0.1, "J_plant": 600.0}
    starts = ([0.2, 0.1, 1e4], [0.2 / DEG, 0.1 / DEG, 0.1])
    pair = [
        loop.simulate(x0=x0, parameters=gains, controller="sampled")
        for loop, x0 in zip(loops, starts, strict=True)
    ]
    assert_twins(pair[0], pair[1])
    assert pair[1].summary["parameters"]["u_max"] == 0.25


def test_a_stated_input_scale_is_that_of_si_units(tmp_path: Path) -> None:
    """Kappa weighs z_2 against z_1: in these units by U/Y times the number of the file."""
    path = OTHER.write(tmp_path, 0.02)
    model = model_of(read_document(path), str(path))
    derivation = derive(model)
    assert model.gains.input_scale == pytest.approx(0.02 * BAR / DEG, rel=1e-15)
    assert "input_scale = 0.02 " in text_report(model, derivation.equations.values())


def test_a_reference_from_a_file_has_the_unit_it_states(
    tmp_path: Path, loops: tuple[ClosedLoop, ClosedLoop]
) -> None:
    table = tmp_path / "gait.csv"
    table.write_text("t,y\n0,5\n0.2,9\n0.5,3\n", encoding="utf-8")
    given = {"file": str(table), "time": "t", "column": "y", "unit": "deg", "filter": 30.0}
    one, other = (loop.simulate(reference=given, controller="sampled") for loop in loops)
    assert_twins(one, other)
    assert other["y_r"][0] == pytest.approx(5.0, rel=1e-12)


def test_a_joint_in_degrees_and_millivolts_is_the_same_joint(root: Path, tmp_path: Path) -> None:
    text = (root / "models" / "joint-lag.toml").read_text(encoding="utf-8")
    assert 'unit = "V", about = "min(' in text
    text = text.replace('"0.3*(1 - cos(t))"', f'"{0.3 / DEG!r}*(1 - cos(t))"')
    path = tmp_path / "joint-deg.toml"
    path.write_text(f'{text}\n[units]\ny = "deg"\nu = "mV"\n', encoding="utf-8")
    asked: dict[str, Any] = {"controller": "sampled", "horizon": 1.0, "output_step": 0.005}
    one = ClosedLoop.load("joint-lag").simulate(x0=[0.1, 0.2, 1e4, -2e4], **asked)
    other = loaded(path).simulate(x0=[0.1 / DEG, 0.2 / DEG, 1e4, -2e4], **asked)
    pressures = ("P1", "P2", "q1", "q2", "x4")  # no unit of the file is theirs
    twin = Twin("deg", "mV", DEG, 1e-3)
    within = 1e-10 * one.steps
    for item in one.manifest.signals:
        factor = 1.0 if item.name in pressures else twin.factor(item.name)
        difference = np.abs(one[item.name] - factor * other[item.name]).max()
        assert difference <= within * np.abs(one[item.name]).max(), item.name
    units = other.summary["units"]
    assert (units["theta"], units["theta_dot"], units["u"], units["P1"]) == ("deg", "deg/s", "mV", "Pa")


def test_the_controller_that_steps_takes_and_gives_the_units_of_the_file(
    loops: tuple[ClosedLoop, ClosedLoop],
) -> None:
    one, other = (loop.controller(sample_time=0.005) for loop in loops)
    for k in range(40):
        y = 0.1 * math.cos(0.3 * k)
        first, second = one.step(y), other.step(y / DEG)
        assert second * BAR == pytest.approx(first, rel=1e-9, abs=1e-9 * 3e4)
        assert other.v * BAR == pytest.approx(one.v, rel=1e-9)


def test_the_exported_controller_has_the_units_of_the_file(
    files: tuple[Path, Path], loops: tuple[ClosedLoop, ClosedLoop], cache: Path
) -> None:
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    document = read_document(files[1])
    made = export_c(derive(model_of(document, "axis")), Identity("axis", "0" * 64, "test"), DOUBLE)
    exported, stepping = Exported.load(made, compiler, cache), loops[1].controller()
    constant = np.array([3.0, 0.0, 0.0, 0.0])
    stepping.reset(5.0, constant)
    assert exported.init(5.0, constant) == 0
    for k in range(20):
        y = 5.0 * math.cos(0.3 * k)
        assert exported.step(y, constant) == 0
        stepping.step(y, constant)
        assert exported.output.v == pytest.approx(stepping.v, rel=1e-9)
    header = next(text for name, text in made.files.items() if name.endswith(".h"))
    assert "[deg]" in header and "[bar]" in header


def test_comments_name_the_unit_of_each_default(files: tuple[Path, Path]) -> None:
    told = []
    for path in files:
        program = program_of(derive(model_of(read_document(path), "axis")))
        told.append({item.name: item for item in parameter_fields(program)})
    si, other = told
    assert si["u_max"].value == 3e4 and "[Pa; 0.3 bar in the model]; > 0" in si["u_max"].about
    assert other["u_max"].value == 0.3 and "[bar]; > 0" in other["u_max"].about
    kappa = si["input_scale"].value
    assert other["input_scale"].value == pytest.approx(kappa * OTHER.of_u / OTHER.of_y, rel=1e-12)
    assert f"{kappa:.6g}"[:6] in other["input_scale"].about and "for SI units" in other["input_scale"].about
    assert "for SI units" not in si["input_scale"].about


def test_a_sweep_and_a_tuned_design_agree_with_those_in_si_units(
    files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if find_compiler(os.environ) is None:
        pytest.skip("sweeps are compiled")
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    values: tuple[list[Any], list[Any]] = ([], [])
    for found, path, twin in zip(values, files, (SI, OTHER), strict=True):
        grid = ["--grid", f"theta={0.1 / twin.of_y!r},{0.3 / twin.of_y!r}", "--grid", "u_max=0.2,0.3"]
        out = str(tmp_path / path.stem)
        assert command(["sweep", str(path), *grid, "--no-figures", "--json", "--out", out]) == 0
        capsys.readouterr()
        data = xarray.open_zarr(tmp_path / path.stem / "sweep.zarr", consolidated=False)
        found.append(data["ise"].values * twin.of_y**2)
        found.append(data["final_x2"].values * twin.of_y)
        assert data["theta"].attrs["units"] == twin.y
        tuned = tmp_path / f"{path.stem}.toml"
        quick = ["--generations", "2", "--population", "2", "--seed", "7", "--max-v", repr(1e7 / twin.of_u)]
        assert command(["tune", str(path), *quick, "--no-figure", "--json", "--out", str(tuned)]) == 0
        told = json.loads(capsys.readouterr().out)
        found.append(np.array([told["gains"][name]["after"] for name in sorted(told["gains"])]))
    for one, other in zip(*values, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)
