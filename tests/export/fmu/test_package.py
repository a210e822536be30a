"""The files themselves: valid, complete, the same each time, true to the standard's own headers."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from pmjoint_codegen.export.fmu.archive import Builder
from pmjoint_codegen.export.fmu.package import units
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.tree import DOUBLE, FLOAT
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import derive

CONTROLLER, PLANT = "paper_controller.fmi{}.fmu", "paper_plant.fmi{}.fmu"
BOTH = pytest.mark.parametrize("version", [2, 3])
# Prints what a call hands over: values of enumerations, sizes and offsets.
LAYOUT_2 = """\
#include <stdio.h>
int main(void)
{
    printf("%d %d %d %d %d %d\\n", fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending);
    printf("%d %d %d %d %d\\n", fmi2CoSimulation, fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime,
        fmi2Terminated);
    printf("%zu %zu %zu\\n", sizeof(fmi2CallbackFunctions), offsetof(fmi2CallbackFunctions, freeMemory),
        offsetof(fmi2CallbackFunctions, componentEnvironment));
    return 0;
}
"""
LAYOUT_3 = """\
#include <stdio.h>
int main(void)
{
    printf("%d %d %d %d %d\\n", fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal);
    printf("%d %d %d %d\\n", fmi3Independent, fmi3Dependent, fmi3IntervalNotYetKnown, fmi3IntervalChanged);
    printf("%zu %zu %zu\\n", sizeof(fmi3ValueReference), sizeof(fmi3Boolean), sizeof(fmi3Clock));
    return 0;
}
"""


def members(path: Path) -> dict[str, bytes]:
    """Read every file of a zip."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def unpacked(path: Path, folder: Path) -> Path:
    """Unpack a unit."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder


def test_an_export_is_the_same_each_time(paper: Path, root: Path) -> None:
    path = root / "models" / "paper.toml"
    derivation = derive(model_of(read_document(path), str(path)))
    identity = Identity("paper", "0" * 64, "test")
    for name, contents in units(derivation, identity, DOUBLE, []).items():
        made = members(paper / name)
        with zipfile.ZipFile(io.BytesIO(contents)) as archive:
            assert {item.date_time for item in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
            again = {item: archive.read(item) for item in archive.namelist()}
        assert again == {item: data for item, data in made.items() if not item.startswith("binaries/")}
        assert contents == units(derivation, identity, DOUBLE, [])[name]


def test_float_changes_the_controller_and_its_token(paper: Path, root: Path) -> None:
    path = root / "models" / "paper.toml"
    derivation = derive(model_of(read_document(path), str(path)))
    made = units(derivation, Identity("paper", "0" * 64, "test"), FLOAT, [])
    with zipfile.ZipFile(io.BytesIO(made[CONTROLLER.format(3)])) as archive:
        assert "double" not in archive.read("sources/pmjoint_paper.c").decode()
        token = ET.fromstring(archive.read("modelDescription.xml")).get("instantiationToken")
    own = ET.fromstring(members(paper / CONTROLLER.format(3))["modelDescription.xml"])
    assert token != own.get("instantiationToken")


@BOTH
@pytest.mark.parametrize("name", [CONTROLLER, PLANT])
def test_fmpy_finds_no_problem(paper: Path, name: str, version: int) -> None:
    fmpy = pytest.importorskip("fmpy.validation")
    assert fmpy.validate_fmu(str(paper / name.format(version))) == []


def test_units_and_start_values_are_the_models(paper: Path) -> None:
    described = ET.fromstring(members(paper / CONTROLLER.format(3))["modelDescription.xml"])
    variables = {item.get("name"): item for item in described.find("ModelVariables") or []}
    assert {
        name: variables[name].get("start") for name in ("b0", "u_max", "c1", "sample_time", "matched")
    } == {
        "b0": "2.0",
        "u_max": "10.0",
        "c1": "15.0",
        "sample_time": "0.001",
        "matched": "false",
    }
    tunable = {name for name, item in variables.items() if item.get("variability") == "tunable"}
    assert {"d1", "b0", "u_max", "c1", "c2", "e1", "e2", "ck1", "ck2", "k1", "k2", "compensator"} <= tunable
    inputs = [name for name, item in variables.items() if item.get("causality") == "input"]
    assert inputs == ["y", "y_r", "dy_r", "d2y_r", "use_measured_u", "u_applied"]
    assert variables["b0"].get("unit") == "rad/(s^2 V)"
    bases = {unit.get("name"): unit.find("BaseUnit") for unit in described.iter("Unit")}
    base = bases["rad/(s^2 V)"]
    assert base is not None  # V = kg m^2/(s^3 A)
    assert base.attrib == {"kg": "-1", "m": "-2", "s": "1", "A": "1", "rad": "1"}


@BOTH
@pytest.mark.parametrize("name", [CONTROLLER, PLANT])
def test_the_sources_are_complete(paper: Path, tmp_path: Path, name: str, version: int) -> None:
    """FMPy builds each unit from its own sources with CMake, and the result runs."""
    pytest.importorskip("fmpy")
    if shutil.which("cmake") is None:
        pytest.skip("no cmake")
    unit = tmp_path / name.format(version)
    bare = {key: data for key, data in members(paper / unit.name).items() if not key.startswith("binaries/")}
    with zipfile.ZipFile(unit, "w") as archive:
        for key, data in bare.items():
            archive.writestr(key, data)
    command = [sys.executable, "-m", "fmpy", "compile", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len([key for key in members(unit) if key.endswith((".so", ".dylib"))]) == 1
    command = [sys.executable, "-m", "fmpy", "simulate", str(unit), "--stop-time", "0.01"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@BOTH
def test_the_declarations_are_those_of_the_standard(paper: Path, tmp_path: Path, version: int) -> None:
    """The wrapper compiles with the headers that FMPy ships in place of its own; values and layout agree."""
    fmpy = pytest.importorskip("fmpy")
    headers = Path(fmpy.__file__).parent / "c-code"
    sources = unpacked(paper / CONTROLLER.format(version), tmp_path) / "sources"
    guard = (
        f"#define PMJOINT_FMI{version}_H\n#define FMI{version}_EXPORT\n#define FMI{version}_NAME(name) name\n"
    )
    (sources / "both.c").write_text(f'{guard}#include "fmi{version}Functions.h"\n#include "fmi{version}.c"\n')
    compiler = shutil.which("cc") or pytest.skip("no cc")
    command = [
        compiler,
        "-std=c99",
        "-Wall",
        "-Werror",
        f"-I{headers}",
        "-fsyntax-only",
        str(sources / "both.c"),
    ]
    done = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    layout = {2: LAYOUT_2, 3: LAYOUT_3}[version]
    told = []
    for header in (f"fmi{version}.h", f"fmi{version}Functions.h"):
        program = sources / "layout"
        (sources / "layout.c").write_text(f'#include <stddef.h>\n#include "{header}"\n{layout}')
        build = [compiler, f"-I{headers}", "-o", str(program), str(sources / "layout.c")]
        subprocess.run(build, check=True, capture_output=True)
        told.append(subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout)
    assert told[0] == told[1]


def test_a_binary_for_another_platform_names_no_folder_of_the_build() -> None:
    pytest.importorskip("ziglang", reason="the package ziglang is not installed")
    source = {"unit.c": "double half(double x);\ndouble half(double x)\n{\n    return x / 2.0;\n}\n"}
    builder = Builder.by_ziglang("aarch64-linux", os.environ)
    first, second = (builder.binary(source, ["unit.c"], "unit") for _ in range(2))
    assert first == second and b"pmjoint-fmu-" not in first
    assert first[:4] == b"\x7fELF" and first[18:20] == (183).to_bytes(2, "little")  # EM_AARCH64
